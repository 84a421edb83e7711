"""Frames in which the plates carry a runner: a delay of the plates is no foot beside them."""

import numpy as np
import pytest

from hbm.dynamics import Dynamics
from hbm.signals.filtering import low_pass
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Settings
from pipeline.trial.gait.contact import SharedPlates
from pipeline.trial.ground.wrenches import Ground
from pipeline.trial.weight_bearing import weight_bearing_frames
from tests.pipeline.fake_results import ENGINE
from tests.synthetic import synthetic_body

BODY = synthetic_body()
WEIGHT_N = BODY.mass * GRAVITY_MPS2
STRIDE_S, CONTACT_S = 0.72, 0.25
TIME = np.arange(800) / 100


def running(later_s=0.0):
    """The wrench under each foot, (2, T, 6) [N]: vertical half sines with braking and push-off."""
    wrenches = np.zeros((2, len(TIME), 6))
    peak_n = np.pi * WEIGHT_N * STRIDE_S / (4 * CONTACT_S)
    for foot, begin_s in enumerate((0.1, 0.1 + STRIDE_S / 2)):
        since = np.mod(TIME - later_s - begin_s, STRIDE_S) / CONTACT_S
        wrenches[foot, :, 2] = peak_n * np.sin(np.pi * since) * (since < 1)
        wrenches[foot, :, 0] = -0.15 * peak_n * np.sin(2 * np.pi * since) * (since < 1)
    return wrenches


def judged(plates):
    """Frames in which these plates carry the runner whose motion needs `running`."""
    settings = Settings()
    need = low_pass(running().sum(axis=0), TIME, settings.cutoff_hz, settings.filter)
    total = low_pass(plates.sum(axis=0), TIME, settings.cutoff_hz, settings.filter)
    zeros = np.zeros((len(TIME), 46))
    feet = {"left_foot": plates[0], "right_foot": plates[1]}
    return weight_bearing_frames(
        BODY,
        TIME,
        Ground({"measured": list(plates)}, None, ()),
        {"measured": SharedPlates(feet, np.zeros(len(TIME), bool), ())},
        {"measured": Dynamics(TIME, zeros, need - total, zeros, ENGINE)},
        (),
        settings,
    )


@pytest.mark.parametrize("later_s", [0.0, 0.01, 0.02, 0.03, -0.02])
def test_a_runner_on_plates_that_are_late_is_carried_throughout(later_s):
    assert judged(running(later_s)).all()


@pytest.mark.parametrize("later_s", [0.0, 0.02])
def test_a_step_beside_the_plates_does_not_count_in_running_either(later_s):
    plates = running(later_s)
    step = (TIME > 0.1 + 4 * STRIDE_S) & (TIME < 0.1 + 4.4 * STRIDE_S)
    plates[0, step] = 0.0
    valid = judged(plates)
    assert not valid[step & (running()[0, :, 2] > WEIGHT_N)].any()
    assert valid[(TIME < 2.4) | (TIME > 4.0)].all()


def test_frames_in_which_a_plate_has_no_value_do_not_count():
    plates = running()
    plates[1, 300:320] = np.nan
    valid = judged(plates)
    assert not valid[300:320].any()
    assert valid[:240].all()
    assert valid[380:].all()
