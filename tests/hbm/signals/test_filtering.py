"""The low-pass is exact at its cut-off, keeps gaps, and gives the same sample by sample."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline
from scipy.signal import bilinear, butter, lfilter, lfilter_zi, sosfiltfilt

from hbm.signals.filtering import (
    LowPassMethod,
    Method,
    RealtimeFilter,
    butterworth,
    low_pass,
    spline_derivatives,
)
from hbm.signals.resampling import interpolate, resample

METHODS = get_args(Method)
LOW_PASS_METHODS = get_args(LowPassMethod)
time = np.arange(1000) / 100
middle = slice(200, -200)  # away from the ends, where a filter has to guess what came next


def walk_like(shape=(), seed=1):
    return np.random.default_rng(seed).normal(size=(1000, *shape)).cumsum(axis=0)


def amplitude(signal, frequency_hz):
    """Amplitude of one frequency in the middle of a signal, by least squares."""
    phase = 2 * np.pi * frequency_hz * time[middle]
    basis = np.column_stack([np.cos(phase), np.sin(phase)])
    return np.hypot(*np.linalg.lstsq(basis, signal[middle])[0])


def test_realtime_value_is_tustins_rule_applied_to_the_analog_filter():
    omega = 2 * np.pi * 6
    b, a = bilinear([omega**2], [1, np.sqrt(2) * omega, omega**2], fs=100)
    signal = walk_like()
    expected, _ = lfilter(b, a, signal, zi=lfilter_zi(b, a) * signal[0])
    np.testing.assert_allclose(
        butterworth(signal, 100, 6, "realtime").value, expected, rtol=0, atol=1e-11
    )


def test_realtime_obeys_the_mid_point_rule_sample_by_sample():
    signal, h, omega = walk_like(), 0.01, 2 * np.pi * 6
    filtered = butterworth(signal, time, 6, "realtime")
    y, v, a = filtered.value, filtered.velocity, filtered.acceleration
    mean = lambda x: (x[1:] + x[:-1]) / 2  # noqa: E731
    np.testing.assert_allclose(np.diff(y) / h, mean(v), rtol=0, atol=1e-9)
    forces = omega**2 * (mean(signal) - mean(y)) - np.sqrt(2) * omega * mean(v)
    np.testing.assert_allclose(a[1:], forces, rtol=0, atol=1e-8)
    np.testing.assert_array_equal([y[0], v[0], a[0]], [signal[0], 0, 0])


def test_realtime_hardly_depends_on_varying_time_steps():
    even = np.arange(10000) / 1000
    uneven = even + np.random.default_rng(0).uniform(-4e-4, 4e-4, len(even))
    filtered = [butterworth(np.sin(2 * np.pi * t), t, 6, "realtime").value for t in (even, uneven)]
    settled = slice(1000, -1)  # they start from different first samples
    np.testing.assert_allclose(
        filtered[1][settled], np.interp(uneven, even, filtered[0])[settled], rtol=0, atol=1e-5
    )


def test_realtime_delay_at_rest_is_37_5_ms_at_6_hz():
    ramp = butterworth(2 * time, time, 6, "realtime")
    assert (2 * time - ramp.value)[-1] / 2 == pytest.approx(np.sqrt(2) / (2 * np.pi * 6), rel=1e-6)
    assert np.sqrt(2) / (2 * np.pi * 6) == pytest.approx(0.0375, abs=5e-5)
    assert ramp.velocity[-1] == pytest.approx(2)


@pytest.mark.parametrize("frequency_hz", [0.5, 2, 6])
def test_zero_phase_derivatives_are_those_of_the_filtered_sine(frequency_hz):
    phase, omega = 2 * np.pi * frequency_hz * time + 0.3, 2 * np.pi * frequency_hz
    filtered = butterworth(np.sin(phase), time, 6, "zero_phase")
    warped = np.tan(omega / 200) / np.tan(np.pi * 6 / 100)  # the gain the design promises
    gain = 1 / (1 + (np.sqrt(2) - 1) * warped**4)
    np.testing.assert_allclose(filtered.value[middle], gain * np.sin(phase)[middle], atol=1e-9)
    np.testing.assert_allclose(
        filtered.velocity[middle], gain * omega * np.cos(phase)[middle], atol=1e-6 * gain * omega
    )
    np.testing.assert_allclose(
        filtered.acceleration[middle],
        -gain * omega**2 * np.sin(phase)[middle],
        atol=4e-5 * gain * omega**2,
    )


def test_zero_phase_is_the_same_in_both_directions_of_time():
    signal = walk_like()
    there = butterworth(signal, time, 6, "zero_phase")
    back = butterworth(signal[::-1], time, 6, "zero_phase")
    np.testing.assert_allclose(back.value[::-1][middle], there.value[middle], atol=1e-9)
    np.testing.assert_allclose(-back.velocity[::-1][middle], there.velocity[middle], atol=1e-7)


@pytest.mark.parametrize("length", [17, 1000])
def test_zero_phase_leaves_a_straight_line_straight_to_its_ends(length):
    line = butterworth(3 + 2 * time[:length], 100, 6, "zero_phase")
    np.testing.assert_allclose(line.value, 3 + 2 * time[:length], atol=1e-9)
    np.testing.assert_allclose(line.velocity, 2, atol=1e-7)
    np.testing.assert_allclose(line.acceleration, 0, atol=1e-5)


@settings(max_examples=15)
@given(gain=st.floats(-100, 100), offset=st.floats(-1e3, 1e3), method=st.sampled_from(METHODS))
def test_filter_is_linear_and_passes_offsets(gain, offset, method):
    signal = walk_like()
    plain = butterworth(signal, time, 6, method)
    changed = butterworth(gain * signal + offset, time, 6, method)
    np.testing.assert_allclose(changed.value, gain * plain.value + offset, atol=1e-8)
    np.testing.assert_allclose(changed.velocity, gain * plain.velocity, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_gap_splits_the_signal_and_does_not_spread(method):
    signal = walk_like((3,))
    signal[400:450, 1] = np.nan
    filtered = butterworth(signal, time, 6, method)
    for name in ("value", "velocity", "acceleration"):
        result = getattr(filtered, name)
        np.testing.assert_array_equal(np.isnan(result), np.isnan(signal))
        for rows in (slice(0, 400), slice(450, None)):
            alone = getattr(butterworth(signal[rows, 1], time[rows], 6, method), name)
            np.testing.assert_allclose(result[rows, 1], alone, atol=1e-6)


def test_a_block_shorter_than_one_period_of_the_cutoff_becomes_a_gap():
    signal = walk_like()
    for stop in (300, 320, 400, 421):  # 16 samples between the first two gaps of 40 ms: too few
        signal[stop - 4 : stop] = np.nan  # 17 then
    filtered = butterworth(signal, time, 6, "zero_phase").value
    assert np.isnan(filtered[296:320]).all()
    assert np.isfinite(filtered[400:417]).all()


@pytest.mark.parametrize(("method", "error"), [("zero_phase", 1e-3), ("realtime", 0.02)])
@pytest.mark.parametrize(("lost", "bridged"), [(1, True), (3, True), (4, False)])
def test_lost_samples_are_bridged_within_a_quarter_of_the_cutoffs_period(
    method, error, lost, bridged
):
    """Of a motion of 2 Hz, in parts of the amplitude of value, velocity and acceleration."""
    signal = np.sin(4 * np.pi * time)
    holed = signal.copy()
    for start in range(100, 900, 50):
        holed[start : start + lost] = np.nan
    found, whole = (butterworth(x, time, 6, method) for x in (holed, signal))
    for order, name in enumerate(("value", "velocity", "acceleration")):
        ours, true = getattr(found, name), getattr(whole, name)
        assert np.isfinite(ours).all() == bridged
        if bridged:
            known = np.isfinite(holed)
            assert np.abs(ours - true)[known].max() < error * lost**2 * (4 * np.pi) ** order


@pytest.mark.parametrize(
    ("signal", "times", "cutoff_hz", "method", "message"),
    [
        (np.zeros(16), 100, 6, "zero_phase", "17 samples at 100 Hz, got 16"),
        (np.zeros(100), 100, 50, "realtime", r"50 Hz.*, got 50"),
        # a clock of 100 Hz of which rounding makes 100.0000000001 Hz
        (np.zeros(9), np.arange(9) * 0.00999999999999, 50, "realtime", r"half the sampling rate"),
        (np.zeros(100), np.arange(100.0) ** 1.01, 0.1, "zero_phase", "equal time steps"),
    ],
)
def test_impossible_input_is_refused_with_the_reason(signal, times, cutoff_hz, method, message):
    with pytest.raises(ValueError, match=message):
        butterworth(signal, times, cutoff_hz, method)


def amplitude_left(frequency_hz, rate_hz, cutoff_hz, method):
    """Measure what a filter leaves of a sine of amplitude 1, away from the ends."""
    seconds = np.arange(0, 60, 1 / rate_hz)
    phase = 2 * np.pi * frequency_hz * seconds
    passed = low_pass(np.sin(phase), rate_hz, cutoff_hz, method)
    settled = (seconds > 5) & (seconds < 55)
    waves = np.column_stack([np.cos(phase), np.sin(phase)])
    return np.hypot(*np.linalg.lstsq(waves[settled], passed[settled])[0])


@pytest.mark.parametrize("rate_hz", [100, 1000])
@pytest.mark.parametrize("cutoff_hz", [3, 6, 20])
def test_at_the_cutoff_zero_phase_leaves_0_707_and_the_double_pass_half(cutoff_hz, rate_hz):
    left = {m: amplitude_left(cutoff_hz, rate_hz, cutoff_hz, m) for m in LOW_PASS_METHODS}
    assert left["zero_phase"] == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert left["double_pass"] == pytest.approx(0.5, rel=1e-6)
    assert left["realtime"] < np.sqrt(0.5)


@pytest.mark.parametrize(
    ("rate_hz", "cutoff_hz", "half_power_hz"), [(100, 6, 5.930), (1000, 10, 9.9967)]
)
def test_realtime_reaches_minus_3_db_below_its_cutoff_where_the_documentation_says(
    rate_hz, cutoff_hz, half_power_hz
):
    measured = amplitude_left(half_power_hz, rate_hz, cutoff_hz, "realtime")
    assert measured == pytest.approx(np.sqrt(0.5), rel=1e-4)


def test_the_double_pass_is_matlabs_filtfilt_of_a_second_order_butterworth():
    signal = walk_like((2,))
    expected = sosfiltfilt(butter(2, 6, fs=100, output="sos"), signal, axis=0)
    passed = low_pass(signal, 100, 6, "double_pass")
    np.testing.assert_allclose(passed[middle], expected[middle], atol=1e-9)


plate_time = np.arange(10000) / 1000


@pytest.mark.parametrize("frequency_hz", [0.3, 5, 40])
def test_resampling_from_1000_to_100_hz_keeps_phase_and_amplitude_of_slow_signals(frequency_hz):
    sine = lambda t: np.sin(2 * np.pi * frequency_hz * t + 0.4)  # noqa: E731
    resampled = resample(plate_time, sine(plate_time), time)
    np.testing.assert_allclose(resampled[20:-20], sine(time)[20:-20], atol=2e-4)


@pytest.mark.parametrize("frequency_hz", [60, 101, 230])
def test_resampling_does_not_alias_into_the_band(frequency_hz):
    hum = np.sin(2 * np.pi * frequency_hz * plate_time)
    assert abs(resample(plate_time, hum, time)[20:-20]).max() < 2e-4  # −80 dB and interpolation


@pytest.mark.parametrize("rate_hz", [100, 125, 200])
@pytest.mark.parametrize("start_s", [-0.3, 0.0, 0.004])
def test_a_value_at_a_sample_does_not_depend_on_which_others_are_wanted(rate_hz, start_s):
    """Wanted times at samples take another way than those between them."""
    rng = np.random.default_rng(rate_hz)
    noise = rng.normal(size=(10000, 3))
    noise[rng.integers(1000, 9000), 1] = noise[:77, 2] = np.nan
    wanted = start_s + np.arange(9 * rate_hz) / rate_hz
    at_samples = resample(plate_time, noise, wanted)
    between = wanted.copy()
    between[1:-1:2] += 3e-7
    np.testing.assert_allclose(
        resample(plate_time, noise, between)[::2], at_samples[::2], atol=1e-9
    )
    delayed = resample(plate_time, noise, wanted - 0.002, delay_s=0.002)
    np.testing.assert_allclose(delayed, at_samples, atol=1e-9)


def test_resampling_removes_a_known_delay():
    force = lambda t: np.sin(2 * np.pi * 1.3 * t)  # noqa: E731
    late = force(plate_time - 0.0071)
    prompt = resample(plate_time, late, time, delay_s=0.0071)
    np.testing.assert_allclose(prompt[20:-20], force(time)[20:-20], atol=1e-4)
    assert np.isnan(prompt[-1]) == (time[-1] + 0.0071 > plate_time[-1])


def test_resampling_never_extrapolates():
    line = resample(time, np.column_stack([time, 2 * time]), np.arange(-0.5, 11, 0.004))
    wanted = np.arange(-0.5, 11, 0.004)
    recorded = (wanted > -1e-9) & (wanted < time[-1] + 1e-9)
    np.testing.assert_array_equal(np.isfinite(line[:, 0]), recorded)
    np.testing.assert_allclose(line[recorded, 1], 2 * wanted[recorded], atol=1e-12)


def test_resampling_keeps_gaps():
    force = np.ones((10000, 6))
    force[4000:5000, 2] = np.nan
    resampled = resample(plate_time, force, time)
    np.testing.assert_array_equal(np.isnan(resampled[:, 2]), (time >= 4.0) & (time < 5.0))
    np.testing.assert_allclose(np.delete(resampled, 2, axis=1), 1, rtol=1e-9)


def test_interpolation_passes_cubics_in_any_order_and_shape_of_times():
    cubic = lambda t: 1 + t - t**2 + 0.1 * t**3  # noqa: E731
    at = np.array([[3.14159, 0.5], [9.99, 7.7], [2.5, 2.5]])
    values = np.stack([cubic(time), -cubic(time)], axis=-1)
    interpolated = interpolate(time, values, at)
    assert interpolated.shape == (3, 2, 2)
    np.testing.assert_allclose(interpolated[..., 1], -cubic(at), atol=1e-10)


def test_interpolation_does_not_bridge_gaps():
    values = np.ones(1000)
    values[[500, 503]] = np.nan  # between them two samples: too few for a cubic
    interpolated = interpolate(time, values, [4.99, 4.995, 5.0, 5.015, 5.035, 5.04])
    np.testing.assert_array_equal(np.isnan(interpolated), [0, 1, 1, 1, 1, 0])


def stepped(signal, time, cutoff_hz):
    running = RealtimeFilter(cutoff_hz, signal.shape[1], float(np.median(np.diff(time))))
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
        expected = np.where(np.isnan(signal), np.nan, expected)  # in real time not known yet
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale * unit)


@given(st.integers(0, 1000), st.floats(1, 20))
@settings(max_examples=30)
def test_steps_that_jitter(seed, cutoff_hz):
    random = np.random.default_rng(seed)
    time = 1e5 + np.cumsum(random.uniform(0.007, 0.013, 200))
    assert_same(random.normal(size=(200, 2)), time, cutoff_hz)


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 2)), max_size=30))
@settings(max_examples=30)
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


STEP = 0.01
INSIDE = slice(40, -40)
"""Where what is beyond the ends has fallen below rounding."""


def test_derivatives_are_those_of_the_spline_that_scipy_solves_for():
    time = STEP * np.arange(300)
    samples = np.random.default_rng(0).normal(size=(300, 4))
    spline = make_interp_spline(time, samples, k=5)
    for order, found in enumerate(spline_derivatives(samples, STEP), 1):
        expected = spline(time, order)
        error = np.abs(found - expected)[INSIDE].max()
        assert error < 1e-11 * np.abs(expected).max()
