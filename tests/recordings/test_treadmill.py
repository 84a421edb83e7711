"""A real treadmill walk gives what its markers, Plug-in-Gait and its plates say."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Treadmill
from pipeline.trial.gait.detection import detect_events
from pipeline.trial.gait.events import compare_events
from pipeline.trial.ground.laboratory import Laboratory
from tests.benchmarks.events import event_sources
from tests.recordings.recorded import recorded, treadmill

FEET = ("left_foot", "right_foot")
EDGE = slice(50, -50)


@pytest.fixture(scope="module")
def recording(shared_data):
    return recorded(treadmill, shared_data)[0]


@pytest.fixture(scope="module")
def mass(recording):
    """A walker on a treadmill weighs on average what the belts carry."""
    return float(sum(plate.wrench[:, 2].mean() for plate in recording.plates) / GRAVITY_MPS2)


@pytest.fixture(scope="module")
def body(recording, mass):
    return build_body(recording.markers, mass=mass, sex="female")


@pytest.fixture(scope="module")
def motion(body, recording):
    return solve_ik(body, recording.markers)


@pytest.fixture(scope="module")
def residual(body, motion, recording):
    wrenches = {
        foot: butterworth(
            resample(plate.time, plate.wrench, motion.time), motion.time, 6.0, "zero_phase"
        ).value
        for foot, plate in zip(FEET, recording.plates, strict=True)
    }
    smooth = filter_motion(motion, cutoff=6.0, method="zero_phase")
    return inverse_dynamics(body, smooth, wrenches).residual


def test_head_and_arms_are_fixed_to_the_trunk(body, motion):
    assert {"HeadFlexion", "RElbowFlexion", "LToeFlexion"} <= set(body.locked)
    assert 1.66 < body.height_m < 1.78  # the file says 1.72 m
    for name in body.locked:
        np.testing.assert_array_equal(motion.coordinate(name), 0)


def test_markers_are_fitted_within_12_mm_rms_and_none_is_30_mm_away(motion):
    assert motion.converged.all()
    assert np.sqrt(np.mean(motion.marker_error**2)) < 0.012
    assert motion.marker_error.max() < 0.030


@pytest.mark.parametrize("side", "LR")
@pytest.mark.parametrize(
    ("joint", "coordinate", "sign", "least", "most_deg"),
    [
        ("Hip", "HipFlexion", 1, 0.95, np.inf),
        ("Knee", "KneeFlexion", 1, 0.98, 5),
        ("Ankle", "AnklePlantarFlexion", -1, 0.95, np.inf),
    ],
)
def test_flexions_follow_plug_in_gait(
    recording, motion, side, joint, coordinate, sign, least, most_deg
):
    ours = sign * motion.coordinate(side + coordinate)
    theirs = np.radians(recording.model_outputs[f"{side}{joint}Angles"][:, 0])
    assert np.corrcoef(ours, theirs)[0, 1] > least
    assert np.std(ours - theirs) < np.radians(most_deg)


def test_force_residual_is_small_on_every_axis_and_averages_to_zero_vertically(residual, mass):
    assert abs(residual[EDGE, 2].mean()) < 0.02 * mass * GRAVITY_MPS2
    assert (residual[EDGE, :3].std(axis=0) < 25).all()


def test_automatic_gait_events_agree_with_the_plates_and_with_those_of_the_file(recording):
    """Both feet share a plate in half of the steps; no truth is known."""
    sources = event_sources(recording, Laboratory(Treadmill()))
    found = {
        method: detect_events(**sources, method=method)[0] for method in ("file", "plates", "auto")
    }
    for kind in compare_events(found["auto"], found["file"]):
        assert kind.only_in_first == 0
        assert kind.only_in_second <= 1  # at an end of the recording
        assert abs(kind.mean_ms) < 25
        assert kind.sd_ms < 13
    for kind in compare_events(found["auto"], found["plates"]):
        if kind.label == "foot_strike":
            assert kind.matched >= 7
            assert abs(kind.mean_ms) < 5
