"""The empty treadmill of the virtual laboratory and its calibration, made once."""

import pytest

from pipeline.trial.ground.calibrations import fit_calibration
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL


@pytest.fixture(scope="session")
def empty():
    return lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))


@pytest.fixture(scope="session")
def calibration(empty):
    return fit_calibration(empty, TREADMILL)
