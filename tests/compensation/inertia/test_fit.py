"""A fitted model takes away what a rigid platform's pitch and sway add to the plates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation.inertia.calibration import Calibration
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from compensation.inertia.sensors import sensor_noise_of


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


def left_over(model, trial):
    """RMS after compensation relative to the RMS before, per component."""
    return rms(model.compensate(trial.accelerations, trial.wrench)) / rms(trial.wrench)


@pytest.fixture(scope="module")
def noisy(laboratory):
    """Two sensors, realistic noise, 20 Hz: model, its trial, and a trial it was not fitted on."""
    lab = laboratory()
    trial = lab.random_trial(1, noise=11, cutoff_hz=20)
    held_out = lab.random_trial(2, noise=12, cutoff_hz=20)
    return fit_inertia(trial.accelerations, trial.wrench, zero_sd=0.0), trial, held_out


@pytest.mark.parametrize("side", ["left", "right"])
def test_two_sensors_take_pitch_and_sway_away_exactly(laboratory, assemblies, side):
    lab = laboratory(assembly=assemblies[side])
    trial, other = (lab.random_trial(seed, rate_hz=100) for seed in (1, 2))
    model = fit_inertia(trial.accelerations, trial.wrench)
    assert left_over(model, other).max() < 1e-9


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_two_sensors_anywhere_off_a_common_pitch_axis_suffice(laboratory, seed):
    positions = np.random.default_rng(seed).uniform(-1, 1, (2, 3))
    lab = laboratory(tuple(map(tuple, positions)))
    trial, other = (lab.random_trial(seed, rate_hz=100, duration=20) for seed in (1, 2))
    model = fit_inertia(trial.accelerations, trial.wrench)
    assert left_over(model, other).max() < 1e-6


@pytest.mark.parametrize("places", ["one", "parallel"])
def test_one_sensor_or_a_baseline_along_the_pitch_axis_only_approximates(
    laboratory, sensor_places, places
):
    lab = laboratory(sensor_places[places])
    trial, other = (lab.random_trial(seed, rate_hz=100) for seed in (1, 2))
    model = fit_inertia(trial.accelerations, trial.wrench)
    worst = left_over(model, other).max()
    assert 1e-3 < worst < 0.2  # not exact, still more than 80 % less
    assert model.rank == 4


def test_any_motion_in_space_is_exact_with_four_sensors_off_one_plane(laboratory, sensor_places):
    relative = {}
    for places in ("two", "four", "four in a plane"):
        lab = laboratory(sensor_places[places])
        trial, other = (lab.spatial_trial(seed) for seed in (3, 4))
        model = fit_inertia(trial.accelerations, trial.wrench)
        relative[places] = left_over(model, other).max()
    assert relative["four"] < 1e-8
    assert 1e-4 < relative["four in a plane"] < 0.02  # centripetal products are approximated
    assert relative["two"] > 0.1


def test_gravity_alone_gives_the_mass_of_the_belt_assembly(laboratory, assemblies):
    lab = laboratory(crooked=False)
    trial = lab.random_trial(1, rate_hz=100)
    model = fit_inertia(trial.accelerations, trial.wrench)
    mass = model.gain[:-1, :3].reshape(-1, 3, 3).sum(axis=0)
    np.testing.assert_allclose(mass, assemblies["left"].mass * np.eye(3), atol=1e-4)


def test_predicted_noise_floor_is_that_of_the_instruments(noisy):
    model, _, held_out = noisy
    plate = held_out.wrench - held_out.wrench_clean
    sensors = held_out.accelerations - held_out.accelerations_clean
    floor = rms(plate - sensors @ model.gain[:-1])
    np.testing.assert_allclose(rms(model.uncertainty(held_out.accelerations)), floor, rtol=0.1)


def test_95_percent_intervals_cover_95_percent(noisy):
    model, _, held_out = noisy
    compensated = model.compensate(held_out.accelerations, held_out.wrench)
    inside = np.abs(compensated) < 1.96 * model.uncertainty(held_out.accelerations)
    np.testing.assert_allclose(inside.mean(axis=0), 0.95, atol=0.02)  # 60 s: about ± 0.01 by chance
    assert inside.mean() == pytest.approx(0.95, abs=0.01)


def test_slow_pitch_is_compensated_by_a_calibration_with_fast_motion(noisy, laboratory):
    model, *_ = noisy
    trial = laboratory().slow_pitch_trial(noise=13, cutoff_hz=20)
    compensated = model.compensate(trial.accelerations, trial.wrench)
    predicted = rms(model.uncertainty(trial.accelerations))
    np.testing.assert_allclose(rms(compensated), predicted, rtol=0.1)


def test_a_persons_wrench_survives(noisy, laboratory):
    model, *_ = noisy
    time = np.arange(60_000) / 1000
    step = np.maximum(np.sin(2 * np.pi * time), 0)[:, None]
    person = step * np.array([90, 30, 820, 150, -260, 12.0])
    loaded = laboratory().random_trial(2, noise=12, cutoff_hz=20, person=person)
    empty = laboratory().random_trial(2, cutoff_hz=20)
    alone = loaded.wrench_clean - empty.wrench_clean
    error = model.compensate(loaded.accelerations, loaded.wrench) - alone
    np.testing.assert_allclose(rms(error), rms(model.uncertainty(loaded.accelerations)), rtol=0.1)


def test_standard_error_of_the_gain_is_the_spread_over_repeated_calibrations(laboratory):
    models = []
    for noise in range(12):
        trial = laboratory().random_trial(1, noise=noise, cutoff_hz=20, duration=30)
        models.append(fit_inertia(trial.accelerations, trial.wrench))
    still = laboratory().random_trial(5, cutoff_hz=20, duration=2).accelerations_clean
    x = np.column_stack([still, np.ones(len(still))])
    spread = np.std([m.predict(still) for m in models], axis=0, ddof=1)
    stated = np.mean([[np.sum((x @ c) * x, axis=1) for c in m.covariance] for m in models], axis=0)
    ratio = rms(spread) / np.sqrt(stated.mean(axis=1))
    assert np.all((ratio > 0.6) & (ratio < 1.6))  # 12 repetitions: ± 20 %; 6 components


@pytest.mark.parametrize("places", ["two", "four"])
def test_noise_of_the_accelerometers_is_found_where_rigid_motion_leaves_none(
    laboratory, sensor_places, places
):
    trial = laboratory(sensor_places[places]).random_trial(1, noise=11, cutoff_hz=20)
    noise = np.std(trial.accelerations - trial.accelerations_clean)
    assert sensor_noise_of(trial.accelerations) == pytest.approx(noise, rel=0.04)


def test_allowing_for_noise_recovers_the_gains_of_noise_free_sensors(laboratory, sensor_places):
    lab = laboratory(sensor_places["four"])
    trial = lab.random_trial(1, noise=11)  # unfiltered: noise as large as the slowest motion
    noise = sensor_noise_of(trial.accelerations)
    slow = lab.slow_pitch_trial()
    bias = {
        allowed: rms(
            fit_inertia(trial.accelerations, trial.wrench, sensor_noise=allowed).compensate(
                slow.accelerations, slow.wrench
            )
        )[2]
        for allowed in (0.0, noise)
    }
    assert bias[noise] < 0.3 * bias[0.0]


def test_account_of_the_calibration_is_that_of_its_own_residual(noisy):
    model, trial, _ = noisy
    residual = model.compensate(trial.accelerations, trial.wrench)
    np.testing.assert_allclose(model.rms_compensated, rms(residual), rtol=1e-12)
    np.testing.assert_allclose(
        model.r_squared,
        [np.corrcoef(w, w - e)[0, 1] ** 2 for w, e in zip(trial.wrench.T, residual.T, strict=True)],
        atol=1e-6,
    )
    assert model.rank == 7


def test_gain_is_the_least_squares_solution(noisy):
    model, trial, _ = noisy
    x = np.column_stack([trial.accelerations, np.ones(len(trial.wrench))])
    expected = np.linalg.solve(x.T @ x, x.T @ trial.wrench)
    np.testing.assert_allclose(model.gain, expected, rtol=1e-6, atol=1e-6)


def test_offset_of_sensors_and_tare_of_plates_do_not_matter(noisy):
    model, trial, held_out = noisy
    offset = np.linspace(-0.3, 0.3, 6)
    other = fit_inertia(trial.accelerations + offset, trial.wrench + 40)
    np.testing.assert_allclose(
        other.compensate(held_out.accelerations + offset, held_out.wrench + 40),
        model.compensate(held_out.accelerations, held_out.wrench),
        atol=1e-7,
    )


SETUP = Setup(("rear", "front"), rate_hz=100.0, cutoff_hz=20.0)


def notes_of(trial):
    """What a calibration with the plate of this recording says wherever it is used."""
    model = fit_inertia(trial.accelerations, trial.wrench, SETUP)
    return Calibration({"plate 1": model}).notes


def test_a_person_standing_still_in_the_calibration_trial_is_detected(laboratory):
    trial = laboratory().random_trial(
        1, noise=11, cutoff_hz=20, person=np.array([0, 0, 700.0, 190, 0, 0])
    )
    (note,) = notes_of(trial)
    assert (note.code, note.level) == ("calibration_loaded", "warning")


@pytest.fixture(scope="module")
def good(laboratory):
    trial = laboratory().random_trial(1, rate_hz=100, duration=20)
    return trial.accelerations, trial.wrench


def with_gap(table):
    table = table.copy()
    table[300:420, 2] = np.nan
    return table


def with_dead_channel(table, column):
    table = table.copy()
    table[:, column] = 4.2
    return table


WRONG = {
    "one axis missing": (lambda a, w: (a[:, :5], w), "5 channels, expected 3 for every acceler"),
    "gap in accelerations": (
        lambda a, w: (with_gap(a), w),
        "accelerations: 120 of 2000 samples are not numbers, the first at sample 300",
    ),
    "different rates": (lambda a, w: (a, w[::10]), "accelerations 2000, wrench 200; were they rec"),
    "dead channel": (lambda a, w: (with_dead_channel(a, 4), w), "constant in sensor 2 y"),
    "accelerations in g": (lambda a, w: (a / 9.81, w), "accelerometer 1 reads 1.* m/s²"),
    "moments in N·mm": (lambda a, w: (a, w * [1, 1, 1, 1e3, 1e3, 1e3]), "must be in N·m"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_wrong_calibration_input_gets_one_clear_error(good, fault):
    spoil, message = WRONG[fault]
    with pytest.raises(ValueError, match=message) as caught:
        fit_inertia(*spoil(*good))
    assert "\n" not in str(caught.value)


def test_platform_at_rest_is_no_calibration(laboratory):
    trial = laboratory().slow_pitch_trial(duration=2, noise=1)
    still = trial.accelerations - trial.accelerations_clean + trial.accelerations_clean[0]
    with pytest.raises(ValueError, match="hardly moved"):
        fit_inertia(0.3 * still + 0.7 * still.mean(axis=0), trial.wrench)
