"""On real recordings no frame's sum of squares is above SciPy's, best of five starts."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.ik.tracking import solve_ik
from pipeline.io.c3d.read import read_c3d
from tests.campaign.inverse_kinematics import (
    MAX_RELATIVE_EXCESS,
    ROUNDING_M2,
    Case,
    least_cost,
)

FRAMES = 12


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trial", "static"),
    [
        ("plug_in_gait/Movement_trial.c3d", "plug_in_gait/Static_trial.c3d"),
        ("treadmill_hbm2/treadmill_events.c3d", None),
        ("full_body_standing/1min_CGM_HBM_static.c3d", None),
    ],
)
def test_every_frame_is_solved_at_scipys_least_cost(shared_data, trial, static):
    recording = read_c3d(shared_data / trial)
    pose = read_c3d(shared_data / static) if static else recording
    body = build_body(pose.markers, mass=70.0, limbs=pose.metadata.limbs)
    found = solve_ik(body, recording.markers)
    assert found.converged.all()
    own = [recording.markers.names.index(name) for name in found.markers]
    assert found.markers == body.markers
    for frame in np.linspace(0, len(found.time) - 1, FRAMES).astype(int):
        case = Case(int(frame), body, found.q[frame], recording.markers.position[frame, own])
        theirs, ours = least_cost(case), np.nansum(found.marker_error[frame] ** 2)
        assert theirs is not None
        assert ours <= theirs * (1 + MAX_RELATIVE_EXCESS) + ROUNDING_M2
