"""Plates lie where streams state them now, else where the static recording has them."""

from contextlib import closing
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hbm.spatial import rotate_wrench
from pipeline.config.live import Live
from pipeline.config.schema import Settings, Treadmill
from pipeline.io.axes import parse_axes
from pipeline.io.read import read_recording
from pipeline.io.streams import Channel, parse_channels
from pipeline.live.ground import AnalogStreams, LiveGround
from pipeline.live.output import XdfWriter, describe_stream
from pipeline.live.preparation import place_plates
from pipeline.live.replay import RecordedSource
from pipeline.live.stream import (
    DescribedPlate,
    Samples,
    StreamDescription,
    describe_plates,
    describe_signals,
)
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline import xdf_file as xdf


@pytest.fixture(scope="module")
def stated(walker):
    return RecordedSource(walker).plates


def moved(stated, shift_m, angle_deg, axis="z"):
    """The same plates somewhere else."""
    turn = Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix()
    found = []
    for each in stated:
        place, center = each.place, each.place.center + shift_m
        corners = center + (place.corners - place.center) @ turn.T
        other = replace(place, rotation=turn @ place.rotation, center=center, corners=corners)
        found.append(replace(each, place=other))
    return tuple(found)


def test_where_streams_state_no_place_that_of_the_static_file_is_used(walker, stated):
    (only,) = place_plates(stated[1:], None, Live()).plates
    assert only.number == 2
    one, two = place_plates(stated[1:], walker, Live()).plates
    np.testing.assert_array_equal(one.center, walker.plates[0].center)
    np.testing.assert_array_equal(two.center, walker.plates[1].center)


@given(st.floats(-0.02, 0.02), st.floats(-4, 4), st.sampled_from("xyz"), st.sampled_from([0, 1, 2]))
def test_a_place_that_differs_is_noted_and_that_of_the_stream_is_used(
    walker, stated, shift_m, angle_deg, axis, along
):
    shift = np.eye(3)[along] * shift_m
    found = place_plates(moved(stated, shift, angle_deg, axis), walker, Live())
    for ours, true in zip(found.plates, walker.plates, strict=True):
        np.testing.assert_array_equal(ours.center, true.center + shift)
    if abs(abs(shift_m) - 0.003) < 1e-6 or abs(abs(angle_deg) - 0.5) < 1e-3:
        return
    differs = abs(shift_m) > 0.003 or abs(angle_deg) > 0.5
    assert [note.code for note in found.notes] == ["live_plate_elsewhere"] * 2 * differs
    for note in found.notes:
        assert note.values["distance_m"] == pytest.approx(abs(shift_m), abs=1e-9)
        assert note.values["angle_deg"] == pytest.approx(abs(angle_deg), abs=1e-3)


def test_a_static_file_that_knows_no_place_contradicts_none(walker, stated):
    """As files of D-Flow, whose wrenches are about the origin of the lab."""
    unplaced = [type(p).at_origin(p.number, p.time, p.wrench) for p in walker.plates]
    found = place_plates(stated, replace(walker, plates=tuple(unplaced)), Live())
    assert found.notes == ()
    np.testing.assert_array_equal(found.plates[0].center, walker.plates[0].center)


def test_channels_are_those_of_the_study_then_of_the_streams_then_the_usual_ones(walker):
    six = tuple("abcdef")
    streams = [DescribedPlate("1", six), DescribedPlate("2", six)]
    live = place_plates(streams, walker, Live(plates={"2": tuple("uvwxyz")})).live
    assert live.channels_of(1) == six
    assert live.channels_of(2) == tuple("uvwxyz")
    assert live.channels_of(3)[2] == "FP3.Fz"


def test_one_plate_that_two_streams_state_is_refused(stated):
    with pytest.raises(ValueError, match=r"several streams .*plate 1"):
        place_plates([*stated, stated[0]], None, Live())


def described(plates, channels=None):
    """Plates as `describe_plates` gives them from a stream in the axes of D-Flow."""
    every = channels or [c for plate in plates for c in xdf.plate_channels(plate.number)]
    places = "".join(map(xdf.plate_place, plates))
    desc = xdf.described(every, f"<plates>{places}</plates>")
    info = ElementTree.fromstring(f"<info><desc>{desc}</desc></info>")
    return describe_plates(info, parse_channels(info, len(every)), "right,up,back")


def test_a_description_is_in_the_axes_of_the_markers(walker):
    to_lab = parse_axes("right,up,back")
    sent = [
        replace(
            p, rotation=to_lab.T @ p.rotation, center=p.center @ to_lab, corners=p.corners @ to_lab
        )
        for p in walker.plates
    ]
    for ours, true in zip(described(sent), walker.plates, strict=True):
        assert ours.channels == tuple(c["label"] for c in xdf.plate_channels(true.number))
        np.testing.assert_allclose(ours.place.rotation, true.rotation, atol=1e-12)
        np.testing.assert_allclose(ours.place.center, true.center, atol=1e-12)
        np.testing.assert_allclose(ours.place.corners, true.corners, atol=1e-12)


def test_a_damaged_description_is_no_place_and_says_why(walker):
    plate = walker.plates[0]
    (turned,) = described([replace(plate, rotation=np.ones((3, 3)))])
    assert turned.place is None
    assert "no rotation" in turned.problem
    (nowhere,) = described([replace(plate, center=np.full(3, np.nan))])
    assert nowhere.place is None


def test_channels_of_a_plate_need_labels_of_their_own(walker):
    channels = xdf.plate_channels(1)
    channels[5]["label"] = "FP1.FZ"
    with pytest.raises(ValueError, match="another"):
        described(walker.plates[:1], channels)


@pytest.fixture(scope="module")
def as_dflow(walker):
    """The walker's plates as D-Flow sends them: about the origin of its axes; labels and values."""
    to_lab = parse_axes("right,up,back")
    labels = [f"FP{p.number}.{q}{a}" for p in walker.plates for q in ("For", "Mom") for a in "XYZ"]
    values = np.hstack([rotate_wrench(p.wrench, to_lab.T) for p in walker.plates])
    return [Channel(label, "N" if ".For" in label else "Nm") for label in labels], values


def on_the_ground(stream, values, walker, placed):
    """The plates' wrenches in the lab at 2.5 s."""
    analog = AnalogStreams([stream])
    six = [placed.live.channels_of(plate.number) for plate in placed.plates]
    still, cameras = Laboratory(Treadmill()), StreamDescription("Markers", "markers", (), (), 100.0)
    ground = LiveGround(still, Settings(), placed.plates, six, analog, cameras)
    analog.append(Samples("Plates", walker.plates[0].time[:3000], values[:3000]))
    return ground.at(2.5, None)[0][0]


def test_plates_named_as_in_dflow_are_about_the_origin_whatever_the_static_file_says(
    walker, stated, as_dflow
):
    channels, values = as_dflow
    stream, convert = describe_signals("Plates", channels, 1000.0, "right,up,back")
    of_dflow = describe_plates(ElementTree.Element("info"), channels, "right,up,back")
    _, own = RecordedSource(walker).streams
    in_plates = np.hstack([plate.wrench_in_plate for plate in walker.plates])
    expected = on_the_ground(own, in_plates, walker, place_plates(stated, None, Live()))
    for static in (None, walker):
        placed = place_plates(of_dflow, static, Live())
        assert placed.notes == ()
        found = on_the_ground(stream, convert(values), walker, placed)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_recorded_session_of_plates_named_as_in_dflow_is_read_back(walker, as_dflow, tmp_path):
    channels, values = as_dflow
    stream, convert = describe_signals("Plates", channels, 1000.0, "right,up,back")
    placed = place_plates(
        describe_plates(ElementTree.Element("info"), channels, "right,up,back"), None, Live()
    )
    markers = RecordedSource(walker).streams[0]
    described = [describe_stream(each, placed.live, placed.plates) for each in [markers, stream]]
    with closing(XdfWriter(tmp_path / "a.xdf", described)) as writer:
        seen = walker.markers
        writer.write(Samples("Markers", seen.time, seen.position.reshape(len(seen.time), -1)))
        writer.write(Samples("Plates", walker.plates[0].time, convert(values)))
    for ours, true in zip(read_recording(tmp_path / "a.xdf").plates, walker.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-9)


def test_where_the_study_names_other_channels_the_streams_place_is_not_theirs(walker, as_dflow):
    stated = describe_plates(ElementTree.Element("info"), as_dflow[0], "right,up,back")
    placed = place_plates(stated, walker, Live(plates={"1": tuple("abcdef")}))
    np.testing.assert_array_equal(placed.plates[0].center, walker.plates[0].center)
    np.testing.assert_array_equal(placed.plates[1].center, np.zeros(3))
