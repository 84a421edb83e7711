"""A trial on a stationary treadmill: a T-pose, then walking, as a C3D file."""

import pytest

from pipeline.io.c3d.read import read_c3d
from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    path = tmp_path_factory.mktemp("trial") / "walk.c3d"
    return simulate_trial(path, duration_s=8.0, seed=3), path


def test_plates_carry_the_persons_weight_in_the_t_pose(trial):
    recording = read_c3d(trial[1])
    weight = sum(plate.wrench[:1000, 2].mean() for plate in recording.plates)
    assert weight == pytest.approx(74.6 * 9.81, abs=0.2)


def test_equal_seeds_give_equal_bytes(trial, tmp_path):
    again = tmp_path / "again.c3d"
    simulate_trial(again, duration_s=8.0, seed=3)
    assert again.read_bytes() == trial[1].read_bytes()
