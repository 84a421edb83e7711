"""Load cells: what they report of true wrenches."""

import numpy as np
import pytest

from hbm.signals.filtering import low_pass
from pipeline.virtual_lab.faults import Faults, PlateFaults
from pipeline.virtual_lab.machine.instruments import (
    FULL_SCALE_N,
    MOMENT_ARM_M,
    PLATE_CENTERS_M,
    ForcePlate,
    make_force_plate,
    misplaced,
    recorded_plate,
)

RATE_HZ = 1000.0
NO_NOISE = Faults.none().plates.model_copy(
    update={"offset_n": 2.0, "drift_n_per_min": 0.3, "cross_talk": 0.002}
)


@pytest.mark.parametrize("plate", ["default", "drawn"])
def test_a_plate_without_faults_reports_the_truth(plate):
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(50, 6))
    perfect = ForcePlate() if plate == "default" else make_force_plate(Faults.none().plates, rng)
    np.testing.assert_array_equal(perfect.measure(wrench, 1000.0, rng), wrench)


def test_an_empty_plate_reports_its_zero_error_and_drift():
    plate, rng = make_force_plate(NO_NOISE, np.random.default_rng(3)), np.random.default_rng(0)
    measured = plate.measure(np.zeros((6001, 6)), 100.0, rng)
    np.testing.assert_allclose(measured[0], plate.offset)
    np.testing.assert_allclose(measured[-1] - measured[0], 60 * plate.drift)


def test_a_vertical_load_shows_in_all_components_by_their_cross_talk():
    plate, rng = make_force_plate(NO_NOISE, np.random.default_rng(3)), np.random.default_rng(0)
    zero, loaded = plate.measure(np.outer([0, 800], np.eye(6)[2]), 1e9, rng)
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
    still = PlateFaults(drift_n_per_min=0)
    plate = make_force_plate(still, np.random.default_rng(0))
    raw = plate.measure(np.zeros((120_000, 6)), RATE_HZ, np.random.default_rng(1))
    raw -= raw.mean(axis=0)
    assert np.all((raw.std(axis=0)[:3] > 0.9) & (raw.std(axis=0)[:3] < 1.3))
    assert np.all((raw.std(axis=0)[3:] > 0.4) & (raw.std(axis=0)[3:] < 0.9))
    slow = low_pass(raw, RATE_HZ, 6.0, "zero_phase").std(axis=0)[:3]
    assert np.all((slow > 0.13) & (slow < 0.27))
    white = make_force_plate(still.model_copy(update={"wander_n": 0.0}), np.random.default_rng(0))
    raw = white.measure(np.zeros((120_000, 6)), RATE_HZ, np.random.default_rng(1))
    assert np.all(low_pass(raw, RATE_HZ, 6.0, "zero_phase").std(axis=0)[:3] < 0.13)


def test_the_zero_moves_from_recording_to_recording_and_not_within():
    plate = make_force_plate(
        Faults.none().plates.model_copy(update={"zero_shift_n": 0.5}), np.random.default_rng(0)
    )
    zeros = []
    for seed in range(100):
        measured = plate.measure(np.zeros((3, 6)), RATE_HZ, np.random.default_rng(seed))
        assert np.ptp(measured, axis=0).max() == 0
        zeros.append(measured[0])
    np.testing.assert_allclose(np.std(zeros, axis=0), [0.5] * 3 + [0.5 / 3] * 3, rtol=0.25)


def test_a_converter_reports_steps_of_its_range_and_never_errs_by_more_than_half_of_one():
    plate = make_force_plate(
        Faults.none().plates.model_copy(update={"bits": 16}), np.random.default_rng(0)
    )
    true = np.random.default_rng(1).normal(0, 100, (500, 6))
    step = np.array([1.0] * 3 + [MOMENT_ARM_M] * 3) * FULL_SCALE_N / 2**15
    measured = plate.measure(true, RATE_HZ, np.random.default_rng(2))
    assert np.all(np.abs(measured - true) <= step / 2 * (1 + 1e-9))
    np.testing.assert_allclose(measured / step, np.rint(measured / step), atol=1e-6)


def test_switching_one_fault_off_leaves_what_the_others_draw():
    """Each has its own random numbers; the white noise of a recording is the same."""
    true = np.zeros((2000, 6))
    noise = {}
    for name, faults in {
        "noise alone": {},
        "with others": {"zero_shift_n": 0.5, "wander_n": 0.15, "offset_n": 2.0},
    }.items():
        stated = Faults.none().plates.model_copy(update={"force_noise_n": 1.1} | faults)
        plate = make_force_plate(stated, np.random.default_rng(3))
        measured = plate.measure(true, RATE_HZ, np.random.default_rng(4))
        noise[name] = np.diff(measured[:, 0])
    difference = noise["with others"] - noise["noise alone"]
    assert difference.std() < 0.01 * noise["noise alone"].std()


def test_cross_talk_is_as_large_as_stated():
    gains = [
        make_force_plate(PlateFaults(cross_talk=0.01), np.random.default_rng(k)).gain - np.eye(6)
        for k in range(50)
    ]
    assert np.std(np.array(gains)[:, :3]) == pytest.approx(0.01, rel=0.1)


def test_the_plates_lie_side_by_side_with_a_common_edge():
    left, right = (recorded_plate(number, np.zeros(1), np.zeros((1, 6))) for number in (1, 2))
    np.testing.assert_allclose([left.center, right.center], PLATE_CENTERS_M)
    assert left.corners[:, 1].min() == pytest.approx(right.corners[:, 1].max())
    assert left.center[1] > 0


def test_a_misplaced_plate_sees_a_load_where_the_static_calibration_says():
    """Plate coordinates are the cameras', turned and shifted; the force turns with them."""
    faults = PlateFaults(placement_deg=30.0 / 4, placement_forward_m=0.02, placement_left_m=-0.01)
    place, force = np.array([0.4, -0.3, 0.0]), np.array([20.0, -50.0, 700.0])
    seen = misplaced(np.hstack([force, np.cross(place, force)])[None], faults)[0]
    c, s = np.cos(np.radians(7.5)), np.sin(np.radians(7.5))
    np.testing.assert_allclose(seen[:3], [c * 20 + s * 50, s * 20 - c * 50, 700])
    expected = np.array([c * 0.4 + s * 0.3 + 0.02, s * 0.4 - c * 0.3 - 0.01, 0.0])
    np.testing.assert_allclose(seen[3:], np.cross(expected, seen[:3]))
