"""Fixtures of explained trials."""

import pytest

from tests.pipeline import lab
from tests.pipeline.explain import moving_trial


@pytest.fixture(scope="session")
def calibration():
    return moving_trial.calibration()


@pytest.fixture(scope="session")
def laboratory(calibration):
    return moving_trial.laboratory_of(calibration)


@pytest.fixture(scope="session")
def walker(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    return lab.walk(folder, duration_s=moving_trial.DURATION_S, marker_noise_m=0.0)


@pytest.fixture(scope="session")
def chain(walker, laboratory):
    return moving_trial.chain_of(moving_trial.moved(walker), laboratory)
