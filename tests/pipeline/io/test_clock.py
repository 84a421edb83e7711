"""The frames of samples are found from time stamps that scatter, drift and have gaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.io.streams import find_clock


@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    nominal=st.sampled_from([60.0, 100.0, 300.0, 1000.0]),
    drift=st.floats(-1e-3, 1e-3),
    lost=st.lists(st.tuples(st.integers(30, 1990), st.integers(1, 40)), max_size=5),
)
def test_every_sample_is_its_frame_whatever_delay_drift_and_loss(seed, nominal, drift, lost):
    rng = np.random.default_rng(seed)
    gone = {at + k for at, count in lost for k in range(count)}
    frames = np.array([k for k in range(2000) if k not in gone])
    late = np.abs(rng.normal(0, 0.1, len(frames)))
    stamps = 12345.6 + (frames + late) / (nominal * (1 + drift))
    clock = find_clock(stamps, nominal)
    np.testing.assert_array_equal(clock.index, frames)
    assert clock.rate_hz == pytest.approx(nominal * (1 + drift), rel=1e-4)


@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.floats(80, 120),
    jitter=st.floats(0, 0.2),
    lost=st.floats(0, 0.2),
)
def test_rate_and_losses_are_told_apart_whatever_the_stated_rate(seed, rate_hz, jitter, lost):
    rng = np.random.default_rng(seed)
    frames = np.flatnonzero(np.append(True, rng.random(2999) >= lost))
    stamps = 5000 + (frames + rng.uniform(-jitter, jitter, len(frames))) / rate_hz
    clock = find_clock(stamps, 100.0)
    np.testing.assert_array_equal(clock.index, frames)
    assert clock.rate_hz == pytest.approx(rate_hz, rel=1e-4)


@pytest.mark.parametrize("jitter", [0.5, 1.0])
@pytest.mark.parametrize("lost", [0.0, 0.01, 0.1])
def test_at_the_stated_rate_losses_are_found_under_jitter_of_frames(jitter, lost):
    rng = np.random.default_rng(1)
    frames = np.flatnonzero(np.append(True, rng.random(2999) >= lost))
    stamps = 5000 + (frames + rng.uniform(-jitter, jitter, len(frames))) / 100
    clock = find_clock(stamps, 100.0)
    assert clock.frames == pytest.approx(frames[-1] + 1, abs=2)
    assert clock.rate_hz == pytest.approx(100, rel=1e-3)


def test_samples_that_arrive_in_bursts_are_frames_in_a_row():
    """Sent twenty at a time, all stamped when they are sent."""
    stamps = np.ceil((np.arange(1000) + 1) / 20) * 0.2
    clock = find_clock(stamps, 100.0)
    np.testing.assert_array_equal(clock.index, np.arange(1000))
    assert clock.rate_hz == pytest.approx(100, rel=1e-3)


@pytest.mark.parametrize("by_s", [-8.0, -0.05, 0.3, 8.0])
def test_a_single_stamp_out_of_order_moves_no_frame(by_s):
    stamps = 5000 + np.arange(1000) / 100
    stamps[500] += by_s
    clock = find_clock(stamps, 100.0)
    np.testing.assert_array_equal(clock.index, np.arange(1000))
    assert clock.rate_hz == pytest.approx(100, rel=1e-9)


def test_a_rate_that_is_not_the_nominal_one_is_found():
    clock = find_clock(np.arange(500) / 128, 100.0)
    np.testing.assert_array_equal(clock.index, np.arange(500))
    assert clock.rate_hz == pytest.approx(128)


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (np.zeros(10), "do not advance"),
        (-np.arange(10.0), "do not advance"),
        (np.concatenate([np.arange(10), 500 + np.arange(10)]) / 100, "span 510 frames"),
    ],
)
def test_stamps_that_are_no_clock_are_refused(stamps, message):
    with pytest.raises(ValueError, match=message):
        find_clock(stamps, 100.0)
