"""Accelerometers: what they report of the specific force at their place."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.machine.instruments import make_accelerometers


@pytest.fixture
def true():
    """Specific force of a point that is accelerated by up to about 1 g."""
    return np.random.default_rng(5).normal([0, 0, 9.81], 3.0, (500, 3))


def test_accelerometers_without_faults_report_the_truth(true):
    rng = np.random.default_rng(0)
    faults = Faults.none().accelerometers.model_copy(update={"range_g": 10.0})
    for sensor in make_accelerometers(faults, rng):
        np.testing.assert_allclose(sensor.measure(true, 1000.0, rng), true, atol=1e-12)


def test_accelerometer_errors_are_as_large_as_stated():
    stated = AccelerometerFaults(sensors=4, cross_axis=0)
    sensors = [s for k in range(100) for s in make_accelerometers(stated, np.random.default_rng(k))]
    gains = np.array([np.linalg.norm(s.sensitivity, axis=1) - 1 for s in sensors])
    assert gains.std() == pytest.approx(0.01, rel=0.1)
    angles = [np.degrees(np.arccos(np.trace(axes(s.sensitivity)) / 2 - 0.5)) for s in sensors]
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(1.0, rel=0.1)
    assert np.std([s.offset for s in sensors]) == pytest.approx(0.05, rel=0.1)
    assert {s.limit for s in sensors} == {2 * 9.81}
    assert np.std([s.curvature for s in sensors]) == pytest.approx(0.002, rel=0.1)
    assert np.std([60 * s.drift for s in sensors]) == pytest.approx(0.001, rel=0.1)


def test_a_channel_shows_a_share_of_the_other_two_axes():
    stated = Faults.none().accelerometers.model_copy(update={"cross_axis": 0.01, "sensors": 4})
    others = [
        s.sensitivity - np.eye(3)
        for k in range(100)
        for s in make_accelerometers(stated, np.random.default_rng(k))
    ]
    assert np.abs(np.diagonal(others, axis1=1, axis2=2)).max() < 1e-12
    off_diagonal = np.array(others)[:, ~np.eye(3, dtype=bool)]
    assert off_diagonal.std() == pytest.approx(0.01, rel=0.05)


def test_a_curved_channel_errs_by_a_share_of_its_range_at_the_end_of_it():
    stated = Faults.none().accelerometers.model_copy(update={"curvature": 0.002})
    sensor = make_accelerometers(stated, np.random.default_rng(0))[0]
    half = np.full((2, 3), sensor.limit / 2)
    error = sensor.measure(half, 1000.0, np.random.default_rng(1))[0] - half[0]
    np.testing.assert_allclose(error, sensor.curvature * sensor.limit / 4, atol=1e-12)


def axes(sensitivity):
    """Take the gains off a sensitivity: a rotation is left."""
    return np.clip(sensitivity / np.linalg.norm(sensitivity, axis=1)[:, None], -1, 1)


def test_accelerometers_clip_at_their_range(true):
    sensor = make_accelerometers(AccelerometerFaults(range_g=0.5), np.random.default_rng(0))[0]
    assert sensor.measure(true, 1000.0, np.random.default_rng(1)).max() == pytest.approx(0.5 * 9.81)
