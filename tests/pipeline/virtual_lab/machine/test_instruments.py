"""Instruments sample when and report what they state, with errors of stated size."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.signals.filtering import low_pass
from pipeline.virtual_lab.faults import AccelerometerFaults, CameraFaults, Faults, PlateFaults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    Clock,
    ForcePlate,
    Stream,
    interpolated,
    make_accelerometers,
    make_force_plate,
    measure_markers,
    misplaced,
    wander,
)

RATE_HZ = 1000.0
STEADY = Faults.none().plates.model_copy(update={"gain_scale": 1.0, "zero_scale": 1.0})


def rng():
    return np.random.default_rng(0)


def test_between_samples_a_cubic_is_exact_and_a_sine_of_80_hz_nearly():
    place = np.arange(40.0)
    cubic = (0.3 * place**3 - 2 * place**2 + place)[:, None]
    wanted = np.random.default_rng(0).uniform(1, 37, 200)
    exact = 0.3 * wanted**3 - 2 * wanted**2 + wanted
    np.testing.assert_allclose(interpolated(cubic, wanted)[:, 0], exact, atol=1e-9)
    sine = np.sin(2 * np.pi * 0.08 * place)[:, None]
    found = interpolated(sine, wanted)[:, 0]
    assert np.abs(found - np.sin(2 * np.pi * 0.08 * wanted)).max() < 0.003


def test_a_wandering_zero_is_slow_and_as_large_as_stated():
    drawn = wander(600_000, RATE_HZ, 6, rng())
    assert drawn.std() == pytest.approx(1.0, rel=0.1)
    fast = drawn - low_pass(drawn, RATE_HZ, 10.0, "zero_phase")
    assert fast.std() < 0.02


def test_belt_speed_is_held_between_updates_at_200_hz():
    speed = np.arange(52.0)
    reported = Stream(held=True).sample(speed[:, None], 1000.0, rng())[:, 0]
    np.testing.assert_array_equal(reported, speed // 5 * 5)


def test_a_stream_reads_at_jittering_instants():
    time = np.arange(100_000) / RATE_HZ
    found = Stream(delay_s=0.03, jitter_s=0.0003).sample(time[:, None], RATE_HZ, rng())[:, 0]
    late = (time - found)[100:]
    assert late.mean() == pytest.approx(0.03, abs=1e-5)
    assert late.std() == pytest.approx(0.0003, rel=0.03)


def test_a_plate_without_faults_reports_the_truth():
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(50, 6))
    perfect = make_force_plate(Faults.none().plates, rng)
    np.testing.assert_array_equal(perfect.measure(wrench, 1000.0, rng), wrench)


def test_a_vertical_load_shows_in_all_components_by_their_cross_talk():
    plate = replace(make_force_plate(STEADY, np.random.default_rng(3)), curvature=0.0)
    zero, loaded = plate.measure(np.outer([0, 800], np.eye(6)[2]), 1e9, rng())
    np.testing.assert_allclose(loaded - zero, 800 * plate.gain[:, 2])
    assert np.abs(np.delete(loaded - zero, 2)).max() > 0.1


def test_curvature_is_a_share_of_full_scale_at_full_scale_and_grows_with_the_square():
    plate, rng = ForcePlate(curvature=0.02, full_scale_n=500.0), np.random.default_rng(0)
    half, full = plate.measure(np.outer([250, 500], np.eye(6)[2]), RATE_HZ, rng)[:, 2]
    assert full == pytest.approx(500 * 1.02)
    assert half - 250 == pytest.approx((full - 500) / 4)


def test_plate_errors_are_as_large_as_stated():
    drawn = [make_force_plate(PlateFaults(), np.random.default_rng(k)) for k in range(200)]
    offsets = np.array([plate.offset for plate in drawn])
    drifts = 60 * np.array([plate.drift for plate in drawn])
    assert offsets[:, :3].std() == pytest.approx(2.0, rel=0.1)
    assert offsets[:, 3:].std() == pytest.approx(2.0 / 3, rel=0.1)
    assert drifts[:, :3].std() == pytest.approx(0.3, rel=0.1)
    curvatures = [plate.curvature for plate in drawn]
    assert np.std(curvatures) == pytest.approx(0.002, rel=0.15)
    assert np.mean(curvatures) == pytest.approx(0.0, abs=0.0005)


def test_a_plate_at_rest_has_the_noise_of_real_plates_raw_and_below_6_hz():
    """Real ones: 0.9 to 1.3 N and 0.4 to 0.9 N·m raw, 0.13 to 0.27 N below 6 Hz."""
    still = PlateFaults(zero_scale=0)
    plate = make_force_plate(still, np.random.default_rng(0))
    raw = plate.measure(np.zeros((120_000, 6)), RATE_HZ, np.random.default_rng(1))
    raw -= raw.mean(axis=0)
    assert np.all((raw.std(axis=0)[:3] > 0.9) & (raw.std(axis=0)[:3] < 1.3))
    assert np.all((raw.std(axis=0)[3:] > 0.4) & (raw.std(axis=0)[3:] < 0.9))
    slow = low_pass(raw, RATE_HZ, 6.0, "zero_phase").std(axis=0)[:3]
    assert np.all((slow > 0.13) & (slow < 0.27))
    white = make_force_plate(still.model_copy(update={"fine_scale": 0.0}), np.random.default_rng(0))
    raw = white.measure(np.zeros((120_000, 6)), RATE_HZ, np.random.default_rng(1))
    assert np.all(low_pass(raw, RATE_HZ, 6.0, "zero_phase").std(axis=0)[:3] < 0.13)


def test_a_misplaced_plate_sees_a_load_where_the_static_calibration_says():
    """Plate coordinates are the cameras', turned and shifted; the force turns with them."""
    faults = PlateFaults(placement_deg=30.0 / 4, placement_forward_m=0.02, placement_left_m=-0.01)
    place, force = np.array([0.4, -0.3, 0.0]), np.array([20.0, -50.0, 700.0])
    seen = misplaced(np.hstack([force, np.cross(place, force)])[None], faults)[0]
    c, s = np.cos(np.radians(7.5)), np.sin(np.radians(7.5))
    np.testing.assert_allclose(seen[:3], [c * 20 + s * 50, s * 20 - c * 50, 700])
    expected = np.array([c * 0.4 + s * 0.3 + 0.02, s * 0.4 - c * 0.3 - 0.01, 0.0])
    np.testing.assert_allclose(seen[3:], np.cross(expected, seen[:3]))


@pytest.fixture
def true():
    """Specific force of a point that is accelerated by up to about 1 g."""
    return np.random.default_rng(5).normal([0, 0, 9.81], 2.0, (500, 3))


def test_accelerometer_errors_are_as_large_as_stated():
    stated = AccelerometerFaults(sensors=4)
    sensors = [s for k in range(100) for s in make_accelerometers(stated, np.random.default_rng(k))]
    gains = np.array([np.linalg.norm(s.sensitivity, axis=1) - 1 for s in sensors])
    assert gains.std() == pytest.approx(0.01, rel=0.1)
    angles = [np.degrees(np.arccos(np.trace(axes(s.sensitivity)) / 2 - 0.5)) for s in sensors]
    assert 1.0 < np.sqrt(np.mean(np.square(angles))) < 1.5  # with what a channel shows of others
    assert np.std([s.offset for s in sensors]) == pytest.approx(0.05, rel=0.1)
    assert {s.limit for s in sensors} == {2 * 9.81}
    assert np.std([s.curvature for s in sensors]) == pytest.approx(0.002, rel=0.1)
    assert np.std([60 * s.drift for s in sensors]) == pytest.approx(0.001, rel=0.1)


def axes(sensitivity):
    """Take the gains off a sensitivity: a rotation is left."""
    return np.clip(sensitivity / np.linalg.norm(sensitivity, axis=1)[:, None], -1, 1)


def test_accelerometers_clip_at_their_range(true):
    sensor = make_accelerometers(AccelerometerFaults(), np.random.default_rng(0))[0]
    assert sensor.measure(9 * true, 1000.0, np.random.default_rng(1)).max() == pytest.approx(
        2 * 9.81
    )


def test_gaps_are_as_frequent_as_stated():
    still = np.tile(rng().normal(size=(1, 46, 3)), (60_000, 1, 1))
    faults = CameraFaults(noise_m=0, gaps_per_minute=6)
    gap_s = np.isnan(measure_markers(still, faults, rng(), 100.0)[..., 0]).sum() / 100
    assert gap_s == pytest.approx(6 * 10 * 0.15, rel=0.6)


def test_marker_noise_is_white_and_as_large_as_stated():
    still = np.zeros((4000, 46, 3))
    faults = CameraFaults(gaps_per_minute=0)
    noise = measure_markers(still, faults, np.random.default_rng(0), 100.0)
    assert noise.std() == pytest.approx(faults.noise_m, rel=0.01)
    lagged = np.mean(noise[1:] * noise[:-1]) / noise.var()
    assert abs(lagged) < 0.01


def test_a_fast_clock_drifts_away_by_its_error():
    time = np.arange(100_000) / RATE_HZ
    found = Clock(rate=1e-4).sample(time[:, None], RATE_HZ, rng())[:, 0]
    np.testing.assert_allclose(found[:-20], time[:-20] * (1 + 1e-4), atol=1e-9)


def test_a_streamed_value_is_now_and_then_the_one_before():
    time = np.arange(600_000) / RATE_HZ
    stream = Stream(doubled_per_minute=6.0, held=True)
    found = stream.sample(time[:, None], RATE_HZ, rng())[::5, 0]
    doubled = np.abs(found - (time[::5] - 0.005)) < 1e-6
    assert 30 < doubled.sum() < 90  # 60 in ten minutes
    np.testing.assert_allclose(found[~doubled], time[::5][~doubled], atol=1e-9)


def test_the_zero_moves_from_recording_to_recording_and_not_within():
    plate = make_force_plate(
        Faults.none().plates.model_copy(update={"zero_scale": 1.0}), np.random.default_rng(0)
    )
    zeros = []
    for seed in range(100):
        measured = plate.measure(np.zeros((3, 6)), RATE_HZ, np.random.default_rng(seed))
        assert np.ptp(measured, axis=0).max() < 1e-4  # drift alone
        zeros.append(measured[0])
    np.testing.assert_allclose(np.std(zeros, axis=0), [0.5] * 3 + [0.5 / 3] * 3, rtol=0.25)
