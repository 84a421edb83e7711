"""The identification finds the parameters of a simulated drive, and writes what it read."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.virtual_lab.machine.belts import RotatingLine, identified_drive
from tests.virtual_machine import identify_belt
from tests.virtual_machine.belt_recording import simulate_recording
from tests.virtual_machine.identify_belt import FITTED, find_lines, fit


def test_a_known_roller_and_lines_are_found():
    drive = identified_drive()
    known = (RotatingLine(drive.turns_per_m, 0.4), *drive.lines)
    recording = simulate_recording(replace(drive, unbalance_kg_per_m=0.0, lines=known), 4.7, seed=3)
    found = find_lines(recording)
    turns, sizes = np.transpose(known)
    np.testing.assert_allclose(found.turns_per_m, turns, atol=0.002)
    np.testing.assert_allclose(found.amplitudes.mean(axis=1), sizes, atol=0.05)


@pytest.mark.slow
def test_parameters_of_a_simulated_drive_come_back_within_their_intervals(monkeypatch):
    """With one simulation instead of three a step, which widens the intervals."""
    monkeypatch.setattr(identify_belt, "SEEDS", identify_belt.SEEDS[:1])
    drive = identified_drive(np.random.default_rng(71))
    recording = simulate_recording(drive, 4.4, seed=71)
    found = fit(recording, find_lines(recording), identified_drive())
    for name, value, half in zip(FITTED, found.values, found.half_widths, strict=False):
        assert abs(getattr(drive, name) - value) < 1.5 * half, name
