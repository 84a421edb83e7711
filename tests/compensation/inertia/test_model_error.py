"""The error that a model expects of itself is as large as what it truly leaves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, resample, sosfiltfilt

from compensation.inertia.choice import weigh_beside
from compensation.inertia.fit import fit_inertia, fit_trials
from compensation.inertia.model import Setup
from compensation.inertia.model_error import fit_model_error, zero_of_trials
from hbm.signals.filtering import low_pass

RATE_HZ = 100.0
SETUP = Setup(("only",), RATE_HZ, 20.0)
GAIN = np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])


def band(rng, low_hz, high_hz, shape):
    sos = butter(2, (low_hz, high_hz), "band", fs=RATE_HZ, output="sos")
    drawn = sosfiltfilt(sos, rng.normal(size=shape), axis=0)
    return drawn / drawn.std(axis=0)


def recording(seed, shaking=0.3, unseen=1.0, duration_s=120.0, zero=0.0):
    """Sway, and between 7 and 11 Hz vibration that goes with as much that nothing shows."""
    rng = np.random.default_rng(seed)
    shape = int(duration_s * RATE_HZ), 3
    often = np.repeat(rng.uniform(0, 2, (int(duration_s / 4) + 1, 1)), int(4 * RATE_HZ), axis=0)
    vibration = shaking * often[: shape[0]] * band(rng, 7, 11, shape)
    hidden = unseen * shaking * often[: shape[0]] * band(rng, 7, 11, (shape[0], 6))
    felt = band(rng, 0.3, 3, shape) + vibration + [0, 0, 9.81]
    noise = low_pass(rng.normal(size=(shape[0], 6)), RATE_HZ, 20.0, "zero_phase")
    return felt, felt @ GAIN + 20 * hidden + 0.5 * noise + zero


def covered(model, trial, slow=False):
    felt, wrench = trial
    left = model.compensate(felt, wrench)
    if slow:
        left = low_pass(left, RATE_HZ, 6.0, "zero_phase")
    sigma = model.uncertainty(felt, slow)
    return np.mean(np.abs(left) <= 1.96 * sigma), sigma, left


@pytest.fixture(scope="module")
def model():
    return fit_inertia(*recording(1), SETUP, zero_sd=0.0)


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("shaking", [0.1, 0.6])
def test_intervals_hold_however_much_the_platform_is_shaken(model, shaking, slow):
    share, sigma, left = covered(model, recording(2, shaking), slow)
    assert share == pytest.approx(0.95, abs=0.03)
    np.testing.assert_allclose(np.sqrt(np.mean(sigma**2)), np.sqrt(np.mean(left**2)), rtol=0.2)


def test_a_calm_trial_is_held_by_little_more_than_its_noise(model):
    """The calibration is hardly ever calm: what it leaves then is a hundredth of the rest."""
    share, sigma, left = covered(model, recording(2, 0.0))
    assert share > 0.93
    assert 1 < np.sqrt(np.mean(sigma**2) / np.mean(left**2)) < 1.5


def test_an_exact_model_has_no_error():
    felt, _ = recording(5)
    model = fit_inertia(felt, felt @ GAIN, SETUP, zero_sd=0.0)
    assert model.uncertainty(felt).max() < 1e-6


def test_where_readings_are_unknown_so_is_the_interval_and_around_a_gap_it_stays(model):
    felt, _ = recording(6)
    whole, holed = model.uncertainty(felt), felt.copy()
    holed[3000:3100] = np.nan
    sigma = model.uncertainty(holed)
    assert np.isnan(sigma[3000:3100]).all()
    assert np.isfinite(np.delete(sigma, np.s_[3000:3100], axis=0)).all()
    np.testing.assert_allclose(sigma[:2800], whole[:2800], rtol=1e-6)
    np.testing.assert_allclose(np.nanmean(sigma), np.mean(whole), rtol=0.02)


def test_the_rate_of_the_frames_does_not_matter(model):
    felt, _ = recording(7)
    at_250 = model.uncertainty(resample(felt, 5 * len(felt) // 2), rate_hz=2.5 * RATE_HZ)
    np.testing.assert_allclose(at_250.mean(axis=0), model.uncertainty(felt).mean(axis=0), rtol=0.05)


def test_the_zero_of_a_trial_is_as_uncertain_as_stated():
    """The zero is the same throughout a trial, and the only error here."""
    rng, sd = np.random.default_rng(8), np.repeat([0.5, 0.2], 3)
    felt, wrench = recording(9, unseen=0.0)
    model = fit_inertia(felt, wrench + sd * rng.normal(size=6), SETUP, zero_sd=sd)
    with_zero, without = model.uncertainty(felt), model.uncertainty(felt, zero=False)
    zero = np.sqrt(with_zero**2 - without**2)
    np.testing.assert_allclose(zero, np.broadcast_to(np.sqrt(2) * sd, zero.shape), rtol=1e-6)


@pytest.mark.parametrize("sd", [0.2, 2.0])
def test_several_recordings_show_how_much_a_zero_changes(sd):
    """About the mean of four recordings; 95 % of a new one's, whatever the assumed value."""
    rng = np.random.default_rng(10)
    scale = sd * np.repeat([1.0, 0.5], 3)
    inside = []
    for _ in range(400):
        zeros = scale * rng.normal(size=(4, 6))
        new = scale * rng.normal(size=6) - zeros.mean(axis=0)
        inside.append(np.abs(new) <= 1.96 * zero_of_trials(zeros))
    assert np.mean(inside) > 0.91
    if sd >= 0.5:  # else the assumed value makes it wider
        assert np.mean(inside) < 0.99


def test_each_recording_has_a_zero_of_its_own():
    """The same recording with other zeros: the same gains, and the mean zero."""
    felt, wrench = recording(11)
    alone, both = (
        fit_inertia(felt, wrench, SETUP),
        fit_trials([(felt, wrench + 3), (felt, wrench - 1)]),
    )
    np.testing.assert_allclose(both.gain[:-1], alone.gain[:-1], rtol=1e-9)
    np.testing.assert_allclose(both.gain[-1], alone.gain[-1] + 1)


def test_a_recording_that_the_model_explains_badly_hardly_spoils_the_gains():
    calm, wild = recording(13, 0.0), recording(14, 0.6, unseen=5.0)
    felt, wrench = wild
    wrench = wrench + 40 * band(np.random.default_rng(15), 0.3, 3, wrench.shape)
    trials = [calm, (felt, wrench)]
    named = [(f"{k}", {"plate 1": samples}) for k, samples in enumerate(trials)]
    weight, reason = weigh_beside(named, SETUP)
    both = fit_trials(trials, SETUP, beside_weight=weight)
    assert reason.startswith(f"weight {weight:g} per sample")
    error = np.abs(both.gain[:-1] - GAIN).max()
    assert error < np.abs(fit_inertia(felt, wrench, SETUP).gain[:-1] - GAIN).max() / 20


def test_a_recording_of_which_too_little_would_be_expected_counts_more():
    """Two recordings shaken alike, of which one leaves four times as much: both are held."""
    rng = np.random.default_rng(17)
    felt = [0.3 * band(rng, 7, 11, (6000, 3)) for _ in range(2)]
    left = [size * band(rng, 7, 11, (6000, 6)) for size in (1.0, 4.0)]
    error = fit_model_error(felt, left, RATE_HZ, None, np.zeros(6))
    expected = [np.sqrt(error.variance(one, RATE_HZ).mean()) for one in felt]
    assert expected[1] > 0.85 * 4
    assert expected[0] < 1.15 * 4


BELTS_MPS = (0.0, 1.3, 3.0)
REST, FRICTION, UNBALANCE = 0.5, 1.0, 0.3


def left_of_belts(speed, rng, count=3000):
    """Noise, of friction too where a belt runs, and rollers out of balance: RMS known."""
    time = np.arange(count) / RATE_HZ
    noise = rng.normal(0, np.hypot(REST, FRICTION * (speed > 0)), (count, 6))
    phase = 2 * np.pi * (1.58 * speed * time[:, None] + rng.uniform(size=6))
    return noise + np.sqrt(2) * UNBALANCE * speed**2 * np.sin(phase)


def expected_of_belts(speed):
    return np.sqrt(REST**2 + (speed > 0) * FRICTION**2 + (UNBALANCE * speed**2) ** 2)


def belt_error(speeds):
    rng = np.random.default_rng(18)
    felt = [rng.normal(0, 0.01, (3000, 3)) for _ in speeds]
    left = [left_of_belts(speed, rng) for speed in speeds]
    return felt[0], fit_model_error(felt, left, RATE_HZ, None, np.zeros(6), speeds)


@pytest.mark.parametrize("speed", [0.0, 0.8, 2.0, 3.0])
def test_what_belts_leave_is_expected_at_every_speed_of_the_recordings_range(speed):
    felt, error = belt_error(16 * BELTS_MPS)
    found = np.sqrt(error.variance(felt, RATE_HZ, belts_mps=speed).mean(axis=0))
    np.testing.assert_allclose(found, expected_of_belts(speed), rtol=0.08)


def test_belts_of_unknown_speed_count_as_the_fastest_of_the_recordings():
    felt, error = belt_error(BELTS_MPS)
    speed = np.full(len(felt), 1.3)
    speed[: len(felt) // 2] = np.nan
    variance = error.variance(felt, RATE_HZ, belts_mps=speed)
    fastest = error.variance(felt, RATE_HZ, belts_mps=3.0)
    np.testing.assert_allclose(error.variance(felt, RATE_HZ), fastest, rtol=1e-12)
    np.testing.assert_allclose(variance[: len(felt) // 2], fastest[: len(felt) // 2], rtol=1e-12)
    assert (variance[len(felt) // 2 :] < fastest[len(felt) // 2 :]).all()


@pytest.mark.parametrize("speeds", [(), (1.3,), (3.0, 2.9)])
def test_recordings_at_one_speed_expect_the_same_at_every_speed(speeds):
    felt, error = belt_error(speeds or (3.0,))
    if not speeds:
        error = replace(error, belts_mps=())
    at_rest, running = (error.variance(felt, RATE_HZ, belts_mps=v) for v in (0.0, 6.0))
    np.testing.assert_array_equal(at_rest, running)
    assert error.fastest_mps == (max(speeds) if speeds else None)


def of_two_rollers(speed, rng):
    """What two equal rollers leave that are out of balance at a random angle to each other."""
    angles = rng.uniform(0, 2 * np.pi, (2, 6))
    turns = 2 * np.pi * 1.58 * speed * np.arange(1000)[:, None] / RATE_HZ
    noise = rng.normal(0, REST, (1000, 6))
    return noise + UNBALANCE * speed**2 * sum(np.sin(turns + angle) for angle in angles)


@pytest.mark.parametrize(
    ("speeds", "least", "most"),
    [
        pytest.param((3.0,), 0.79, 0.86, marks=pytest.mark.campaign),
        pytest.param((0.0, 3.0), 0.86, 0.92, marks=pytest.mark.campaign),
        ((0.0, 1.3, 2.5, 3.0), 0.92, 0.97),
    ],
)
def test_rollers_are_held_where_two_recordings_are_near_the_fastest_speed(speeds, least, most):
    """Their angle is another one in every recording: one may leave little and the next one much."""
    rng, held = np.random.default_rng(19), []
    for _ in range(100):
        felt = [rng.normal(0, 0.01, (1000, 3)) for _ in speeds]
        left = [of_two_rollers(speed, rng) for speed in speeds]
        error = fit_model_error(felt, left, RATE_HZ, None, np.zeros(6), speeds)
        sigma = np.sqrt(error.variance(felt[0], RATE_HZ, belts_mps=3.0))
        held.append(np.abs(of_two_rollers(3.0, rng)) <= 1.96 * sigma)
    assert least < np.mean(held) < most
