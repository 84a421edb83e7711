"""A vibration of a plate is told from noise."""

import numpy as np
import pytest

from pipeline.plate_accuracy import response

PLATES, RECORDINGS = 40, 4
TIME_S = np.arange(0.0, 4.0, 0.01)


def with_vibrations(monkeypatch, amplitude, hz=3.2):
    """Of plates with noise of one and a line of this amplitude, those that vibrate."""
    monkeypatch.setattr(response, "_beyond_motion", lambda trial: trial)
    found = 0
    for seed in range(PLATES):
        rng = np.random.default_rng(seed)
        trials = []
        for _ in range(RECORDINGS):
            line = amplitude * np.cos(2 * np.pi * hz * TIME_S + rng.uniform(0, 2 * np.pi))
            noise = rng.normal(size=len(TIME_S))
            trials.append((TIME_S, noise + line, np.ones((len(TIME_S), 1))))
        found += response.find_vibration(trials) is not None
    return found


def test_noise_alone_is_no_vibration(monkeypatch):
    assert with_vibrations(monkeypatch, 0.0) == 0


@pytest.mark.parametrize("hz", [0.8, 3.2, 13.0])
def test_a_line_of_a_third_of_the_noise_is_found_in_nine_of_ten_plates(monkeypatch, hz):
    assert with_vibrations(monkeypatch, 0.35, hz) >= 0.9 * PLATES
