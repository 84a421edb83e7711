"""The delay of a real treadmill's plates behind its markers."""

import numpy as np
import pytest

from compensation import low_pass, marker_plate_delay
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from pipeline.io.c3d.read import read_c3d


@pytest.fixture(scope="module")
def treadmill(shared_data):
    return read_c3d(shared_data / "treadmill_hbm2" / "treadmill_events.c3d")


def rough_centre_of_mass(markers):
    """Centre of mass from segment mid-points and de Leva's female masses; the arms do not swing."""

    def middle(*names):
        return markers.position[:, [markers.names.index(name) for name in names]].mean(axis=1)

    pelvis, trunk = middle("LASIS", "RASIS", "LPSIS", "RPSIS"), middle("C7", "JN", "T10", "XIPH")
    parts = [(0.1247, pelvis), (0.3010 + 0.0898, 0.75 * trunk + 0.25 * pelvis)]
    parts += [(0.0668, middle("C7", "JN"))]
    for s in "LR":
        hip, knee = middle(f"{s}ASIS", f"{s}PSIS"), middle(f"{s}LEK", f"{s}MEK")
        ankle = middle(f"{s}LM", f"{s}MM")
        parts += [(0.1478, hip + 0.3612 * (knee - hip)), (0.0481, knee + 0.4416 * (ankle - knee))]
        parts += [(0.0129, middle(f"{s}HEE", f"{s}MT2"))]
    return sum(mass * center for mass, center in parts) / sum(mass for mass, _ in parts)


def test_plates_of_a_real_treadmill_lag_its_markers_by_ten_to_twenty_milliseconds(treadmill):
    clock = treadmill.markers.time
    force = sum(plate.wrench[:, :3] for plate in treadmill.plates)
    force = low_pass(resample(treadmill.plates[0].time, force, clock), clock, 6, "zero_phase")
    mass = force[:, 2].mean() / 9.81
    centre = butterworth(rough_centre_of_mass(treadmill.markers), clock, 6, "zero_phase")
    motion = mass * (centre.acceleration + np.array([0, 0, 9.81]))
    found = marker_plate_delay(force, motion, clock)
    assert 0.010 < found.seconds < 0.020  # body_model.md 6.4, measured there with another model
    assert 0.001 < found.standard_error < 0.005
    halves = [
        marker_plate_delay(force[half], motion[half], clock[half]).seconds
        for half in (slice(0, 600), slice(600, None))
    ]
    assert abs(halves[0] - halves[1]) < found.standard_error
