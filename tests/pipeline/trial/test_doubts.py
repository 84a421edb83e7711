"""A recording with one fault is processed, and doubted by name."""

from dataclasses import replace

import pytest

from hbm.markers import marker_sets
from pipeline.config.schema import Settings, Subject
from pipeline.trial.gait.events import zeni_events
from pipeline.trial.process import process_recording
from tests.hbm.motions import held, relabelled, without
from tests.pipeline.other_formats import excerpt
from tests.pipeline.trial.test_event_check import other_side, shifted

PERSON = Subject(id="sub01", sex="male")
CLUSTER = ("LLEK", "RLEK"), ("LMEK", "RMEK"), ("LLTHI", "RLTHI")
HEELS = ("LHEE", "RHEE")


def warned(recording, *, static=None):
    """Codes of the warnings on a recording."""
    result = process_recording(recording, PERSON, Settings(), static=static)
    return {note.code for note in result.notes if note.level == "warning"}


def test_a_good_recording_is_not_doubted(walker):
    found = zeni_events(walker.markers, marker_sets()["hbm2"])
    assert warned(replace(walker, events=found), static=walker) == set()


@pytest.mark.parametrize(
    ("markers", "codes"),
    [
        (lambda m: relabelled(m, *CLUSTER), {"sides_exchanged", "joint_angles_impossible"}),
        (lambda m: held(m, slice(100, 150), m.names), {"markers_frozen"}),
        (lambda m: held(m, slice(0, 500), ["LMT5"]), {"markers_constant"}),
    ],
)
def test_faulty_markers_are_doubted(walker, markers, codes):
    short = excerpt(walker, 600, 1100)
    assert codes <= warned(replace(short, markers=markers(short.markers)), static=walker)


def test_a_static_pose_with_exchanged_labels_is_doubted_and_not_the_walk(walker):
    pose = replace(walker, markers=relabelled(walker.markers, HEELS))
    named = replace(pose, source=walker.source.with_name("pose.c3d"))
    result = process_recording(walker, PERSON, Settings(), static=named)
    notes = [note for note in result.notes if note.code == "sides_exchanged"]
    assert [note.values["recording"] for note in notes] == ["pose.c3d"]


@pytest.mark.parametrize(
    ("events", "code"),
    [
        (other_side, "events_of_other_side"),
        (lambda e: shifted(e, 0.25), "events_offset"),
    ],
)
def test_wrong_gait_events_are_doubted(walker, events, code):
    found = zeni_events(walker.markers, marker_sets()["hbm2"])
    assert warned(replace(walker, events=events(found))) == {code}


def test_missing_samples_and_unsolved_frames_are_counted_apart(walker):
    """Ten gaps of one marker, and twenty frames without any."""
    markers = without(walker.markers, ["LHEE"], slice(600, 610))
    gaps = replace(walker, markers=without(markers, markers.names, slice(700, 720)))
    notes = process_recording(gaps, PERSON, Settings()).notes
    (found,) = [note.values for note in notes if note.code == "gaps"]
    assert found == {"samples": 10, "unsolved": 20, "frames": 1200}


def half_without_minutes(events):
    """Of a recording that begins 54 s after its clock."""
    return tuple(replace(e, time=(e.time + 54) % 60 - 54) for e in events)


@pytest.mark.parametrize("wrong", [lambda e: shifted(e, 60.0), half_without_minutes])
def test_events_that_contradict_the_feet_are_replaced_and_a_warning_says_so(walker, wrong):
    sound = zeni_events(walker.markers, marker_sets()["hbm2"])
    detected = process_recording(replace(walker, events=()), PERSON, Settings())
    result = process_recording(replace(walker, events=wrong(sound)), PERSON, Settings())
    assert {n.code for n in result.notes if n.level == "warning"} == {"events_contradicted"}
    assert result.events == detected.events
    codes = {note.code for note in result.notes}
    assert "events_calibrated" in codes
    assert "events_of_file" not in codes


def test_who_insists_on_events_beyond_the_markers_reads_why_there_is_no_gait_cycle(walker):
    late = replace(walker, events=shifted(zeni_events(walker.markers, marker_sets()["hbm2"]), 60.0))
    result = process_recording(late, PERSON, Settings(events="file"))
    assert result.span is not None
    (note,) = [note for note in result.notes if note.code == "gait_cycles_left_out"]
    assert "0 left and 0 right" in note.text
    (note,) = [note for note in result.notes if note.code == "events_contradicted"]
    assert "the file's are used" in note.text
