"""Load cells: what they report of true wrenches."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import Faults, PlateFaults
from pipeline.virtual_lab.machine.instruments.force_plate import (
    PLATE_CENTERS_M,
    ForcePlate,
    make_force_plate,
    misplaced,
    recorded_plate,
)

NO_NOISE = PlateFaults(force_noise_n=0, moment_noise_nm=0)


@pytest.mark.parametrize("plate", ["default", "drawn"])
def test_a_plate_without_faults_reports_the_truth(plate):
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(50, 6))
    perfect = ForcePlate() if plate == "default" else make_force_plate(Faults.none().plates, rng)
    np.testing.assert_array_equal(perfect.measure(wrench, np.arange(50.0), rng), wrench)


def test_an_empty_plate_reports_its_zero_error_and_drift():
    plate, rng = make_force_plate(NO_NOISE, np.random.default_rng(3)), np.random.default_rng(0)
    zero, later = plate.measure(np.zeros((2, 6)), np.array([0.0, 60.0]), rng)
    np.testing.assert_allclose(zero, plate.offset)
    np.testing.assert_allclose(later - zero, 60 * plate.drift)


def test_a_vertical_load_shows_in_all_components_by_their_cross_talk():
    plate, rng = make_force_plate(NO_NOISE, np.random.default_rng(3)), np.random.default_rng(0)
    zero, loaded = plate.measure(np.outer([0, 800], np.eye(6)[2]), np.zeros(2), rng)
    np.testing.assert_allclose(loaded - zero, 800 * plate.gain[:, 2])
    assert np.abs(np.delete(loaded - zero, 2)).max() > 0.1


def test_curvature_is_a_share_of_full_scale_at_full_scale_and_grows_with_the_square():
    plate, rng = ForcePlate(curvature=0.02, full_scale_n=500.0), np.random.default_rng(0)
    half, full = plate.measure(np.outer([250, 500], np.eye(6)[2]), np.zeros(2), rng)[:, 2]
    assert full == pytest.approx(500 * 1.02)
    assert half - 250 == pytest.approx((full - 500) / 4)


def test_plate_errors_are_as_large_as_stated():
    drawn = [make_force_plate(PlateFaults(), np.random.default_rng(k)) for k in range(200)]
    offsets = np.array([plate.offset for plate in drawn])
    drifts = 60 * np.array([plate.drift for plate in drawn])
    assert offsets[:, :3].std() == pytest.approx(2.0, rel=0.1)
    assert offsets[:, 3:].std() == pytest.approx(2.0 / 3, rel=0.1)
    assert drifts[:, :3].std() == pytest.approx(0.3, rel=0.1)
    noise = drawn[0].measure(np.zeros((5000, 6)), np.zeros(5000), np.random.default_rng(1))
    np.testing.assert_allclose(noise.std(axis=0), [1.5] * 3 + [0.5] * 3, rtol=0.05)


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
