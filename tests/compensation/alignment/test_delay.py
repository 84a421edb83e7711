"""Gauss–Newton steps of a delay: where they lead, and how fast."""

import numpy as np
import pytest

from compensation.alignment.delay import STEP_TOLERANCE, without_step


@pytest.mark.parametrize("share", [0.3, 0.7, 1.0, 1.6])
def test_steps_that_are_too_short_or_too_long_by_a_factor_lead_to_the_same_delay(share):
    """A plain repetition would need some sixty of the shortest ones."""
    best, tried = np.array([0.4, -1.7]), []

    def step_of(shifts):
        tried.append(shifts)
        return share * np.sin(best - shifts), len(tried)

    shifts, found = without_step(step_of, np.zeros(2))
    np.testing.assert_allclose(shifts, best, atol=STEP_TOLERANCE / share)
    assert found == len(tried) <= 12


def test_no_shift_goes_beyond_the_limit():
    shifts, _ = without_step(lambda shifts: (10 - shifts, None), np.zeros(1), limit=3)
    assert shifts == 3
