"""A real walk gives the same residuals whichever engine solves the equations of motion."""

import pytest

from tests.pipeline.without_pinocchio import assert_only_the_engine_differs


@pytest.mark.slow
def test_without_pinocchio_a_real_walk_has_the_same_residuals(shared_data, tmp_path):
    trial = shared_data / "treadmill_hbm2" / "treadmill_events.c3d"
    assert_only_the_engine_differs(trial, tmp_path, "--mass-kg", "55.9", "--sex", "female")
