"""What a trial's residuals are made of is the same as lines, as a table and as a file."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pipeline.budgets.explanation import (
    Explanation,
    explain,
    read_explanation,
    write_explanation,
)
from pipeline.config.schema import Condition, Settings, Subject, Treadmill
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from tests.pipeline import lab

DELAY_S, STATED_S, ZERO_N = 0.012, 0.004, 4.0
ZERO = np.array([0, ZERO_N, 0, 0, 0, 0])
STILL = Laboratory(Treadmill())


@pytest.fixture(scope="module")
def recording(walker):
    """The walker's recording, its plates later than anyone states, the first with a zero error."""
    nine_seconds = lab.cropped(walker, 0, 900)
    first, second = (replace(p, time=p.time + DELAY_S) for p in nine_seconds.plates)
    first = replace(first, wrench_in_plate=first.wrench_in_plate + ZERO)
    return replace(nine_seconds, plates=(first, second))


@pytest.fixture(scope="module")
def result(recording):
    return process_recording(recording, Subject(sex="female"), Settings(plate_delay_s=STATED_S))


@pytest.fixture(scope="module")
def late(recording, result) -> Explanation:
    return explain(recording, STILL, result)


@pytest.fixture(scope="module")
def stretch(walker) -> Explanation:
    """Of two seconds in which no gait cycle counts."""
    span = Condition(window=(6.0, 8.0))
    result = process_recording(walker, Subject(sex="female"), Settings(), condition=span)
    return explain(walker, STILL, replace(result, cycles={}))


def test_a_planted_delay_is_the_first_cause_and_stated_on_top_of_what_is_stated(late):
    first = late.budget.causes[0]
    assert first.name == "plates delayed"
    assert first.size == pytest.approx(DELAY_S - STATED_S, abs=1.96 * first.deviation)
    assert first.deviation < 0.002
    zero = next(each for each in late.budget.causes if each.name == "plate 1: zero of Fy")
    assert zero.size == pytest.approx(ZERO_N, rel=0.35)
    assert zero.size == pytest.approx(ZERO_N, abs=1.96 * zero.deviation)
    assert (late.budget.held_out[:2] > 0.8).all()
    delay_s = STATED_S + first.size
    line = f"set plate_delay_s = {delay_s:.3f} (--plate-delay-ms {1000 * delay_s:.0f})"
    assert late.mending[0].action.endswith(f"; {line}.")


def test_stating_the_line_takes_the_residual_to_what_was_promised(recording, late):
    mending = late.mending[0]
    settings = tomllib.loads(mending.action.partition("set ")[2].partition(" (--")[0])
    result = process_recording(recording, Subject(sex="female"), Settings(**settings))
    rms = residual_table(result, "level").set_index("axis").loc[mending.axis, "rms"]
    assert rms == pytest.approx(mending.after, rel=0.1)
    assert mending.after < 0.6 * mending.before


def test_the_headline_is_the_measured_residual(late, result):
    side = max(result.cycles, key=lambda each: len(result.cycles[each]))
    start, stop = result.cycles[side][0][0], result.cycles[side][-1][1]
    inside = (result.motion.time >= start) & (result.motion.time < stop)
    expected = np.sqrt(np.mean(result.measured.residual[inside] ** 2, axis=0))
    np.testing.assert_allclose(late.budget.rms, expected, rtol=0.02)


def test_shares_sum_to_the_whole(late):
    whole = sum(group.share for group in late.budget.groups) + late.budget.unexplained
    np.testing.assert_allclose(whole, 1.0, atol=1e-9)


def test_a_file_brings_every_number_back(late, stretch, tmp_path):
    for explanation in (late, stretch):
        write_explanation(explanation, tmp_path / "walk_explained.json")
        again = read_explanation(tmp_path / "walk_explained.json", Explanation)
        write_explanation(again, tmp_path / "again.json")
        first, second = tmp_path / "walk_explained.json", tmp_path / "again.json"
        assert first.read_bytes() == second.read_bytes()
        np.testing.assert_array_equal(again.budget.held_out, explanation.budget.held_out)


def test_a_file_of_another_version_is_refused(late, tmp_path):
    path = tmp_path / "walk_explained.json"
    write_explanation(replace(late, version=99), path)
    with pytest.raises(ValueError, match="another version"):
        read_explanation(path, Explanation)


def test_without_gait_cycles_a_warning_says_what_is_explained(stretch):
    (note,) = stretch.budget.notes
    assert "2.0 s of" in str(note)
