"""Time stamps on this computer's clock follow measurements that scatter and drift."""

import numpy as np

from pipeline.live.lsl import ClockOffset

TIMES = 1000 + 3.0 * np.arange(200)


def errors(measured, true):
    """Error of time stamps after each measurement [s]; offsets are those at `TIMES`."""
    clock, found = ClockOffset(), []
    for now, offset, right in zip(TIMES, measured, true, strict=True):
        clock.measure(now, offset)
        found.append(clock.value_s - right)
    return np.array(found)


def test_scatter_of_the_measurements_is_smoothed():
    rng = np.random.default_rng(2)
    true = np.full(200, 7.0)
    found = errors(true + rng.normal(0, 1e-4, 200), true)
    assert np.abs(found[5:]).max() < 2e-4
    assert np.std(found[5:]) < 6e-5


def test_a_clock_that_drifts_is_followed_by_a_fraction_of_a_millisecond():
    """By 50 ppm, more than that of an ordinary computer."""
    true = 5 + 5e-5 * (TIMES - 1000)
    assert np.abs(errors(true, true)).max() < 3.5e-4


def test_single_wrong_measurements_have_no_effect():
    true = np.full(200, -3.0)
    wrong = true.copy()
    wrong[[40, 90, 91]] += 5e-3
    wrong[[60, 70]] += 0.05
    assert np.abs(errors(wrong, true)).max() < 1e-9


def test_a_clock_that_was_set_anew_is_followed_from_the_third_measurement():
    true = np.where(np.arange(200) < 100, 1.0, 3.0)
    assert np.flatnonzero(np.abs(errors(true, true)) > 1e-9).tolist() == [100, 101]
