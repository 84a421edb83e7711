"""Cubic convolution reproduces what it can, and knows nothing where there are no samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.signals.resampling import Convolution

MARKERS_HZ = 100.0


def at_frames(rate_hz, signal, time=None):
    """Resample a function of time to frames at 100 Hz, away from the ends."""
    time = np.arange(0, 2, 1 / rate_hz) if time is None else time
    frames = np.arange(0.5, 1.5, 1 / MARKERS_HZ)
    values = Convolution.between(rate_hz, MARKERS_HZ).evaluate(time, signal(time)[:, None], frames)
    return frames, values[:, 0]


def wave(frequency_hz):
    return lambda t: np.sin(2 * np.pi * frequency_hz * t + 0.3)


@pytest.mark.parametrize(("frequency_hz", "error"), [(2, 1e-5), (6, 3e-4), (10, 2e-3)])
@pytest.mark.parametrize("rate_hz", [1000, 2000])
def test_frequencies_of_gait_pass_without_delay(rate_hz, frequency_hz, error):
    frames, found = at_frames(rate_hz, wave(frequency_hz))
    np.testing.assert_allclose(found, wave(frequency_hz)(frames), atol=error)


@pytest.mark.parametrize("frequency_hz", [94, 106, 206, 297])
def test_what_would_alias_to_below_6_hz_is_65_db_down(frequency_hz):
    _, found = at_frames(1000, wave(frequency_hz))
    assert np.abs(found).max() < 10 ** (-65 / 20)


def test_samples_at_the_frames_of_an_equal_rate_are_unchanged():
    frames, found = at_frames(100, wave(7))
    np.testing.assert_allclose(found, wave(7)(frames), atol=1e-12)


@given(st.integers(0, 10_000), st.sampled_from([100.0, 300.0, 1000.0]))
@settings(max_examples=30)
def test_a_straight_line_passes_whatever_the_jitter_of_the_time_stamps(seed, rate_hz):
    time = np.arange(0, 2, 1 / rate_hz)
    time = time + np.random.default_rng(seed).uniform(-0.2, 0.2, len(time)) / rate_hz
    frames, found = at_frames(rate_hz, lambda t: 3 * t - 1, time)
    np.testing.assert_allclose(found, 3 * frames - 1, atol=1e-12)


@given(st.lists(st.floats(0.3, 1.7), min_size=1, max_size=20), st.integers(1, 400))
@settings(max_examples=30)
def test_later_samples_change_nothing_and_instants_do_not_depend_on_each_other(at, more):
    time = np.arange(0, 2, 0.001)
    values = np.random.default_rng(0).normal(size=(len(time), 3))
    resampling, at = Convolution.between(1000, 100), np.sort(at)
    whole = resampling.evaluate(time, values, at)
    for instant, expected in zip(at, whole, strict=True):
        last = np.searchsorted(time, instant + resampling.reach_s) + more
        alone = resampling.evaluate(time[:last], values[:last], np.array([instant]))
        np.testing.assert_allclose(alone[0], expected, rtol=0, atol=1e-13)


def test_a_gap_and_the_ends_of_a_recording_are_unknown_as_far_as_the_reach():
    time = np.arange(0, 1, 0.001)
    values = np.ones((len(time), 2))
    values[500, 0] = np.nan
    at = np.arange(0, 1, 0.001)
    found = Convolution.between(1000, 100).evaluate(time, values, at)
    known = np.isfinite(found)
    assert np.array_equal(np.flatnonzero(~known[100:900, 0]) + 100, np.arange(481, 520))
    assert np.flatnonzero(known[:, 1])[[0, -1]].tolist() == [18, 981]


def test_lost_samples_leave_a_gap_and_one_of_many_does_not():
    time = np.arange(0, 1, 0.001)
    few, many = np.delete(time, 500), np.delete(time, [500, 501])
    resampling, at = Convolution.between(1000, 100), np.array([0.5])
    assert resampling.evaluate(few, few[:, None], at)[0, 0] == pytest.approx(0.5, abs=1e-12)
    assert np.isnan(resampling.evaluate(many, many[:, None], at)[0, 0])
