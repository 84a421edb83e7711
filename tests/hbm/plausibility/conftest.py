"""A walk of the synthetic subject with noise, as cameras see it."""

import numpy as np
import pytest

from tests.hbm.motions import markers_of, swinging, with_noise
from tests.synthetic import synthetic_body


@pytest.fixture(scope="session")
def exact_walk():
    return markers_of(synthetic_body(), swinging(np.random.default_rng(30), degrees=20.0))


@pytest.fixture(scope="session")
def walk(exact_walk):
    return with_noise(exact_walk, np.random.default_rng(31), 0.004)
