"""The filter that runs sample by sample is the one that filters whole recordings in real time."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.signals.filtering import butterworth
from hbm.signals.realtime_filter import RealtimeFilter


def stepped(signal, time, cutoff_hz):
    running = RealtimeFilter(cutoff_hz, signal.shape[1])
    states = []
    for t, x in zip(time, signal, strict=True):
        running.step(t, x)
        states.append((running.value, running.velocity, running.acceleration))
    return [np.array([state[k] for state in states]) for k in range(3)]


def assert_same(signal, time, cutoff_hz):
    whole = butterworth(signal, time, cutoff_hz, "realtime")
    scale = np.nanmax(np.abs(signal))
    for found, expected, unit in zip(
        stepped(signal, time, cutoff_hz),
        (whole.value, whole.velocity, whole.acceleration),
        (1, 10 * cutoff_hz, (10 * cutoff_hz) ** 2),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale * unit)


@given(st.integers(0, 1000), st.floats(1, 20))
@settings(deadline=None)
def test_equal_steps(seed, cutoff_hz):
    signal = 100 + np.random.default_rng(seed).normal(size=(200, 3))
    assert_same(signal, np.arange(200) / 100, cutoff_hz)


@given(st.integers(0, 1000))
@settings(deadline=None)
def test_steps_that_jitter(seed):
    random = np.random.default_rng(seed)
    time = 1e5 + np.cumsum(random.uniform(0.007, 0.013, 200))
    assert_same(random.normal(size=(200, 2)), time, 6.0)


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 2)), max_size=30))
@settings(deadline=None)
def test_gaps_of_any_column_even_around_a_single_sample(missing):
    signal = np.random.default_rng(1).normal(size=(100, 3))
    for row, column in missing:
        signal[row, column] = np.nan
    assert_same(signal, np.arange(100) / 100, 6.0)


def test_frames_that_never_came_are_a_gap_where_they_are_more_than_four():
    signal = np.random.default_rng(2).normal(size=(100, 2))
    for lost, restarts in ((3, False), (4, True)):
        kept = np.r_[:50, 50 + lost : 100]
        time = kept / 100
        assert_same(signal[kept], time, 6.0)
        after = butterworth(signal[kept], time, 6.0, "realtime").velocity[50]
        assert (after == 0).all() == restarts
