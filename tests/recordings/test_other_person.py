"""A static recording of another person is named as the reason; that of the same person never is."""

from dataclasses import replace

import pytest

from pipeline.config.schema import Settings, Subject
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.process import process_recording
from tests.hbm.motions import displaced

AXES = "left,back,up"
EXPLAINED = {
    *("marker_distances_changed", "marker_error_large"),
    *("joint_angles_impossible", "mass_differs"),
}
"""What a pose of another person causes."""
CHILDREN = [("HC030A05", "HC030A01"), ("HC031A06", "HC031A01")]


def read(folder, name):
    return read_c3d(folder / "overground_walks" / f"{name}.c3d", AXES)


def notes_of(trial, static):
    result = process_recording(trial, Subject(), Settings(), static=static)
    return {note.code: note for note in result.notes}


@pytest.mark.parametrize(("walk", "static"), CHILDREN)
def test_a_childs_own_static_is_not_doubted(shared_data, walk, static):
    assert "static_of_another" not in notes_of(read(shared_data, walk), read(shared_data, static))


@pytest.mark.parametrize(("walk", "static"), [("HC030A05", "HC031A01"), ("HC031A06", "HC030A01")])
def test_the_static_of_another_child_is_named_once(shared_data, walk, static):
    notes = notes_of(read(shared_data, walk), read(shared_data, static))
    other = notes["static_of_another"]
    assert other.level == "warning"
    assert other.values["file"] == f"{static}.c3d"
    assert not EXPLAINED & set(notes)


@pytest.mark.parametrize("names", [("LTOE", "RTOE"), ("LASI",)])
def test_markers_that_were_moved_are_not_another_person(shared_data, names):
    walk, static = (read(shared_data, name) for name in CHILDREN[0])
    markers = static.markers
    for name in names:
        markers = displaced(markers, name, [0.04, 0.04, 0.0])
    assert "static_of_another" not in notes_of(walk, replace(static, markers=markers))
