"""Measurements of clocks scatter and drift; time stamps on this computer's clock go on evenly."""

import numpy as np
import pytest

from pipeline.live.lsl import ClockOffset

TIMES = 1000 + 3.0 * np.arange(200)


def errors(measured, true):
    """Error of time stamps after each measurement [s]; offsets are those at `TIMES`."""
    clock, found = ClockOffset(), []
    for now, offset, right in zip(TIMES, measured, true, strict=True):
        clock.measure(now, offset)
        found.append(float(clock.local(np.array([now - right]))[0]) - now)
    return np.array(found), clock


def test_scatter_of_the_measurements_is_smoothed():
    rng = np.random.default_rng(2)
    true = np.full(200, 7.0)
    found, _ = errors(true + rng.normal(0, 1e-4, 200), true)
    assert np.abs(found[30:]).max() < 1e-4
    assert np.std(found[60:]) < 4e-5
    assert np.abs(np.diff(found[30:])).max() < 5e-5


def test_a_clock_that_drifts_is_followed_without_lag():
    """By 50 ppm, as that of an ordinary computer."""
    rng = np.random.default_rng(3)
    true = 5 + 5e-5 * (TIMES - 1000)
    found, _ = errors(true + rng.normal(0, 2e-5, 200), true)
    assert np.abs(found[60:]).max() < 3e-5


def test_between_measurements_the_drift_goes_on():
    true = 5 + 5e-5 * (TIMES - 1000)
    _, clock = errors(true, true)
    later = TIMES[-1] + 3.0
    stamp = later - (5 + 5e-5 * (later - 1000))
    assert clock.local(np.array([stamp]))[0] == pytest.approx(later, abs=1e-8)


def test_single_wrong_measurements_have_no_effect():
    true = np.full(200, -3.0)
    wrong = true.copy()
    wrong[[40, 90, 91]] += 5e-3
    wrong[[60, 70]] += 0.05
    found, _ = errors(wrong, true)
    assert np.abs(found).max() < 1e-9


def test_a_clock_that_was_set_anew_is_followed_from_the_second_measurement():
    true = np.where(np.arange(200) < 100, 1.0, 3.0)
    found, _ = errors(true, true)
    assert np.flatnonzero(np.abs(found) > 1e-9).tolist() == [100]
