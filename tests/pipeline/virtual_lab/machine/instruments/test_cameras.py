"""Cameras: noise, gaps and swapped labels."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import CameraFaults, Faults
from pipeline.virtual_lab.machine.instruments import measure_markers


def test_cameras_without_faults_report_the_truth():
    rng = np.random.default_rng(0)
    markers = rng.normal(size=(30, 5, 3))
    measured = measure_markers(markers, Faults.none().cameras, rng, 100.0)
    np.testing.assert_array_equal(measured, markers)


def test_gaps_and_swaps_are_as_frequent_as_stated():
    rng = np.random.default_rng(4)
    still = np.tile(rng.normal(size=(1, 46, 3)), (60_000, 1, 1))
    faults = CameraFaults(noise_m=0, skin_scale=0, gaps_per_minute=6, gap_s=0.1)
    measured = measure_markers(still, faults, rng, 100.0)
    gap_s = np.isnan(measured[..., 0]).sum(axis=(0, 1)) / 100
    assert gap_s == pytest.approx(6 * 10 * 0.1, rel=0.6)
    faults = CameraFaults(noise_m=0, gaps_per_minute=0, swaps_per_minute=3)
    swapped = np.any(measure_markers(still, faults, rng, 100.0) != still, axis=2)
    assert np.all(swapped.sum(axis=1) % 2 == 0)
    assert 0 < swapped.any(axis=1).mean() < 0.05


def test_marker_noise_is_white_and_as_large_as_stated():
    still = np.zeros((4000, 46, 3))
    faults = CameraFaults(gaps_per_minute=0)
    noise = measure_markers(still, faults, np.random.default_rng(0), 100.0)
    assert noise.std() == pytest.approx(faults.noise_m, rel=0.01)
    lagged = np.mean(noise[1:] * noise[:-1]) / noise.var()
    assert abs(lagged) < 0.01
