"""Delay and noise of each accelerometer are found from a calibration of a rigid platform."""

from dataclasses import replace

import numpy as np
import pytest

from compensation.delay import sensor_delays
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from compensation.inertia.sensors import Sensor, describe_sensors, find_sensors, noise_for_fit
from hbm.signals.resampling import interpolate

RATE_HZ = 1000.0
SETUP = Setup(("rear", "front"), rate_hz=RATE_HZ, cutoff_hz=20.0)
REAR, FRONT = slice(0, 3), slice(3, 6)


def recorded(laboratory, seed, *, late_s=(0.0, 0.0), duration=20.0, **changes):
    """Give readings and wrench at 1000 Hz; each sensor by its own delay, the noise is the same."""
    lab = laboratory(crooked=False)
    for name, value in changes.items():
        setattr(lab, name, value)
    trials = [lab.random_trial(seed, duration, late_s=late, noise=seed) for late in late_s]
    parts = [t.accelerations[:, s] for t, s in zip(trials, (REAR, FRONT), strict=True)]
    return np.hstack(parts), lab.random_trial(seed, duration, noise=seed).wrench


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("late_s", [(0.0, 0.005), (-0.0123, 0.002), (0.004, 0.004)])
def test_each_sensors_delay_is_found_within_its_interval(laboratory, seed, late_s):
    readings, wrench = recorded(laboratory, seed, late_s=late_s)
    for true, found in zip(late_s, sensor_delays(readings, wrench, RATE_HZ), strict=True):
        assert abs(found.seconds - true) < 1.96 * found.standard_error
        assert found.standard_error < 0.0003


def test_a_single_sensor_has_the_delay_that_all_have(laboratory):
    readings, wrench = recorded(laboratory, 1, late_s=(0.005, 0.0))
    (found,) = sensor_delays(readings[:, REAR], wrench, RATE_HZ)
    assert abs(found.seconds - 0.005) < 0.0005  # three channels approximate the plate


def test_noise_after_the_filter_is_read_from_the_readings_themselves(laboratory):
    rng = np.random.default_rng(0)
    readings, wrench = recorded(laboratory, 3, acceleration_noise=0.0)
    sizes = np.repeat([0.02, 0.08], 3)
    noise = sizes * rng.normal(size=readings.shape)
    filtered = [SETUP.low_pass(x, RATE_HZ) for x in (readings + noise, wrench)]
    rear, front = find_sensors(*filtered, readings + noise, SETUP, RATE_HZ)
    true = SETUP.low_pass(noise, RATE_HZ).std(axis=0)
    assert rear.noise_mps2 == pytest.approx(np.sqrt(np.mean(true[REAR] ** 2)), rel=0.05)
    assert front.noise_mps2 == pytest.approx(np.sqrt(np.mean(true[FRONT] ** 2)), rel=0.05)


def test_a_platform_that_bends_is_not_taken_for_noise(laboratory):
    """What sensors disagree in is taken out of the fit only as far as it is their noise."""
    readings, wrench = recorded(laboratory, 3)
    bending = 0.05 * np.sin(2 * np.pi * 9 * np.arange(len(readings)) / RATE_HZ)
    bent = readings + bending[:, None] * [0, 1, 0, 0, -1, 0]
    for given, allowed in ((readings, True), (bent, False)):
        filtered = [SETUP.low_pass(x, RATE_HZ) for x in (given, wrench)]
        sensors = find_sensors(*filtered, given, SETUP, RATE_HZ)
        assert bool(np.any(noise_for_fit(sensors, filtered[0]))) == allowed


@pytest.mark.parametrize("seed", range(1))
def test_a_late_sensor_and_a_wrong_gain_leave_what_perfect_sensors_leave(laboratory, seed):
    """One sensor 5 ms late, the other 3 % too large; without correction newtons are left."""
    perfect, wrench = recorded(laboratory, seed)
    faulty, _ = recorded(laboratory, seed, late_s=(0.005, 0.0))
    faulty[:, FRONT] *= 1.03
    left = {}
    for name, readings in (("perfect", perfect), ("uncorrected", faulty), ("corrected", faulty)):
        felt, w = (SETUP.low_pass(x, RATE_HZ) for x in (readings, wrench))
        if name == "corrected":
            rear, front = find_sensors(felt, w, readings, SETUP, RATE_HZ)
            assert abs(rear.delay_s - 0.005) < 1.96 * rear.delay_error_s
            assert abs(front.delay_s) < 1.96 * front.delay_error_s
            time = np.arange(len(felt)) / RATE_HZ
            parts = [
                interpolate(time, felt[:, s], time + x.correction_s)
                for s, x in ((REAR, rear), (FRONT, front))
            ]
            felt = np.hstack(parts)
        inside = np.isfinite(felt).all(axis=1)
        left[name] = fit_inertia(felt[inside], w[inside]).rms_compensated
    np.testing.assert_allclose(left["corrected"], left["perfect"], rtol=0.1)
    assert np.max(left["uncorrected"] / left["perfect"]) > 2


def test_only_a_delay_whose_interval_excludes_none_is_corrected():
    late = Sensor("rear", 0.0002, 0.00015)
    assert late.correction_s == 0.0
    assert describe_sensors((late,)) == ()
    assert replace(late, delay_error_s=0.00005).correction_s == 0.0002
    (unknown,) = describe_sensors((replace(late, delay_error_s=None),))
    assert unknown.values["sensors"] == ("rear",)
