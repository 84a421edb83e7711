"""Simulated people shake the plates as much more than a real treadmill's as its page states."""

from pathlib import Path

import numpy as np
import pytest

from tests.virtual_machine.swing import MACHINES, by_real

PAGE = Path(__file__).resolve().parents[3] / "validation" / "validity.md"


@pytest.fixture(scope="module")
def real(shared_data):
    return shared_data / "treadmill_hbm2" / "treadmill_events.c3d"


def stated(machine):
    """What the page states of a machine, (6,)."""
    (row,) = [
        line
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.strip().startswith(f"| {machine} |")
    ]
    return np.array([float(cell) for cell in row.split("|")[2:8]])


@pytest.mark.parametrize("machine", ["default", "default, belts without roughness"])
def test_people_shake_the_empty_plate_by_as_much_more_than_a_real_one_as_the_page_states(
    real, machine
):
    np.testing.assert_allclose(by_real(MACHINES[machine], real), stated(machine), rtol=0.1)
