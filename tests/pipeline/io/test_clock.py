"""The frames of samples are found, whatever came twice, late, swapped or on another clock."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
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


@pytest.mark.parametrize("seed", range(8))
def test_a_rate_that_is_just_near_the_stated_one_hides_no_loss(seed):
    rng = np.random.default_rng(seed)
    frames = np.flatnonzero(np.append(True, rng.random(2999) >= 0.01))
    stamps = 5000 + (frames + rng.uniform(-0.19, 0.19, len(frames))) / 101.9
    np.testing.assert_array_equal(find_clock(stamps, 100.0).index, frames)


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


@pytest.mark.parametrize("burst", [2, 12])
def test_a_few_bursts_with_one_stamp_lose_no_sample(burst):
    stamps = 1000 + np.arange(1300) / 100
    for begin in (100, 400, 1100):
        stamps[begin : begin + burst] = stamps[begin + burst - 1]
    clock = find_clock(stamps, 100.0)
    np.testing.assert_array_equal(clock.index, np.arange(1300))
    assert not clock.facts


@pytest.mark.parametrize("burst", [1, 2])
def test_a_rate_that_is_not_stated_is_found(burst):
    stamps = np.ceil((np.arange(4000) + 1) / burst) * burst / 2000
    assert find_clock(stamps, 0.0).rate_hz == pytest.approx(2000, rel=1e-3)


@pytest.mark.parametrize("by_s", [-8.0, -0.05, 0.3, 8.0])
def test_a_sample_whose_stamp_is_out_of_order_is_a_gap_whose_place_is_said(by_s):
    stamps = 5000 + np.arange(1000) / 100
    stamps[500] += by_s
    clock = find_clock(stamps, 100.0)
    np.testing.assert_array_equal(clock.index, np.delete(np.arange(1000), 500))
    off = f"1 of 1000 samples, 5.00 to 5.00 s, with time stamps {by_s:+g} s off"
    assert off in [fact.reason for fact in clock.facts]
    assert clock.rate_hz == pytest.approx(100, rel=1e-9)


def test_another_sample_at_the_same_time_moves_no_frame():
    """As of a sender that corrects a sample."""
    frames = np.insert(np.arange(1000), 500, 499)
    clock = find_clock(5000 + frames / 100, 100.0)
    np.testing.assert_array_equal(clock.index, frames[clock.samples])
    (fact,) = clock.facts
    assert fact.kind == "left_out"
    assert re.match(r"1 of 1001 .*4\.99 to 4\.99 s", fact.reason)


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


def kinds(clock):
    return [fact.kind for fact in clock.facts]


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    nominal=st.sampled_from([60.0, 100.0, 1000.0]),
    jitter=st.floats(0, 0.15),
    twice=st.sampled_from([0.0, 0.002, 0.1, 0.5]),
    apart=st.sampled_from([0.0, 0.05]),
    again=st.tuples(st.integers(300, 500), st.integers(0, 200)),
    swapped=st.sampled_from([0.0, 0.01, 0.1]),
    late=st.sampled_from([0.0, 0.01, 0.03]),
    still=st.booleans(),
)
def test_what_came_twice_late_or_swapped_moves_no_sample(
    seed, nominal, jitter, twice, apart, again, swapped, late, still
):
    """Every sample is at its frame, at the rate of the sender, and all are counted.

    Where copies have time stamps of their own and are late too, one in a hundred may be misplaced.
    """
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(1500, 3))
    if still:  # such as a plate that nobody stands on
        values[np.arange(1500) // 100 % 2 == 0] = 0
    stamps = 5000 + (np.arange(1500) + rng.uniform(0, jitter, 1500)) / nominal
    sent = np.repeat(np.arange(1500), 1 + (rng.random(1500) < twice))
    repeated = np.append(False, np.diff(sent) == 0)
    begin = np.searchsorted(sent, again[0] - again[1])
    end = np.searchsorted(sent, again[0])
    order = np.r_[:end, begin : len(sent)]  # a block comes again
    behind = np.where(rng.random(len(order)) < late, rng.integers(2, 25, len(order)) + 0.5, 0)
    behind += 1.5 * (rng.random(len(order)) < swapped)
    order = order[np.argsort(np.arange(len(order)) + behind, kind="stable")]
    came = stamps[sent] + repeated * apart / nominal
    clock = find_clock(came[order], nominal, values[sent[order]])
    right = np.mean(
        np.isin(np.arange(1500), clock.index[sent[order][clock.samples] == clock.index])
    )
    assert right >= (0.99 if apart and (swapped or late) else 1.0)
    assert clock.rate_hz == pytest.approx(nominal, rel=1e-4)
    assert ("joined" in kinds(clock)) == (len(order) > 1500)
    assert apart or set(kinds(clock)) <= {"joined", "corrected"}


@given(
    at=st.integers(0, 1300),
    count=st.integers(5, 200),
    by_s=st.sampled_from([-86400.0, -3600.0, -7.3, 7.3, 3600.0, 86400.0]),
    jitter=st.floats(0, 0.2),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_block_on_another_clock_is_a_gap_whose_place_is_said(at, count, by_s, jitter, seed):
    assume(abs(by_s) > 15 or count < at < 1500 - 2 * count)  # else it may be a pause
    rng = np.random.default_rng(seed)
    stamps = 1e6 + (np.arange(1500) + rng.uniform(0, jitter, 1500)) / 100
    stamps[at : at + count] += by_s
    clock = find_clock(stamps, 100.0, rng.normal(size=(1500, 3)))
    right = np.delete(np.arange(1500), slice(at, at + count))
    np.testing.assert_array_equal(clock.samples, right)
    np.testing.assert_array_equal(clock.index, right - right[0])
    said = next(fact.reason for fact in clock.facts if fact.kind == "left_out")
    assert said.startswith(f"{count} of 1500 samples, ")
    place = [float(said.split()[k]) for k in (4, 6)]
    place_s = (np.array([at, at + count - 1]) - right[0]) / 100
    np.testing.assert_allclose(place, place_s, atol=0.02)


@given(rate_hz=st.floats(50, 200), jitter=st.floats(0, 0.2), seed=st.integers(0, 2**32 - 1))
def test_a_rate_that_contradicts_the_stated_one_is_in_doubt(rate_hz, jitter, seed):
    rng = np.random.default_rng(seed)
    clock = find_clock((np.arange(2000) + rng.uniform(0, jitter, 2000)) / rate_hz, 100.0)
    differs = abs(rate_hz / 100 - 1)
    if abs(differs - 0.02) > 1e-3:
        assert ("in_doubt" in kinds(clock)) == (differs > 0.02)


@given(
    jitter=st.floats(0, 1),
    burst=st.sampled_from([1, 2, 20]),
    kept=st.sampled_from([0.9, 1.0]),
    still=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_nothing_is_said_of_samples_that_came_in_order(jitter, burst, kept, still, seed):
    """Stamps that jitter, come in bursts with one stamp, or lack samples accuse no sample."""
    rng = np.random.default_rng(seed)
    frames = np.flatnonzero(rng.random(3000) < kept)
    late = np.maximum.accumulate(frames + rng.uniform(0, jitter, len(frames)))
    stamps = 7 + np.repeat(late[burst - 1 :: burst], burst) / 100
    values = np.zeros((3000, 2)) if still else rng.normal(size=(3000, 2))
    clock = find_clock(stamps, 100.0, values[: len(stamps)])
    np.testing.assert_array_equal(clock.samples, np.arange(len(stamps)))
    assert set(kinds(clock)) <= {"missing"}


@pytest.mark.parametrize(
    "stamps",
    [
        np.random.default_rng(0).uniform(0, 1e6, 500),
        5000 + np.arange(500) / 100 - 3600 * (np.arange(500) >= 250),
    ],
    ids=["any", "set once"],
)
def test_time_stamps_half_of_which_contradict_the_others_are_no_clock(stamps):
    with pytest.raises(ValueError, match="contradict the others"):
        find_clock(stamps, 100.0)


@given(
    stamps=st.lists(st.integers(0, 40) | st.floats(-1e6, 1e6), min_size=2, max_size=60),
    step_s=st.sampled_from([1.0, 0.01]),
    nominal=st.sampled_from([0.0, 1.0, 100.0, 1e5]),
    held=st.integers(1, 3),
)
def test_any_time_stamps_are_a_clock_or_refused(stamps, step_s, nominal, held):
    values = np.arange(len(stamps))[:, None] // held * 1.0
    try:
        clock = find_clock(step_s * np.array(stamps), nominal, values)
    except ValueError:
        return
    assert len(clock.index) == len(clock.samples) == len(np.unique(clock.samples))
    assert (np.diff(clock.index) > 0).all()
    assert clock.rate_hz > 0
