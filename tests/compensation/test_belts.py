"""The pitch moment of accelerating belts is found where it is known and predicted in recordings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_smoothing_spline
from scipy.signal import butter, sosfiltfilt

from compensation.belts import (
    BeltModel,
    _best_numerator,
    belt_acceleration,
    fit_belt,
    spline_cutoff,
)
from hbm.signals.filtering import low_pass

THETA = np.array([-1.2, 0.52, 3.0, -3.1, 1.1])


def rms(values):
    return np.sqrt(np.mean(values**2))


def filtered(signal):
    """Filter as the published model was fitted: 6 Hz in real time, at 100 Hz."""
    return low_pass(signal, 100, 6, "realtime")


def filtered_acceleration(speed):
    return belt_acceleration(speed, 100, 6, "realtime")


def random_speed(seed, samples=6000):
    """Belt speed of about 2 ± 0.4 m/s at 100 Hz."""
    noise = np.random.default_rng(seed).normal(size=samples)
    band = butter(2, (0.3, 12), "band", fs=100, output="sos")
    speed = np.cumsum(sosfiltfilt(band, noise))
    return 2 + 0.4 * (speed - speed.mean()) / np.std(speed)


@pytest.fixture(scope="module")
def acceleration():
    return belt_acceleration(random_speed(1), 100, 10, "realtime")


def by_hand(theta, a):
    """The difference equation, term by term."""
    moment = np.zeros(len(a))
    for k in range(len(a)):
        for n in (1, 2):
            moment[k] -= theta[n - 1] * (moment[k - n] if k >= n else 0)
        for n in (0, 1, 2):
            moment[k] += theta[2 + n] * (a[k - n] if k >= n else 0)
    return moment


def test_prediction_is_the_published_difference_equation(acceleration):
    a = acceleration[:500]
    np.testing.assert_allclose(BeltModel(THETA).predict(a), by_hand(THETA, a), atol=1e-11)


@pytest.mark.parametrize("advance", [0, 2])
def test_sample_by_sample_is_the_whole_trial(acceleration, advance):
    model, moments = BeltModel(THETA, advance), []
    state = model.at_rest
    for a in acceleration:
        moment, state = model.step(float(a), state)
        moments.append(moment)
    late = np.array(moments)[100:]
    whole = model.predict(acceleration)
    np.testing.assert_allclose(late, whole[100 - advance : len(whole) - advance], atol=1e-9)


def test_a_known_model_comes_back_from_its_own_output(acceleration):
    model = fit_belt(acceleration, by_hand(THETA, acceleration))
    np.testing.assert_allclose(model.theta, THETA, rtol=1e-5)
    assert model.r_squared > 1 - 1e-9


def test_noise_on_the_moment_does_not_bias_the_free_running_fit(acceleration):
    clean = by_hand(THETA, acceleration)
    noise = np.random.default_rng(2).normal(size=len(clean)) * clean.std() / 3
    free = fit_belt(acceleration, clean + noise)
    assert rms(free.predict(acceleration) - clean) < 0.03 * rms(clean)
    assert free.rms_compensated == pytest.approx(rms(noise[100:]), rel=0.01)


def test_a_delayed_speed_is_undone_by_reading_ahead(acceleration):
    moment = by_hand(THETA, acceleration)
    late = np.concatenate([np.repeat(acceleration[:1], 2), acceleration[:-2]])
    model = fit_belt(late, moment, advance=2)
    np.testing.assert_allclose(model.theta, THETA, rtol=1e-5)
    assert rms((model.predict(late) - moment)[100:-100]) < 1e-5 * rms(moment)


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000))
def test_the_fit_is_stable_whatever_the_data(seed):
    rng = np.random.default_rng(seed)
    model = fit_belt(rng.normal(size=1000), rng.normal(size=1000).cumsum())
    assert np.max(np.abs(np.roots([1, *model.theta[:2]]))) < 1


def test_the_fit_is_no_worse_than_any_start_of_a_fine_grid(acceleration):
    rng = np.random.default_rng(5)
    moment = filtered(by_hand(THETA, acceleration) + 5 * rng.normal(size=len(acceleration)))
    a = filtered(acceleration)
    found = fit_belt(a, moment).rms_compensated
    grid = np.linspace(-0.9, 0.9, 13)
    costs = [_best_numerator(k1, k2, a, moment)[0] for k1 in grid for k2 in grid]
    assert found <= np.sqrt(min(costs) / (len(a) - 100)) * (1 + 1e-9)


def test_an_unstable_model_cannot_be_made():
    with pytest.raises(ValueError, match=r"unstable.* 1\.1"):
        BeltModel([-1.1, 0, 1, 0, 0])


# Real recordings: fit on one trial, score on the other ------------------------------------------


def even(recording):
    """A recording on even times: (moment, speed), 100 Hz."""
    time, *channels = recording.T
    return [np.interp(np.arange(len(time)) / 100, time, c) for c in channels]


def score(measured, predicted):
    """R² and RMS reduction in percent, without the first 99 and the last 100 samples."""
    y, e = measured[99:-100], (measured - predicted)[99:-100]
    return 1 - np.sum(e**2) / np.sum((y - y.mean()) ** 2), 100 * (1 - rms(e) / rms(y))


@pytest.fixture(scope="module")
def recordings(shared_data):
    folder = shared_data / "belt_acceleration"
    return [np.loadtxt(folder / f"RandomFastSpeed{n}.txt", skiprows=1) for n in (1, 2)]


def test_published_model_on_the_recorded_samples_reaches_the_published_numbers(recordings):
    signals = []
    for _, moment, speed in (r.T for r in recordings):
        two_point = np.diff(speed) * 100
        signals.append((filtered(two_point), filtered(moment[:-1])))
    model = fit_belt(*signals[0])
    a, moment = signals[1]
    r_squared, reduction = score(moment, model.predict(a))
    assert r_squared >= 0.9675
    assert round(reduction, 1) >= 82.0  # 81.98


@pytest.mark.parametrize(
    ("advance", "r_squared", "reduction"), [(0, 0.9675, 82.0), (2, 0.969, 82.35)]
)
def test_even_samples_and_reading_ahead_do_better(recordings, advance, r_squared, reduction):
    (moment_1, speed_1), (moment_2, speed_2) = map(even, recordings)
    model = fit_belt(filtered_acceleration(speed_1), filtered(moment_1), advance=advance)
    found = score(filtered(moment_2), model.predict(filtered_acceleration(speed_2)))
    assert found[0] >= r_squared
    assert found[1] >= reduction


# Cut-off ----------------------------------------------------------------------------------------


def test_the_cutoff_is_where_scipys_spline_halves_the_amplitude():
    rng, time = np.random.default_rng(0), np.arange(1201) / 100
    low = butter(4, 5, fs=100, output="sos")
    signal = sosfiltfilt(low, rng.normal(size=1201).cumsum() / 100)
    noisy = signal + 0.02 * rng.normal(size=1201)
    spline = make_smoothing_spline(time, noisy)
    # a smoothing spline's third derivative jumps by (x - f)/p at every knot
    jump = np.diff(spline.derivative(3)(time[:-1] + 0.005))
    error = (noisy - spline(time))[1:-1]
    p = abs(jump @ error / (jump @ jump))
    impulse = np.zeros(1201)
    impulse[600] = 1
    passed = make_smoothing_spline(time, impulse, lam=p)
    response = np.abs(np.fft.rfft(passed(time)))
    half = np.interp(spline_cutoff(noisy, 100), np.fft.rfftfreq(1201, 0.01), response)
    assert half == pytest.approx(0.5, abs=5e-3)


def test_cutoff_of_the_real_belt_speed_is_about_ten_hertz(recordings):
    for _, _, speed in (r.T for r in recordings):
        assert 8 < spline_cutoff(speed, 100) < 14


# Wrong input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda a, m: (a[:300], m[:300]), "300 samples"),
        (lambda a, m: (a, m[::2]), "belt_acceleration 6000, pitch_moment 3000; .* different rates"),
        (lambda a, m: (a, 1000 * m), "in N·m"),
    ],
)
def test_wrong_calibration_input_gets_one_clear_error(acceleration, spoil, message):
    with pytest.raises(ValueError, match=message):
        fit_belt(*spoil(acceleration, by_hand(THETA, acceleration)))
