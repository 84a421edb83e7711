"""How long real people stand, swing and step, and how plates lie, beside numbers that use it."""

import csv

import numpy as np
import pytest

from hbm.numbers import read_numbers
from pipeline.io.read import read_recording

FRAMES, PLATES = (
    read_numbers("pipeline.explain", "thresholds.toml", section) for section in ("frames", "plates")
)
CHECK = read_numbers("pipeline.run", "thresholds.toml", "check")
JOINTS = read_numbers("pipeline.report", "thresholds.toml", "joints")
RECORDINGS = (
    *("treadmill_hbm2/treadmill_events.c3d", "overground_walks/HC030A05.c3d"),
    *("overground_walks/HC031A06.c3d", "opensim_walking2/walking2.c3d", "c3d_samples/Gait.c3d"),
    *("plug_in_gait/Movement_trial.c3d", "legs_only/Qualisys.c3d"),
)


@pytest.fixture(scope="module")
def recordings(shared_data):
    return [read_recording(shared_data / name) for name in RECORDINGS]


def loaded_from_to(plate):
    """Begin and end of each load of a plate that begins and ends in the recording, (K, 2) [s]."""
    edges = np.flatnonzero(np.diff((plate.wrench[:, 2] > 30.0).astype(int)))
    begins_loaded = plate.wrench[0, 2] > 30.0
    edges = edges[int(begins_loaded) :]
    return edges[: len(edges) // 2 * 2].reshape(-1, 2) / plate.rate_hz


def test_each_stance_on_a_plate_is_longer_than_the_shortest_stretch_that_is_explained(recordings):
    loads = [loaded_from_to(plate) for each in recordings for plate in each.plates]
    stances = [end - start for load in loads for start, end in load if end - start > 0.1]
    assert len(stances) > 20
    assert FRAMES.shortest_stretch < 0.47 < min(stances)
    assert max(stances) < 1.1


def test_the_usual_swing_is_twice_the_shortest_one_that_shows_a_zero(recordings):
    loads = [loaded_from_to(plate) for plate in recordings[0].plates]
    swings = np.concatenate([load[1:, 0] - load[:-1, 1] for load in loads])
    assert np.median(swings) == pytest.approx(2 * PLATES.shortest_swing, abs=0.05)


def test_gait_cycles_of_adults_and_children_take_longer_than_the_shortest(recordings):
    cycles = []
    for recording in recordings:
        for side in ("left", "right"):
            of_side = [
                e.time for e in recording.events if (e.label, e.side) == ("foot_strike", side)
            ]
            cycles += list(np.diff(of_side))
    assert CHECK.shortest_cycle < 0.86 < min(cycles)
    assert max(cycles) < 1.2


def test_plates_are_square_to_the_axes_of_their_laboratories(recordings):
    cosines = [np.abs(p.rotation).max(axis=0).min() for each in recordings for p in each.plates]
    assert PLATES.parallel_cosine < 0.999 < min(cosines)


def test_of_the_moments_of_healthy_walking_only_that_about_the_long_axis_of_the_foot_is_small(
    shared_data,
):
    """Means of a clinic's normative walks: Pinzone et al. 2014."""
    peaks = {}
    with (shared_data / "normative_gait" / "pinzone_2014.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["quantity"] == "moment":
                size = abs(float(row["centre_one_mean"]))
                peaks[row["name"]] = max(peaks.get(row["name"], 0.0), size)
    assert [name for name, peak in peaks.items() if peak < JOINTS.least_peak] == [
        "Ankle Rotation Moment"
    ]
    assert sorted(peaks.values())[1] > 2 * JOINTS.least_peak
