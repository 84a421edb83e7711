"""Plates, times and labels that are just good enough, or just not, for what readers judge."""

import numpy as np
import pytest

from hbm.markers import marker_sets
from pipeline.io.c3d.force_plates import unit_of_corners
from pipeline.io.c3d.read import _with_faults_of_markers
from pipeline.io.columns import FileMarkers, PlateColumns, settle_markers, wrench_about_origin
from pipeline.io.labels import without_prefixes
from pipeline.io.mended_plates import find_overflows
from pipeline.io.qualisys import plate_at
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Plate
from pipeline.io.streams import find_clock
from pipeline.io.text_table import _grid
from tests.synthetic import synthetic_t_pose

UP = np.array([0.0, 0.0, 1.0])
POSE = synthetic_t_pose()


def plate(load_n, *, noise_m=0.0, moved_m=(0.0, 0.0), count=200):
    """A plate whose moments are about a point beside the origin, its centre of pressure noisy."""
    rng = np.random.default_rng(1)
    force = np.column_stack([*rng.uniform(-0.2, 0.2, (2, count)), np.ones(count)]) * load_n
    pressure = np.column_stack([*rng.uniform(-0.3, 0.3, (2, count)), np.zeros(count)])
    moment = np.cross(pressure - [*moved_m, 0.0], force)
    moment[:, 2] += rng.normal(size=count) * 0.01 * load_n
    pressure[:, :2] += rng.normal(size=(count, 2)) * noise_m
    return PlateColumns(1, "plate 1", np.arange(count) / 100, force, moment, pressure)


def where(columns):
    return wrench_about_origin(columns, UP)[1]


def test_noise_under_a_small_load_contradicts_no_plate():
    assert "unchecked" in where(plate(70.0, noise_m=0.02))


def test_a_child_of_fifteen_kilograms_shows_where_moments_are_about():
    assert "(0.000, 0.000, 0.000)" in where(plate(150.0))


@pytest.mark.parametrize(("count", "checked"), [(7, False), (15, True)])
def test_a_tenth_of_a_second_of_load_shows_where_moments_are_about(count, checked):
    assert ("unchecked" not in where(plate(700.0, count=count))) == checked


def test_noise_of_a_millimetre_moves_no_point_and_two_millimetres_do():
    assert "(0.000, 0.000, 0.000)" in where(plate(700.0, noise_m=1e-3))
    assert "(0.002, " in where(plate(700.0, noise_m=1e-3, moved_m=(0.002, 0.0)))


def test_moments_that_are_off_by_seven_millimetres_are_read_and_by_fifteen_refused():
    assert "within 7" in where(plate(700.0, noise_m=0.0062))
    with pytest.raises(ValueError, match=r"disagree by 1\d mm"):
        where(plate(700.0, noise_m=0.0125))


@pytest.mark.parametrize(("ratio", "said"), [(7e-4, 0), (1.5e-3, 1)])
def test_noise_by_hardly_a_force_is_far_away_and_of_a_little_force_is_damaged(ratio, said):
    columns = plate(1000.0)
    columns.force[:20], columns.pressure[:20] = [0, 0, 1000 * ratio], [60.0, 80.0, 0.0]
    assert len(columns.without_codes()) == said


@pytest.mark.parametrize(("off_m", "is_plate"), [(0.015, True), (0.03, False)])
def test_corners_that_miss_a_rectangle_by_fifteen_millimetres_are_a_plate(off_m, is_plate):
    corners = np.array([[0.6, 0.4, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.6, 0.0, 0.0]])
    corners[0, 0] += off_m
    if is_plate:
        plate_at(1, corners)
    else:
        with pytest.raises(ValueError, match="no rectangle"):
            plate_at(1, corners)


@pytest.mark.parametrize(("apart_m", "kind"), [(7e-4, "joined"), (1.5e-3, "in_doubt")])
def test_trajectories_of_one_label_that_differ_by_less_than_a_millimetre_are_copies(apart_m, kind):
    position = np.concatenate([POSE.position, POSE.position[:, :1] + [apart_m, 0.0, 0.0]], axis=1)
    labels = dict(enumerate([*POSE.names, POSE.names[0]]))
    notes = settle_markers(labels, "m", position, ReadOptions(), ()).notes
    assert [fact.kind for fact in notes] == [kind]


@pytest.mark.parametrize(("off", "regular"), [(0.07, True), (0.15, False)])
def test_times_that_are_off_by_less_than_a_tenth_of_an_interval_are_regular(off, regular):
    time = np.arange(500) / 128
    time[1::2] += off / 128
    assert (_grid(time, 128.0) is not None) == regular


@pytest.mark.parametrize("rate_hz", [120.0, 60.0, 59.94, 240.0])
def test_times_that_are_rounded_to_a_hundredth_of_a_second_have_their_rate(rate_hz):
    time = np.round(np.arange(600) / rate_hz, 2 + (rate_hz > 100))
    assert _grid(time, 0.0)[1] == pytest.approx(rate_hz, abs=0.05)


@pytest.mark.parametrize(("component", "range_of"), [(0, 14.0), (5, 1.4)])
def test_a_converter_of_a_tenth_of_what_walking_needs_is_found_to_overflow(component, range_of):
    time = np.arange(0, 6, 0.001)
    load = 0.8 * range_of * np.clip(np.sin(2 * np.pi * time), 0, None) ** 2
    load += np.random.default_rng(1).normal(size=len(time)) * 0.002 * range_of
    wrench = np.full((len(time), 6), 0.0)
    wrench[:, component] = (load + range_of / 2) % range_of - range_of / 2
    _, overflows = find_overflows(Plate.at_origin(1, time, wrench))
    assert [*overflows] == [component]


@pytest.mark.parametrize("name", ["hbm2", "helen_hayes_lower"])
def test_a_prefix_is_removed_of_the_smallest_set_and_not_of_a_few_labels(name):
    bare = [*marker_sets()[name].segment]
    labels = [f"S01_{label}" for label in bare]
    assert [*without_prefixes(labels, ReadOptions())[0].values()] == bare
    few = [*labels[:3], *(f"M{k}" for k in range(30))]
    assert [*without_prefixes(few, ReadOptions())[0].values()] == few


@pytest.mark.parametrize(
    ("frames", "height_m", "is_larger"), [(6, 0.1, False), (15, 0.1, True), (15, 0.25, False)]
)
def test_who_stands_on_a_plate_shows_its_size_and_who_swings_a_foot_over_it_does_not(
    frames, height_m, is_larger
):
    """Its corners are 60 mm apart by the file's unit, or 60 cm."""
    corners = 60.0 * np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0]])
    position = np.full((50, 1, 3), 5.0)
    position[:frames] = [0.3, 0.3, height_m]
    unit, facts = unit_of_corners(1, corners, 1e-3, position)
    assert (unit == 0.01) == is_larger == bool(facts)


@pytest.mark.parametrize(("count", "named"), [(8, False), (16, True)])
def test_faults_of_labels_are_named_beside_those_of_plates_where_somebody_wears_them(count, named):
    names = tuple(f"Own{k}" for k in range(count))
    markers = FileMarkers(names, np.random.default_rng(0).normal(size=(20, count, 3)), "m", ())
    fault = _with_faults_of_markers(ValueError("plate 1: volts"), markers, ReadOptions())
    assert str(fault).endswith("plate 1: volts")
    assert ("Own0" in str(fault)) == named


@pytest.mark.parametrize("again", [1, 2])
def test_one_or_two_samples_that_come_again_beside_a_loss_are_said_to_and_fill_it_not(again):
    frames = np.delete(np.arange(1000), slice(500, 500 + again))
    values, places = np.sin(frames / 7)[:, None], [500] * again
    stamps = np.insert(frames / 100.0, places, 4.99 + 1e-4 * np.arange(1, again + 1))
    clock = find_clock(stamps, 100.0, np.insert(values, places, values[499], axis=0))
    assert [fact.kind for fact in clock.facts] == ["joined", "missing"]
