"""What real recordings have of what readers judge, and how far the limits are from it."""

import numpy as np
import pytest

from hbm.numbers import read_numbers
from pipeline.io.axes import above_feet, between, find_sites, typical
from pipeline.io.read import read_recording

AXES, POSITIONS, PLATES = (
    read_numbers("pipeline.io", "thresholds.toml", section)
    for section in ("axes", "positions", "plates")
)
RECORDINGS = (
    *(f"overground_walks/{name}.c3d" for name in ("HC030A01", "HC030A05", "HC031A01", "HC031A06")),
    *("plug_in_gait/Movement_trial.c3d", "plug_in_gait/Static_trial.c3d"),
    *("full_body_standing/1min_CGM_HBM_static.c3d", "legs_only/Qualisys.c3d"),
    *("opensim_walking2/walking2.c3d", "c3d_samples/pc_int.c3d", "c3d_samples/Gait.c3d"),
    *("opensim_subject01/subject01_walk1.trc", "opensim_subject01/subject01_static.trc"),
    *("opencap_subject4/walking1.trc", "opencap_subject4/static1.trc"),
    *("opencap_subject4/squats1.trc", "treadmill_hbm2/treadmill_events.c3d"),
)


@pytest.fixture(scope="module")
def recordings(shared_data):
    return [read_recording(shared_data / name) for name in RECORDINGS]


def to_axis_deg(vector):
    return np.degrees(np.arccos(np.abs(vector).max() / np.linalg.norm(vector)))


def test_positions_are_within_the_limits(recordings):
    spans, farthest, above = [], [], []
    for recording in recordings:
        position, names = recording.markers.position, recording.markers.names
        above.append(np.linalg.norm(above_feet(position, find_sites(names)), axis=1))
        size = np.fmax.reduce(position, axis=1) - np.fmin.reduce(position, axis=1)
        spans.append(np.nanmedian(np.linalg.norm(size, axis=1)))
        farthest.append(np.nanmax(np.abs(position)))
    assert min(spans) > 1.5
    assert max(spans) < 2.3
    least, largest = POSITIONS.spans
    assert max(spans) / 100 < least < min(spans)
    assert max(spans) < largest < 100 * min(spans)
    above = [np.nanmedian(each) for each in above if np.isfinite(each).any()]
    least, largest = POSITIONS.above_feet
    assert max(above) / 10 < least < 0.68 < min(above)
    assert max(above) < 1.3 < largest < 10 * min(above)
    assert max(farthest) < 4.3 < POSITIONS.farthest


def test_directions_are_nearer_to_an_axis_than_the_limits(recordings):
    angles, facing, cosines, ratios = [], [], [], []
    for recording in recordings:
        position, sites = recording.markers.position, find_sites(recording.markers.names)
        across = between(position, sites.across.values()) * [1, 1, 0]
        by_pair, length = typical(across), np.linalg.norm(across, axis=-1)
        angles.append(to_axis_deg(by_pair.mean(axis=0)))
        facing.append(np.mean(across[np.isfinite(across).all(axis=-1)][:, 1] > 0))
        cosines.append((by_pair[:, 1] / np.linalg.norm(by_pair, axis=1)).min())
        ratios.append(np.nanmax(length / np.nanmedian(length, axis=0)))
    assert max(angles) < 6 < AXES.largest_angle_to_axis
    assert min(facing) == 1 > AXES.least_facing_one_way
    assert min(cosines) > 0.6 > AXES.largest_cosine_exchanged
    assert max(ratios) < 1.5 < AXES.largest_length_ratio


@pytest.mark.parametrize("name", ["HC030A22", "HC031A23"])
def test_a_walk_that_turns_is_along_no_axis(shared_data, name):
    with pytest.raises(ValueError, match="more than 30° away from every axis"):
        read_recording(shared_data / f"overground_walks/{name}.c3d")


def test_plates_are_within_the_limits(recordings):
    plates = [plate for recording in recordings for plate in recording.plates]
    loads = np.array(
        [np.linalg.norm(plate.wrench_in_plate[:, :3].mean(axis=0)) for plate in plates]
    )
    forces = np.array([np.abs(plate.wrench_in_plate[:, :3]).max() for plate in plates])
    edges = np.array([np.linalg.norm(np.diff(p.corners[:3], axis=0), axis=1) for p in plates])
    errors = [np.linalg.norm(plate.corners.T @ [1, -1, 1, -1]) for plate in plates]
    depths = [np.linalg.norm(plate.transducer) for plate in plates]
    stepped_on = forces > 100
    assert loads[~stepped_on].max() < 6 < AXES.least_mean_load
    assert loads[stepped_on].min() > 25
    assert np.median(loads[stepped_on]) > AXES.least_mean_load
    assert forces.max() < 1300 < AXES.largest_force
    assert edges.min() > 0.29
    assert edges.max() < 1.75
    for limits in (PLATES.usual_edges, PLATES.possible_edges, PLATES.likely_edges):
        assert limits[0] < edges.min()
        assert edges.max() < limits[1]
    assert max(errors) < 1e-3 < PLATES.largest_corner_error < PLATES.largest_disorder
    assert PLATES.origin_distances[0] < 0.02 < min(depths)
    assert max(depths) < 0.26 < PLATES.origin_distances[1]
