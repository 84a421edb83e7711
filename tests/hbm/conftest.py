"""The synthetic person's body, and a motion of it."""

import numpy as np
import pytest

from tests.hbm.motions import swinging
from tests.synthetic import synthetic_body


@pytest.fixture(scope="session")
def body():
    return synthetic_body()


@pytest.fixture(scope="module")
def motion():
    return swinging(np.random.default_rng(1))
