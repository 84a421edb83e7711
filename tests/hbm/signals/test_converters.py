"""What converters do to the load of a foot is found and undone; no load is taken for it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hbm.signals.converters import find_jumps, find_limits, find_wraps
from hbm.signals.filtering import low_pass

RATE_HZ = 1000.0
TIME = np.arange(4000) / RATE_HZ
PEAK = 700.0


def steps(heights=(1.0, 0.94, 1.05), valley=0.35):
    """Steps with two humps each, of different heights."""
    load = np.zeros(len(TIME))
    for number, height in enumerate(heights):
        phase = np.clip((TIME - 0.4 - 1.2 * number) / 0.7, 0, 1)
        load += height * PEAK * (np.sin(np.pi * phase) + valley * np.sin(3 * np.pi * phase))
    return load


def with_noise(values, size, seed=1):
    return values + size * np.random.default_rng(seed).normal(size=len(values))


def in_steps(values, count):
    """As a converter with so many steps over 1.3 times the range gives it."""
    step = 2.6 * np.abs(values).max() / count
    return np.round(values / step) * step


def limits_of(channel, rate_hz=RATE_HZ):
    return [*find_limits(channel, 1 / rate_hz)]


@given(
    load=st.floats(200, 3000),
    noise=st.floats(0.01, 3.0),
    impact=st.floats(0.0, 1.0),
    rise_s=st.floats(0.004, 0.05),
)
def test_the_load_of_a_foot_with_any_impact_neither_jumps_nor_wraps(load, noise, impact, rise_s):
    since = np.clip(TIME - 0.5, 0.0, None)
    stance = np.where((TIME > 0.5) & (TIME < 1.2), np.sin(np.pi * (TIME - 0.5) / 0.7), 0.0)
    spike = impact * load * np.sin(np.pi * np.clip(since / rise_s, 0, 1)) ** 2
    measured = with_noise(load * stance + spike, noise)
    assert not len(find_jumps(measured, 20.0).at)
    assert find_wraps(measured, 1.0) is None


@given(
    share=st.floats(0.2, 0.9),
    noise=st.floats(0.0, 0.005),
    sign=st.sampled_from([-1.0, 1.0]),
    creep=st.floats(0.0, 0.03),
    first=st.integers(0, 1000),
)
def test_a_channel_that_overflows_is_undone_also_where_noise_crosses_its_limit_often(
    share, noise, sign, creep, first
):
    """The recording may begin with an unloaded plate, or during a step, behind which it creeps."""
    behind_s = TIME[:, None] - [1.1, 2.3, 3.5]
    creeps = np.where(behind_s > 0, np.exp(-np.abs(behind_s) / 0.1), 0.0).sum(axis=1)
    load = (sign * with_noise(steps() + creep * PEAK * creeps, noise * PEAK) + 1e-6)[first:]
    limit = share * np.abs(load).max()
    wraps = find_wraps((load + limit) % (2 * limit) - limit, 1.0)
    assert wraps.period == pytest.approx(2 * limit, rel=0.02)
    off = wraps.undone - load
    assert np.abs(off).max() < 0.05 * limit


def test_a_channel_that_slips_jumps_and_does_not_wrap():
    load = with_noise(steps(), 0.2) + 1e-6
    slipped = load + 150.0 * (TIME > 0.8)
    assert find_wraps(slipped, 1.0) is None
    jumps = find_jumps(slipped, 40.0)
    assert jumps.at.tolist() == [800]
    assert jumps.size[0] == pytest.approx(150.0, abs=15.0)


def test_samples_that_are_lost_neither_jump_nor_wrap():
    load = steps() + 1e-6
    load[800:803] = 0.0
    assert not len(find_jumps(load, 4.0).at)
    assert find_wraps(load, 1.0) is None


@given(
    valley=st.floats(0.0, 0.45),
    bits=st.integers(8, 24),
    noise=st.floats(0.0, 0.02),
    change=st.sampled_from(["none", "held", "joined", "rectified", "gated", "fewer", "filtered"]),
)
def test_round_peaks_are_not_clipped_however_a_file_holds_them(valley, bits, noise, change):
    load = with_noise(steps(valley=valley), noise * PEAK)
    rate_hz = RATE_HZ
    if change == "filtered":
        load = low_pass(load[:, None], TIME, 20.0, "zero_phase")[:, 0]
    load = in_steps(load, 2**bits)
    if change == "held":
        load, rate_hz = np.repeat(load, 10), 10 * RATE_HZ
    if change == "joined":
        load = np.interp(np.arange(0, len(load) - 1, 0.2), np.arange(len(load)), load)
        rate_hz = 5 * RATE_HZ
    if change == "rectified":
        load = np.maximum(load, 0.0)
    if change == "gated":
        load = np.where(load > 20.0, load, 0.0)
    if change == "fewer":
        load, rate_hz = load[::10], RATE_HZ / 10
    assert limits_of(load, rate_hz) == []


def stance(valley, ratio=1.0):
    """One stance of a second: two peaks of a ratio, and a valley between from 0.11 on."""
    phase = np.clip(TIME[:2000] - 0.5, 0, 1)
    load = np.sin(np.pi * phase) + valley * np.sin(3 * np.pi * phase)
    return PEAK * load * (1 + (ratio - 1) * (phase - 0.5))


@pytest.mark.parametrize("bits", range(8, 13))
def test_two_peaks_with_a_valley_of_some_steps_are_not_clipped(bits):
    for valley in np.arange(0.0, 0.301, 0.01):
        for ratio in (0.8, 0.99, 1.0):
            assert limits_of(in_steps(stance(valley, ratio), 2**bits)) == [], (valley, ratio)


@pytest.mark.parametrize("share", [0.6, 0.75])
def test_a_stance_that_a_coarse_converter_clips_is_found(share):
    for bits in range(8, 13):
        for valley in (0.0, 0.1, 0.15, 0.3):
            load = stance(valley)
            (found,) = limits_of(in_steps(np.minimum(load, share * load.max()), 2**bits))
            assert found.level == pytest.approx(share * load.max(), rel=0.01)


@given(seconds=st.floats(0.5, 3.4), sway=st.floats(0.003, 0.02), bits=st.integers(11, 24))
def test_who_steps_on_a_plate_and_stands_does_not_clip_it(seconds, sway, bits):
    onset = np.clip((TIME - 0.2) / 0.1, 0, 1) * np.clip((0.3 + seconds - TIME) / 0.1, 0, 1)
    standing = 1 + sway * np.sin(2 * np.pi * 1.1 * TIME) + sway * np.sin(2 * np.pi * 4.3 * TIME)
    assert limits_of(in_steps(with_noise(PEAK * onset * standing, 0.5), 2**bits)) == []


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@given(
    share=st.floats(0.5, 0.9),
    before=st.floats(0.0, 0.01),
    bits=st.integers(11, 24),
    offset=st.floats(-0.05, 0.05),
)
def test_a_clipped_channel_is_found_with_its_limit_and_its_samples(
    sign, share, before, bits, offset
):
    load = sign * with_noise(steps(), before * PEAK)
    limit = share * np.abs(load).max()
    measured = in_steps(np.clip(load, -limit, limit) + offset * PEAK, 2**bits)
    (found,) = limits_of(measured)
    assert found.level == pytest.approx(sign * limit + offset * PEAK, rel=0.01)
    lost = np.abs(load) > limit
    assert np.count_nonzero(found.at & lost) > 0.95 * np.count_nonzero(lost)
    assert np.count_nonzero(found.at & ~lost) < 0.1 * np.count_nonzero(lost)


def test_one_clipped_step_of_three_is_found():
    load = steps(heights=(0.8, 0.8, 1.0))
    (found,) = limits_of(np.minimum(load, 0.85 * load.max()))
    assert TIME[found.at].min() > 2.8


@pytest.mark.parametrize("share", [0.45, 0.6])
@given(noise=st.floats(0.0, 0.0015))
def test_a_limit_with_noise_on_it_is_found(share, noise):
    limit = share * PEAK
    (found,) = limits_of(with_noise(np.minimum(steps(), limit), noise * limit))
    assert found.level == pytest.approx(limit, rel=0.01)


@pytest.mark.parametrize("cutoff_hz", [50.0, 100.0])
def test_a_limit_with_corners_that_a_filter_rounded_is_found(cutoff_hz):
    measured = low_pass(np.minimum(steps(), 0.6 * PEAK)[:, None], TIME, cutoff_hz, "zero_phase")
    (found,) = limits_of(measured[:, 0])
    assert found.level == pytest.approx(0.6 * PEAK, rel=0.01)
