"""Signals for the machine are those of the thesis, repeatable, and within its limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

from compensation.inertia.fit import fit_inertia
from compensation.inertia.sensors import sensor_noise_of
from compensation.protocol import (
    belt_signals,
    move,
    pitch_and_sway_signals,
    validation_signals,
)
from compensation.signals import MachineLimits, Signal, check_signal, resample_signal

TIGHT = MachineLimits(
    sway_m=0.03,
    sway_m_per_s=0.1,
    sway_m_per_s2=1.0,
    pitch_deg=6,
    pitch_deg_per_s=12,
    pitch_deg_per_s2=150,
    belt_m_per_s=3.5,
    belt_m_per_s2=8,
)


@pytest.fixture(scope="module")
def platform():
    return {s.name: s for s in pitch_and_sway_signals(1, 3.0)}


@pytest.fixture(scope="module")
def belts():
    return {s.name: s for mean in (1.0, 2.0) for s in belt_signals(1, mean)}


def stretches(condition, shortest):
    """Number of unbroken stretches in which a condition holds for so many samples or more."""
    edges = np.flatnonzero(np.diff(condition.astype(int), prepend=0, append=0))
    return int(np.sum(edges[1::2] - edges[::2] >= shortest))


@pytest.mark.parametrize("limits", [MachineLimits(), TIGHT])
@pytest.mark.parametrize("seed", [1])
def test_all_calibration_signals_respect_the_machine(limits, seed):
    signals = [
        *pitch_and_sway_signals(seed, 0.0, limits),
        *belt_signals(seed, 1.0, limits),
        *belt_signals(seed, 2.0, limits),
    ]
    assert [note for s in signals for note in check_signal(s, limits)] == []
    validation = validation_signals(seed)
    assert [note for s in validation for note in check_signal(s, MachineLimits())] == []


@pytest.mark.parametrize("rate_hz", [300.0, 1000.0])
def test_resampling_stays_within_the_limits_and_keeps_the_motion(platform, belts, rate_hz):
    for signal in (platform["all_60s_3mps"], belts["belt_all_60s_2mps"]):
        fine = resample_signal(signal, rate_hz)
        assert check_signal(fine, MachineLimits()) == ()
        assert fine.time[-1] == pytest.approx(signal.time[-1], abs=1.001 / rate_hz)
        np.testing.assert_allclose(
            np.interp(signal.time, fine.time, fine.sway), signal.sway, atol=1e-4
        )


def test_a_seed_gives_the_same_signals_and_another_seed_others(platform):
    again, other = (pitch_and_sway_signals(seed, 3.0) for seed in (1, 2))
    for signal, same, different in zip(platform.values(), again, other, strict=True):
        np.testing.assert_array_equal(signal.sway, same.sway)
        np.testing.assert_array_equal(signal.pitch, same.pitch)
        n = min(len(signal.sway), len(different.sway))
        assert not np.array_equal(signal.sway[:n], different.sway[:n])


def test_signals_begin_and_end_at_rest(platform, belts):
    for signal in (*platform.values(), *belts.values()):
        for course in (signal.sway, signal.pitch):
            np.testing.assert_allclose(course[[0, -1]], 0, atol=1e-12)
            first_and_last = np.abs(np.diff(course)[[0, -1]])
            assert np.all(first_and_last <= 0.002 * np.max(np.abs(course)))
    for signal in belts.values():
        np.testing.assert_allclose(signal.belt_speed[[0, -1]], 0, atol=1e-12)


@pytest.mark.parametrize(("mean", "sd"), [(1, 5.0), (2, np.sqrt(2000))])
def test_belt_motion_has_the_accelerations_of_the_thesis_within_the_machine(belts, mean, sd):
    signal = belts[f"belt_random_300s_{mean}mps"]
    inside = slice(300, -300)
    saturated = np.std(np.clip(sd * np.random.default_rng(0).normal(size=10_000), -14.25, 14.25))
    acceleration = np.diff(signal.belt_speed)[inside] * 100
    assert 0.7 * saturated < np.std(acceleration) < 1.05 * saturated  # scaled to keep its peaks
    assert np.mean(signal.belt_speed[inside]) == pytest.approx(mean, abs=0.01)


@pytest.mark.parametrize(
    ("name", "course", "level", "samples"),
    [
        ("square_sway_60s_3mps", "sway", 0.0475, 150),
        ("square_pitch_300s_3mps", "pitch", -np.radians(9.5), 150),
        ("constant_sway_300s_3mps", "sway", 0.0475, 500),
        ("constant_pitch_60s_3mps", "pitch", np.radians(9.5) / 2, 500),
        ("gaps_60s_3mps", "sway", 0, 300),
        ("belt_gaps_60s_1mps", "belt_speed", 1, 300),
        ("belt_square_60s_2mps", "belt_speed", 3, 150),
        ("belt_square_300s_2mps", "belt_speed", -3, 150),
        ("belt_constant_60s_2mps", "belt_speed", -1, 500),
        ("belt_constant_300s_2mps", "belt_speed", -0.3, 500),
    ],
)
def test_signals_stay_three_times_at_the_levels_of_the_thesis(
    platform, belts, name, course, level, samples
):
    reached = np.isclose(getattr((platform | belts)[name], course), level, rtol=1e-9, atol=1e-12)
    assert stretches(reached, samples) == 3


def test_validation_signals_are_those_of_the_thesis():
    sway, pitch, running, boarding, belt, with_person = validation_signals()
    assert np.max(np.abs(sway.sway)) == pytest.approx(0.05)
    assert 0.29 < np.max(np.abs(np.diff(sway.sway))) * 100 <= 0.31
    assert stretches(sway.sway > 0.05 - 1e-9, 600) == stretches(sway.sway < -0.05 + 1e-9, 600) == 3
    crossings = pitch.time[1:][(pitch.pitch[:-1] < 0) & (pitch.pitch[1:] >= 0)]
    np.testing.assert_allclose(np.diff(crossings), 30, atol=0.02)
    assert np.degrees(np.max(pitch.pitch)) == pytest.approx(10, abs=1e-3)
    assert set(running.belt_speed) == {2.5}
    assert not np.any(boarding.sway) and not np.any(boarding.belt_speed)  # noqa: PT018
    for pulses, mean in ((belt, 1.0), (with_person, 1.3)):
        onsets = pulse_onsets(pulses.belt_speed)
        np.testing.assert_array_equal(np.diff(onsets), [500] * 11)
        np.testing.assert_allclose(pulses.belt_speed[onsets], mean)
        np.testing.assert_allclose(pulses.belt_speed[onsets + 15], mean + 0.15 * 12)


def test_belt_validation_is_a_minute_of_random_acceleration_before_the_pulses():
    belt = validation_signals()[4].belt_speed
    random = belt[101 : pulse_onsets(belt)[0] + 1]
    assert len(random) == 6000
    assert np.std(np.diff(random) * 100) == pytest.approx(5, rel=0.1)
    assert np.mean(random) == pytest.approx(1, abs=0.01)


def pulse_onsets(speed):
    """Samples from which a belt accelerates by 12 m/s² for 0.15 s."""
    pushed = np.isclose(np.diff(speed) * 100, 12)
    starts = np.flatnonzero(pushed & ~np.append(False, pushed[:-1]))
    return np.array([k for k in starts if pushed[k : k + 15].all()])


far = st.floats(1e-4, 0.3) | st.floats(-0.3, -1e-4)


@given(distance=far, speed=st.floats(0.01, 10), acceleration=st.floats(0.1, 30))
def test_a_move_arrives_and_exceeds_neither_speed_nor_acceleration(distance, speed, acceleration):
    x = np.concatenate([[0, 0], move(distance, speed, acceleration)])
    x = np.append(x, x[-1])
    assert x[-1] == pytest.approx(distance, rel=1e-9)
    assert np.max(np.abs(np.diff(x))) * 100 <= speed * (1 + 1e-9)
    assert np.max(np.abs(np.diff(x, 2))) * 100**2 <= acceleration * (1 + 1e-9)


@given(distance=far, speed=st.floats(0.01, 10), acceleration=st.floats(0.1, 30))
def test_no_move_from_rest_to_rest_could_end_a_sample_earlier(distance, speed, acceleration):
    """Constant acceleration, and constant speed where that is reached, is the fastest there is."""
    cruised = abs(distance) - speed**2 / acceleration
    if cruised > 0:
        fastest_s = cruised / speed + 2 * speed / acceleration
    else:
        fastest_s = 2 * np.sqrt(abs(distance) / acceleration)
    assert fastest_s * 100 - 1e-6 <= len(move(distance, speed, acceleration)) < fastest_s * 100 + 1


def acceleration(signal):
    """Second differences of sway and pitch, (T - 2, 2) [m/s², rad/s²]."""
    platform = np.column_stack([signal.sway, signal.pitch])
    return np.diff(platform, 2, axis=0) * signal.rate_hz**2


@pytest.mark.parametrize("duration", [60, 300])
def test_square_waves_turn_at_the_acceleration_of_the_machine(platform, duration):
    """Twice the speed changes at the full acceleration, for 0.12 s: a slow platform follows."""
    limits = MachineLimits()
    for kind, column, most in (
        ("square_sway", 0, limits.sway_m_per_s2),
        ("square_pitch", 1, np.radians(limits.pitch_deg_per_s2)),
    ):
        signal = platform[f"{kind}_{duration}s_3mps"]
        assert np.max(np.abs(acceleration(signal)[:, column])) == pytest.approx(most, rel=0.03)
    sway = acceleration(platform[f"square_sway_{duration}s_3mps"])[:, 0]
    assert stretches(sway > 0.95 * limits.sway_m_per_s2, 11) == 3
    assert np.max(np.abs(acceleration(platform[f"random_{duration}s_3mps"])[:, 0])) < 4


def test_a_signal_beyond_the_machine_names_the_limit():
    time = np.arange(300) / 100
    wild = Signal("wild", 100, 0.08 * np.sin(9 * time), 0 * time, 0 * time + 7)
    notes = check_signal(wild, MachineLimits())
    assert [note.values["quantity"] for note in notes] == [
        *("sway_m", "sway_m_per_s", "sway_m_per_s2", "belt_m_per_s")
    ]
    assert (notes[0].values["signal"], notes[0].values["limit"]) == ("wild", 0.05)


def test_spectrum_is_flat_above_the_high_pass_and_holds_the_variance(platform):
    signal = platform["random_300s_3mps"]
    frequency, density_of_both = welch(acceleration(signal), 100, nperseg=1000, axis=0)
    sway, pitch = density_of_both.T
    flat = (frequency > 1) & (frequency < 45)
    for density, sd in ((sway, 0.707), (pitch, np.radians(127))):
        np.testing.assert_allclose(density[flat].mean(), sd**2 / 50, rtol=0.05)
        assert density[frequency < 0.15].mean() < 0.1 * density[flat].mean()
        assert np.sum(density) * frequency[1] == pytest.approx(sd**2, rel=0.05)


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


@pytest.fixture(scope="module")
def thesis_trials(laboratory, platform):
    """The thesis' best calibration for 60 s, and trials it was not fitted on, with noise."""
    courses = {s.name: s for s in validation_signals()}
    courses |= {name: platform[f"{name}_60s_3mps"] for name in ("random", "square_sway")}
    lab = laboratory()
    return {
        name: lab.follow(courses[name].sway, courses[name].pitch, noise=noise, cutoff_hz=20)
        for noise, name in enumerate(("square_sway", "sway", "pitch", "random"))
    }


@pytest.mark.parametrize("validation", ["sway", "pitch", "random"])
def test_thesis_calibration_compensates_its_validation_to_the_noise(thesis_trials, validation):
    trial, held_out = thesis_trials["square_sway"], thesis_trials[validation]
    noise = sensor_noise_of(trial.accelerations)
    model = fit_inertia(trial.accelerations, trial.wrench, sensor_noise=noise, zero_sd=0.0)
    left = model.compensate(held_out.accelerations, held_out.wrench)
    sigma = model.uncertainty(held_out.accelerations)
    np.testing.assert_allclose(rms(left), rms(sigma), rtol=0.1)
    assert np.mean(np.abs(left) < 1.96 * sigma) == pytest.approx(0.95, abs=0.015)
