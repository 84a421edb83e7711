"""In a perturbed trial whole cycles count, the platform's motion, or a stated part."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from compensation import PlatformPose
from hbm.spatial import Array
from pipeline.config.schema import Condition
from pipeline.figures.residuals import mean_part
from pipeline.run.store import read_trial, write_trial
from pipeline.trial.gait.cycles import motion_onsets, motion_stops
from pipeline.trial.process import process_trial
from pipeline.trial.residuals import CYCLE_COLUMNS, cycle_rows, residual_table
from pipeline.trial.window import perturbed_part
from tests.pipeline import lab

TIME = np.arange(4000) / 100
ONSETS = np.array([10.11, 20.61, 30.2])
CYCLES = {"right": np.array([[10.0, 11.1], [30.1, 31.2]]), "left": np.array([[20.5, 21.6]])}


def pose(lateral: Array) -> PlatformPose:
    position = np.column_stack([0 * lateral, lateral, 0 * lateral])
    return PlatformPose(np.tile(np.eye(3), (len(lateral), 1, 1)), position)


def swaying(onsets=ONSETS, duration_s=1 / 6):
    """0.3 m/s to the left from each onset, and slowly back four seconds later."""
    out = [
        np.clip((TIME - t) / duration_s, 0, 1) - np.clip((TIME - t - 4) / 3, 0, 1) for t in onsets
    ]
    return pose(0.3 * duration_s * np.sum(out, axis=0))


def part(window, *, cycles=CYCLES, onsets=ONSETS, platform=None):
    condition = Condition(perturbed=True, window=window)
    return perturbed_part(condition, cycles, onsets, TIME, platform or swaying())


def spans(found):
    return {side: np.reshape(own, (-1, 2)) for side, own in found.spans.items()}


def test_motion_is_from_each_onset_until_the_platform_is_slow_again():
    found, notes = part("motion")
    assert found.name == "motion"
    assert notes == ()
    for side, own in spans(found).items():
        onsets = ONSETS[[1]] if side == "left" else ONSETS[[0, 2]]
        np.testing.assert_array_equal(own[:, 0], onsets)
        np.testing.assert_allclose(np.diff(own)[:, 0], 1 / 6, atol=0.025)


@settings(max_examples=25)
@given(duration_s=st.floats(0.12, 0.8), direction=st.sampled_from([-1, 1]))
def test_the_end_of_a_motion_is_found_whatever_its_length_and_direction(duration_s, direction):
    platform = swaying(duration_s=duration_s)
    mirrored = PlatformPose(platform.rotation, direction * platform.position)
    stops = motion_stops(ONSETS, TIME, mirrored)
    np.testing.assert_allclose(stops - ONSETS, duration_s, atol=0.03)


def test_motion_forward_and_in_pitch_is_found_like_sway():
    way = np.sum([np.clip((TIME - onset) / 0.25, 0, 1) for onset in ONSETS], axis=0)
    level = np.tile(np.eye(3), (len(TIME), 1, 1))
    forward = PlatformPose(level, 0.06 * np.outer(way, [1.0, 0.0, 0.0]))
    pitching = PlatformPose(
        Rotation.from_rotvec(np.radians(3.0) * np.outer(way, [0.0, 1.0, 0.0])).as_matrix(),
        np.zeros((len(TIME), 3)),
    )
    for platform in (forward, pitching):
        np.testing.assert_allclose(motion_onsets(TIME, platform), ONSETS, atol=0.1)
        np.testing.assert_allclose(motion_stops(ONSETS, TIME, platform) - ONSETS, 0.25, atol=0.03)


def test_a_slow_pitch_sine_is_no_perturbation():
    pitch = np.radians(10.0) * np.sin(2 * np.pi * TIME / 30)
    rotation = Rotation.from_rotvec(np.outer(pitch, [0.0, 1.0, 0.0])).as_matrix()
    assert not len(motion_onsets(TIME, PlatformPose(rotation, np.zeros((len(TIME), 3)))))


def test_motion_that_outlasts_its_cycle_counts_to_the_end_of_it():
    found, _ = part("motion", platform=swaying(duration_s=1.5))
    for side, own in spans(found).items():
        np.testing.assert_array_equal(own[:, 1], CYCLES[side][:, 1])


def test_a_perturbation_without_motion_is_named_and_its_cycle_has_no_part():
    found, notes = part("motion", platform=swaying(ONSETS[:2]))
    assert [(n.code, n.values["onset_s"]) for n in notes] == [("perturbation_without_motion", 30.2)]
    assert np.isnan(spans(found)["right"][1, 1])


def test_seconds_are_after_each_onset_and_percents_of_each_cycle():
    after, _ = part((0.2, 0.5))
    assert re.findall(r"[\d.]+|%|s$", after.name) == ["0.2", "0.5", "s"]
    np.testing.assert_allclose(spans(after)["left"], [[20.81, 21.11]])
    share, _ = part(("10 %", "40%"))
    assert re.findall(r"[\d.]+|%|s$", share.name) == ["10", "40", "%"]
    np.testing.assert_allclose(spans(share)["right"], [[10.11, 10.44], [30.21, 30.54]])
    np.testing.assert_allclose(share.percent(CYCLES), [[10, 40]] * 3)


def test_a_window_that_ends_beyond_one_cycle_costs_that_cycle_alone_and_is_named():
    shorter = {**CYCLES, "left": np.array([[20.5, 21.2]])}
    found, notes = part((0.2, 0.7), cycles=shorter)
    assert np.isnan(spans(found)["left"]).all()
    assert np.isfinite(spans(found)["right"]).all()
    assert [(n.code, n.values["count"]) for n in notes] == [("window_beyond_cycle", 1)]


@pytest.mark.parametrize("begin", [20.58, 20.70])
def test_a_short_gap_of_the_platforms_pose_moves_neither_onset_nor_end(begin):
    platform = swaying()
    gap = ((begin <= TIME) & (begin + 0.03 > TIME))[:, None]
    torn = PlatformPose(
        np.where(gap[..., None], np.nan, platform.rotation),
        np.where(gap, np.nan, platform.position),
    )
    np.testing.assert_allclose(motion_onsets(TIME, torn), motion_onsets(TIME, platform), atol=0.021)
    stops = motion_stops(ONSETS, TIME, torn)
    np.testing.assert_allclose(stops, motion_stops(ONSETS, TIME, platform), atol=0.021)


@pytest.mark.parametrize(
    ("window", "changed", "message"),
    [
        ("motion", {"platform": pose(0 * TIME)}, "0.1 m/s .* 3 perturbations"),
        ((0.0, 1.2), {}, "beyond all 3 perturbed"),
    ],
)
def test_a_part_that_cannot_be_is_refused_in_one_line(window, changed, message):
    with pytest.raises(ValueError, match=message):
        part(window, **changed)


def test_motion_of_a_platform_whose_pose_is_unknown_is_refused():
    condition = Condition(perturbed=True, window="motion")
    with pytest.raises(ValueError, match=r'"motion" .*pose; .*markers'):
        perturbed_part(condition, CYCLES, ONSETS, TIME, None)


@pytest.fixture(scope="module")
def sway(study):
    """The swaying trial of the small study, by window; processed once."""
    rule = study.condition("sway").model_copy(update={"window": "motion"})
    file = study.file.model_copy(update={"conditions": study.file.conditions | {"sway": rule}})
    motion = process_trial(replace(study, file=file), "sub01", "sway")
    rule = Condition(perturbed=True, window=(0.0, 0.2))
    stated, _ = perturbed_part(
        rule, motion.cycles, motion.onsets, time=motion.motion.time, pose=motion.platform
    )
    return {
        None: replace(motion, part=None),
        "motion": motion,
        "stated": replace(motion, part=stated),
    }


def test_while_the_platform_moves_the_uncompensated_residual_is_far_above_that_of_the_cycle(sway):
    """What accelerates the belts' assemblies lasts as long as the motion does."""
    table = residual_table(sway["motion"], "sway").set_index(["window", "compensated", "axis"])
    rms = table["rms"]
    assert rms["motion", False, "Fy"] > 1.5 * rms["cycle", False, "Fy"]
    assert rms["motion", True, "Fy"] < 0.05 * rms["motion", False, "Fy"]
    assert (table["n_cycles"] == 2).all()
    result = sway["motion"]
    inside = np.zeros(len(result.motion.time), bool)
    for onset in lab.SWAYS_S:
        since = result.motion.time - onset
        inside |= (since > 0.005) & (since < 0.25)
    assert result.counted[inside].all()
    assert np.count_nonzero(result.counted) < 2 * 35


def test_the_rms_of_cycles_is_that_of_the_part(sway):
    """Parts of equal length weigh as much as their samples do."""
    table = residual_table(sway["stated"], "sway")
    part = table[table["headline"] & ~table["compensated"]]
    np.testing.assert_allclose(part["rms_of_cycles"], part["rms"], rtol=0.1)
    (window,) = set(part["window"])
    assert window.endswith(" 0.2 s")


@pytest.mark.parametrize("window", [None, "motion", "stated"])
def test_a_residual_follows_from_the_rows_of_its_cycles(sway, window):
    """Whole cycles and parts: mean squares by used frames, and those of cycles."""
    keys = ["window", "compensated", "axis"]
    rows = cycle_rows(sway[window], "sway")
    cycles = pd.DataFrame(rows, columns=CYCLE_COLUMNS).assign(
        square=lambda t: t["rms"] ** 2 * t["n_frames"], of_cycle=lambda t: t["rms"] ** 2
    )
    of_rows = cycles.groupby(keys).agg(
        {"square": "sum", "n_frames": "sum", "of_cycle": "mean", "headline": "first"}
    )
    table = residual_table(sway[window], "sway").set_index(keys).loc[of_rows.index]
    np.testing.assert_array_equal(table["headline"], of_rows["headline"])
    np.testing.assert_allclose(np.sqrt(of_rows["square"] / of_rows["n_frames"]), table["rms"])
    np.testing.assert_allclose(np.sqrt(of_rows["of_cycle"]), table["rms_of_cycles"])


def test_the_part_is_where_the_perturbation_is_in_the_cycle(sway):
    start, stop = mean_part([sway["motion"]])
    assert 0 <= start < stop <= 100
    assert 20 < stop - start < 35
    assert mean_part([sway[None]]) is None


def test_the_part_is_stored_with_the_trial(sway, tmp_path):
    write_trial(sway["motion"], tmp_path / "sway.parquet")
    back = read_trial(tmp_path / "sway.parquet")
    assert back.part == sway["motion"].part
    pd.testing.assert_frame_equal(
        residual_table(back, "sway"), residual_table(sway["motion"], "sway")
    )
