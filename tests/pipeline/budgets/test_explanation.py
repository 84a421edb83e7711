"""What a trial's residuals are made of, as lines, as a table and as a file."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pipeline.budgets.explanation import (
    FORMAT_VERSION,
    Explanation,
    explain,
    read_explanation,
    write_explanation,
)
from pipeline.budgets.words import budget_table
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.figures.explained import budget_figure
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import AXES

DELAY_S = 0.012
STILL = Laboratory(Treadmill())


def later(recording, delay_s):
    """The same recording with plates that are late."""
    plates = tuple(replace(p, time=p.time + delay_s) for p in recording.plates)
    return replace(recording, plates=plates)


def explained(recording, settings=None, cycles=None):
    result = process_recording(recording, Subject(sex="female"), settings or Settings())
    if cycles is not None:
        result = replace(result, cycles={k: v[:cycles] for k, v in result.cycles.items()})
    return explain(recording, STILL, result)


@pytest.fixture(scope="module")
def late(walker) -> Explanation:
    return explained(later(walker, DELAY_S))


@pytest.fixture(scope="module")
def few(walker) -> Explanation:
    return explained(walker, cycles=3)


def test_a_planted_delay_is_the_first_cause_that_is_named(late):
    first = late.budget.causes[0]
    assert first.name == "plates are late"
    assert first.size == pytest.approx(DELAY_S, abs=1.96 * first.deviation)
    assert first.deviation < 0.002
    largest, mending, *_ = late.lines()
    assert largest.startswith("Largest causes (size ± 95 % interval): plates are late 1")
    line = f"state plate_delay_s = {first.size:.3f} under [settings] ("
    assert mending.startswith(f"Most worth mending: {line}")


def test_what_is_worth_stating_comes_on_top_of_what_is_stated(walker):
    settings = Settings(plate_delay_s=0.004)
    found = explained(later(walker, DELAY_S), settings)
    delay_s = 0.004 + found.budget.causes[0].size
    assert found.mending[0].action == f"state plate_delay_s = {delay_s:.3f} under [settings]"


def test_stating_the_line_takes_the_residual_to_what_was_promised(walker, late):
    mending = late.mending[0]
    settings = tomllib.loads(mending.action.removeprefix("state ").partition(" under ")[0])
    stated = explained(later(walker, DELAY_S), Settings(**settings))
    after = stated.budget.rms[AXES.index(mending.axis)]
    assert after == pytest.approx(mending.after, rel=0.1)
    assert mending.after < 0.5 * mending.before


def test_shares_sum_to_the_whole(late):
    whole = sum(group.share for group in late.budget.groups) + late.budget.unexplained
    np.testing.assert_allclose(whole, 1.0, atol=1e-9)


def test_a_file_brings_every_number_back(late, few, tmp_path):
    for explanation in (late, few):
        write_explanation(explanation, tmp_path / "walk_explained.json")
        again = read_explanation(tmp_path / "walk_explained.json")
        assert again.to_json() == explanation.to_json()
        np.testing.assert_array_equal(again.budget.held_out, explanation.budget.held_out)
        assert again.budget.notes == explanation.budget.notes


def test_the_file_names_axes_and_has_no_number_that_json_does_not_know(few):
    stored = json.loads(few.to_json(), parse_constant=pytest.fail)
    assert tuple(stored["budget"]["rms"]) == AXES
    assert tuple(stored["budget"]["held_out"]) == AXES
    assert stored["budget"]["source"] == "walk_0.c3d"


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (f'"version": {FORMAT_VERSION}', '"version": 99', "written by another version"),
        ('"Fx"', '"FX"', "expected numbers by axis"),
        ('"cycles"', '"strides"', "damaged"),
        ("{", "", "damaged"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(late, tmp_path, old, new, why):
    path = tmp_path / "walk_explained.json"
    path.write_text(late.to_json().replace(old, new))
    with pytest.raises(ValueError, match=why) as refused:
        read_explanation(path)
    assert "\n" not in str(refused.value)


def test_fewer_than_four_cycles_are_said_and_one_half_of_their_frames_checks_the_other(few):
    (note,) = few.budget.notes
    assert note.code == "explained_few_cycles"
    assert str(note).startswith("3 gait cycles were explained, fewer than 4: ")
    *_, check = few.lines()
    assert check.startswith("Held-out check: the causes found in one half of the frames take away")


def test_a_stretch_without_gait_cycles_is_said(walker):
    result = process_recording(walker, Subject(sex="female"), Settings(), window=(3.0, 8.0))
    found = explain(walker, STILL, replace(result, cycles={}))
    assert [note.code for note in found.budget.notes] == ["explained_without_cycles"]
    assert "5.0 s of the recording" in str(found.budget.notes[0])
    assert "no gait cycles" in budget_table(found.budget)[0]


def test_the_table_has_the_measured_residual_first_and_a_column_per_group(late):
    *_, columns = budget_table(late.budget)
    heads = [head for head, _ in columns]
    assert heads[:2] == ["RMS", "95 %"]
    assert heads[-1] == "not explained"
    assert len(heads) == 3 + len(late.budget.groups)
    assert any(head.startswith("plates' delay: 1") and head.endswith(" ms") for head in heads)


def test_the_figure_stacks_each_residual_to_its_whole(late):
    (panel,) = budget_figure(late.budget).axes
    whole = dict.fromkeys(range(6), 0.0)
    for bar in panel.patches:
        whole[round(bar.get_x() + bar.get_width() / 2)] += bar.get_height()
    np.testing.assert_allclose(list(whole.values()), 100, atol=1e-6)
