"""OpenSim's example subject has OpenSim's residuals, from a T-pose and a walk over two plates."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from pipeline.io.opensim import read_sto
from tests.recordings.recorded import overground, recorded

MASS_KG = 72.6
TRANSLATIONS = ("pelvis_tx_force", "pelvis_tz_force", "pelvis_ty_force")
ROTATIONS = ("pelvis_list_moment", "pelvis_tilt_moment", "pelvis_rotation_moment")


@pytest.fixture(scope="module")
def body(shared_data):
    _, known = recorded(overground, shared_data)
    return build_body(known["static"].markers, mass=MASS_KG)


@pytest.fixture(scope="module")
def walk(shared_data):
    return recorded(overground, shared_data)[0]


@pytest.fixture(scope="module")
def motion(body, walk):
    return solve_ik(body, walk.markers)


def test_knees_and_ankles_are_followed_without_their_own_markers(motion):
    """The walk lacks all eight epicondyles and malleoli; thigh, shank and foot markers remain."""
    assert len(motion.markers) == 41
    assert motion.converged.all()
    assert motion.observed[:, [motion.names.index("RKneeFlexion")]].all()
    flexion = np.degrees(motion.coordinate("RKneeFlexion"))
    assert 55 < np.ptp(flexion) < 80


def test_residuals_are_no_worse_than_those_that_opensim_publishes(shared_data, body, walk, motion):
    """Same trial, same 1.2 s, 6 Hz; theirs with a torso in one piece, ours with arms and head."""
    published = read_sto(shared_data / "opensim_subject01" / "inverse_dynamics.sto")
    theirs = [np.sqrt(np.mean(published.columns[c] ** 2)) for c in TRANSLATIONS + ROTATIONS]
    wrenches = {
        foot: butterworth(
            resample(plate.time, plate.wrench, motion.time), motion.time, 6.0, "zero_phase"
        ).value
        for foot, plate in zip(("right_foot", "left_foot"), walk.plates, strict=True)
    }
    smooth = filter_motion(motion, cutoff=6.0, method="zero_phase")
    residual = inverse_dynamics(body, smooth, wrenches).residual
    begin, end = published.time[[0, -1]]
    inside = (motion.time > begin - 1e-3) & (motion.time < end + 1e-3)
    ours = np.sqrt(np.mean(residual[inside] ** 2, axis=0))
    assert inside.sum() == len(published.time)
    assert (ours <= theirs).all(), f"ours {ours.round(1)}, OpenSim's {np.round(theirs, 1)}"
