"""A person beside an empty plate is carried by one plate or by the frame."""

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.calibration_trial import BESIDE, PERSON, run_beside
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting

SHORT = Setting(protocol=Protocol(beside_s=12.0))
EMPTY = {"right": {1}, "left": {2}, "boards": {1, 2}}
"""Plates that stay empty; the left one is plate 1."""


@pytest.fixture(scope="module", params=BESIDE)
def recorded(request):
    """One recording of a rigid treadmill with ideal instruments, and which it is."""
    setting = SHORT.model_copy(update={"faults": Faults.none()})
    treadmill = make_treadmill(setting.faults, setting.seed)
    return BESIDE[request.param], run_beside(setting, treadmill, request.param)


def test_a_person_is_carried_by_one_plate_or_by_the_frame(recorded):
    planned, recording = recorded
    for plate in recording.plates:
        upward = plate.wrench[2000:-2000, 2]
        if plate.number in EMPTY[planned.place]:
            assert np.abs(upward).max() < 0.01
        else:  # one of the fifteen to twenty-two steps is cut by the end of the window
            assert upward.mean() == pytest.approx(PERSON.mass * GRAVITY_MPS2, rel=1 / 15)
