"""Noise of plates is neither a line of rollers nor a base that vibrates; lines and bases are."""

import numpy as np
import pytest
import scipy

from pipeline.report import empty_treadmill

RATE_HZ, BELTS_MPS = 200.0, 1.4


def spectra(added=0.0):
    """Of two plates with noise of one in a minute, and what is added to each component."""
    noise = np.random.default_rng(1).normal(size=(2, 12_000, 6)) + np.reshape(added, (-1, 1))
    return [empty_treadmill._spectrum(plate, plate, RATE_HZ) for plate in noise]


def test_noise_alone_shows_no_rollers_and_no_base_that_vibrates():
    assert empty_treadmill._rollers(spectra(), BELTS_MPS) is None
    assert empty_treadmill._base(spectra()) == ()


@pytest.mark.parametrize("radius_m", [0.035, 0.05, 0.12])
def test_rollers_of_any_size_are_found_by_a_line_of_a_third_of_the_noise(radius_m):
    turning_hz = BELTS_MPS / (2 * np.pi * radius_m)
    line = np.sin(2 * np.pi * turning_hz * np.arange(12_000) / RATE_HZ) / 3
    assert empty_treadmill._rollers(spectra(line), BELTS_MPS) == pytest.approx(turning_hz, abs=0.1)


@pytest.mark.parametrize("base_hz", [8.5, 20.0, 45.0])
def test_a_base_that_doubles_the_noise_about_its_frequency_is_found(base_hz):
    band = scipy.signal.butter(2, [base_hz - 2, base_hz + 2], "bandpass", fs=RATE_HZ, output="sos")
    shaking = scipy.signal.sosfilt(band, np.random.default_rng(2).normal(size=12_000))
    found = empty_treadmill._base(spectra(1.5 * shaking))
    assert min(abs(hz - base_hz) for hz in found) < 1.5
