"""Accelerometers: what they report of the specific force at their place."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import AccelerometerFaults, Faults
from pipeline.virtual_lab.machine.instruments.accelerometer import make_accelerometers


@pytest.fixture
def true():
    """Specific force of a point that is accelerated by up to about 1 g."""
    return np.random.default_rng(5).normal([0, 0, 9.81], 3.0, (500, 3))


def test_accelerometers_without_faults_report_the_truth(true):
    rng = np.random.default_rng(0)
    faults = Faults.none().accelerometers.model_copy(update={"range_g": 10.0})
    for sensor in make_accelerometers(faults, rng):
        np.testing.assert_allclose(sensor.measure(true, rng), true, atol=1e-12)


def test_accelerometer_errors_are_as_large_as_stated():
    sensors = [
        s
        for k in range(100)
        for s in make_accelerometers(AccelerometerFaults(sensors=4), np.random.default_rng(k))
    ]
    gains = np.array([np.linalg.norm(s.sensitivity, axis=1) - 1 for s in sensors])
    assert gains.std() == pytest.approx(0.01, rel=0.1)
    angles = [np.degrees(np.arccos(np.trace(axes(s.sensitivity)) / 2 - 0.5)) for s in sensors]
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(1.0, rel=0.1)
    assert np.std([s.offset for s in sensors]) == pytest.approx(0.05, rel=0.1)
    assert {s.limit for s in sensors} == {2 * 9.81}


def axes(sensitivity):
    """Take the gains off a sensitivity: a rotation is left."""
    return np.clip(sensitivity / np.linalg.norm(sensitivity, axis=1)[:, None], -1, 1)


def test_accelerometers_clip_at_their_range(true):
    sensor = make_accelerometers(AccelerometerFaults(range_g=0.5), np.random.default_rng(0))[0]
    assert sensor.measure(true, np.random.default_rng(1)).max() == pytest.approx(0.5 * 9.81)
