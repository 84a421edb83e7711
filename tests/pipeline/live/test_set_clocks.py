"""Which time stamps are those of a clock that was set, and which are wrong or of samples lost."""

import numpy as np
import pytest

from pipeline.live.stream import Arrivals, Samples, StreamDescription

RATE_HZ = 100.0


def arrivals(*rates_hz):
    """Streams named by their numbers."""
    named = enumerate(rates_hz)
    return Arrivals([StreamDescription(str(k), "markers", ("A",), ("m",), hz) for k, hz in named])


def taken(clocks, stamps, arrived_s, stream=0):
    """Times of samples as they count."""
    values = np.arange(3.0 * len(stamps)).reshape(-1, 3) + stamps[0]
    return clocks.take(Samples(str(stream), np.array(stamps), values), arrived_s).time


def every(count, first_s=0.0, rate_hz=RATE_HZ):
    return first_s + np.arange(count) / rate_hz


def test_a_clock_that_is_set_forward_leaves_no_gap():
    clocks = arrivals(RATE_HZ)
    taken(clocks, every(20), 0.2)
    after = taken(clocks, every(20, 0.2 + 1.5), 0.4)
    np.testing.assert_allclose(after, every(20, 0.2), atol=1e-9)


def test_samples_that_are_lost_within_a_chunk_are_a_gap_and_no_set_clock():
    clocks = arrivals(RATE_HZ)
    taken(clocks, every(20), 0.2)
    stamps = np.concatenate([every(5, 0.2), every(20, 0.2 + 0.8)])
    np.testing.assert_allclose(taken(clocks, stamps, 0.25), stamps, atol=1e-9)


@pytest.mark.parametrize(("rate_hz", "wrong"), [(100.0, 4), (20.0, 2)])
def test_a_few_wrong_time_stamps_that_follow_one_another_set_no_clock(rate_hz, wrong):
    clocks = arrivals(rate_hz)
    taken(clocks, every(20, 0.0, rate_hz), 20 / rate_hz)
    stamps = np.concatenate(
        [every(wrong, -50.0, rate_hz), every(20, (20 + wrong) / rate_hz, rate_hz)]
    )
    after = taken(clocks, stamps, (40 + wrong) / rate_hz)
    np.testing.assert_allclose(after, stamps[wrong:], atol=1e-9)


@pytest.mark.parametrize(("rate_hz", "came"), [(100.0, 8), (20.0, 4)])
def test_after_a_clock_was_set_samples_count_within_a_tenth_or_a_fifth_of_a_second(rate_hz, came):
    clocks = arrivals(rate_hz)
    taken(clocks, every(20, 0.0, rate_hz), 20 / rate_hz)
    after = taken(clocks, every(came, -50.0, rate_hz), (20 + came) / rate_hz)
    np.testing.assert_allclose(after, every(came, 20 / rate_hz, rate_hz), atol=1e-9)


@pytest.mark.parametrize(("apart_s", "together"), [(0.03, True), (0.08, False)])
def test_streams_that_are_set_by_about_the_same_are_set_together(apart_s, together):
    clocks = arrivals(RATE_HZ, RATE_HZ)
    for stream in (0, 1):
        taken(clocks, every(20), 0.2, stream)
    taken(clocks, every(20, 0.2 - 50.0), 0.4, 0)
    after = taken(clocks, every(20, 0.2 - 50.0 + apart_s), 0.4, 1)
    np.testing.assert_allclose(after, every(20, 0.2 + apart_s * together), atol=1e-9)
