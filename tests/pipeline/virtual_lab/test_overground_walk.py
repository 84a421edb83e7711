"""Walks over plates in a floor obey physics, and are processed like any recording."""

import numpy as np
import pytest

from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Settings, Subject
from pipeline.trial.process import process_recording
from pipeline.virtual_lab.faults import Faults
from tests.overground_walk import PLATE_M, simulate_overground


@pytest.fixture(scope="module")
def perfect():
    return simulate_overground(faults=Faults.none(), seed=3)


@pytest.fixture(scope="module")
def processed(perfect):
    settings = Settings(cutoff_hz=20.0)
    return process_recording(perfect.walk, Subject(sex="male"), settings, static=perfect.static)


def test_a_perfect_laboratory_leaves_no_residual(processed):
    residual = processed.variants["measured"].residual[processed.counts]
    assert len(residual) > 90
    assert np.abs(residual).max() < 4.0


def test_the_static_weighs_the_person(perfect, processed):
    weight_n = sum(plate.wrench_in_plate[:, 2] for plate in perfect.static.plates).mean()
    assert weight_n / GRAVITY_MPS2 == pytest.approx(perfect.subject.person.mass_kg, rel=1e-3)
    assert processed.body.mass == pytest.approx(perfect.subject.person.mass_kg, rel=1e-3)


def test_one_step_is_on_each_plate_and_its_pressure_within_the_plate(perfect):
    for plate in perfect.walk.plates:
        fx, fy, fz, mx, my, _ = plate.wrench_in_plate.T
        loaded = fz > 0.1 * fz.max()
        assert np.count_nonzero(np.diff(loaded)) == 2
        pressure = np.column_stack([-my, mx])[loaded] / fz[loaded, None]
        assert (np.abs(pressure) < np.array(PLATE_M) / 2).all()
        assert fx[loaded][:100].mean() < 0 < fx[loaded][-150:].mean()
        assert np.abs(fy).max() < fx.max()


def test_the_subject_walks_across_at_the_stated_speed(perfect):
    markers = perfect.walk.markers
    pelvis = markers.position[:, markers.names.index("LASIS"), 0]
    speed = np.polyfit(markers.time, pelvis, 1)[0]
    assert speed == pytest.approx(1.25, abs=0.03)


def test_equal_seeds_give_equal_recordings(perfect):
    again = simulate_overground(faults=Faults.none(), seed=3)
    assert np.array_equal(again.walk.markers.position, perfect.walk.markers.position)
    for one, other in zip(again.walk.plates, perfect.walk.plates, strict=True):
        assert np.array_equal(one.wrench_in_plate, other.wrench_in_plate)
