"""What residuals of recordings are made of: halves predict each other, known causes are found."""

import numpy as np
import pytest

import pipeline
from hbm.markers import read_marker_set
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.explain.explain import explain_trial
from pipeline.explain.linearise import explained_part, left_by_filter, linearised, rms
from pipeline.io.opensim import read_opensim_trial, read_trc
from pipeline.trial.ground.laboratory import Laboratory
from tests.recordings.test_generated_walk import (
    MARKER_SETS,
    MASS_KG,
    STATURE_M,
    masses_of_model,
)

STILL = Laboratory(Treadmill())
LINEAR_PROTOTYPE = [[11.8, 5.8, 13.9, 2.4, 3.3, 1.8], [9.5, 6.3, 13.6, 2.4, 3.1, 1.8]]
"""What 56 linear effects of the plates and the body, fitted to one half, left in the other."""
NOT_ITS_CAUSES = ("delay", "zero", "gain", "place", "skin")
"""Its plates are exact, and its markers rigid."""


def test_causes_found_in_half_of_the_cycles_hold_in_the_other(shared_data):
    """On every axis better than effects that are linear and know nothing of usual sizes."""
    walk = pipeline.read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")
    result = pipeline.process_recording(walk, Subject(mass_kg=55.3), Settings())
    part = explained_part(walk, STILL, result)
    chain, middle = part.chain, len(part.series) // 2
    left, halves = left_by_filter(chain), (slice(middle), slice(middle, None))
    for own, other, limits in zip(halves, halves[::-1], LINEAR_PROTOTYPE, strict=True):
        _, effects, posterior = linearised(chain, part.causes, left, part.series.some(own))
        without = chain.residual - left - np.tensordot(posterior.size, effects, 1)
        cycles = part.series.some(other).frames
        assert (rms(np.concatenate([without[each] for each in cycles])) < limits).all()


@pytest.fixture(scope="module")
def generated(shared_data):
    folder = shared_data / "truth_walk"
    walk = read_opensim_trial(folder / "markers.trc", folder / "grf.mot", "forward,up,right")
    text = (MARKER_SETS / "arnold2013.toml").read_text(encoding="utf-8")
    result = pipeline.process_recording(
        walk,
        Subject(sex="male", mass_kg=MASS_KG, height_m=STATURE_M),
        Settings(),
        marker_set=read_marker_set(text, "arnold2013"),
    )
    return result.body, explain_trial(walk, STILL, result)


def test_no_cause_is_certain_that_a_generated_walk_does_not_have(generated):
    _, budget = generated
    certain = {cause.name: cause.group for cause in budget.causes if cause.is_certain}
    assert not set(certain.values()) & set(NOT_ITS_CAUSES), certain


@pytest.mark.parametrize("segment", ["foot", "thigh", "shank"])
def test_masses_of_a_generated_walk_are_found_by_how_much_they_are_wrong(
    generated, shared_data, segment
):
    body, budget = generated
    true = masses_of_model(shared_data / "truth_walk")[segment]
    wrong = body.segments[f"left_{segment}"].mass / true - 1
    name = {"foot": "feet"}.get(segment, f"{segment}s")
    found = next(cause for cause in budget.causes if cause.name == f"{name}: mass")
    assert abs(found.size - wrong) < 1.96 * found.deviation


def test_causes_found_in_half_of_the_frames_of_one_gait_cycle_hold_in_the_other(shared_data):
    """Of the vertical force and the moments; half a cycle of walking over two plates does not tell
    what the horizontal forces of the other half are made of."""
    folder = shared_data / "opensim_subject01"
    axes = "forward,up,right"
    walk = read_opensim_trial(
        folder / "subject01_walk1.trc", folder / "subject01_walk1_grf.mot", axes
    )
    text = (MARKER_SETS / "gait2354.toml").read_text(encoding="utf-8")
    result = pipeline.process_recording(
        walk,
        Subject(mass_kg=72.6),
        Settings(),
        static=read_trc(folder / "subject01_static.trc", axes),
        marker_set=read_marker_set(text, "gait2354"),
    )
    budget = explain_trial(walk, STILL, result)
    assert (budget.cycles, [note.code for note in budget.notes]) == (1, ["explained_few_cycles"])
    assert (budget.held_out[2:] > 0.4).all()
