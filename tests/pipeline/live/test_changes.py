"""A sender that comes back: what numbers depend on is compared, and what differs is named."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.io.recording import Plate
from pipeline.io.stated import Stated
from pipeline.io.xdf.channels import Channel
from pipeline.live.description import describe
from pipeline.live.sources.changes import came_back, change_of_plates, change_of_streams
from pipeline.live.sources.lsl_description import read_description
from pipeline.live.stream import StreamDescription

MARKERS = tuple(
    Channel(f"{name}_{axis}", "mm", f"Position{axis}", marker=name)
    for name in ("LASIS", "RASIS")
    for axis in "XYZ"
)
SIX = tuple(
    Channel(f"FP1.{what}{axis}", unit, f"{kind}{axis}", plate="1")
    for what, unit, kind in (("F", "N", "Force"), ("M", "N·m", "Moment"))
    for axis in "XYZ"
)
CORNERS = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]])


def plate(center=(0.0, 0.0, 0.0)):
    empty = np.empty(0)
    place = np.eye(3), np.array(center), CORNERS + center
    return Plate(1, empty, empty.reshape(0, 6), *place)


class Sent:
    """What a stream says of itself, as the library gives it."""

    def __init__(self, channels, rate_hz=100.0, axes="", plates=(), form="float32"):
        self._channels, self._rate_hz = channels, rate_hz
        self._root = ElementTree.Element("info")
        ElementTree.SubElement(self._root, "channel_format").text = form
        parts = [("axes", axes)] if axes else []
        self._root.append(describe(channels, parts, plates))

    def name(self):
        return "Stream"

    def channel_count(self):
        return len(self._channels)

    def nominal_srate(self):
        return self._rate_hz

    def as_xml(self):
        return ElementTree.tostring(self._root, encoding="unicode")


def markers(*arguments, axes="forward,left,up", stated=None, **options):
    sent = Sent(*arguments, axes=axes, **options)
    return read_description(sent, stated or Stated(), is_markers=True)


def plates(*arguments, **options):
    sent = Sent(*arguments, **options)
    return read_description(sent, Stated(axes="forward,left,up"), is_markers=False)


@pytest.mark.parametrize(
    ("after", "change"),
    [
        (markers(MARKERS, form="double64"), ""),
        (markers(MARKERS[:3]), "3 channels, before 6"),
        (
            markers(MARKERS[3:] + MARKERS[:3]),
            "'RASIS_X' as label of channel 1, before 'LASIS_X'",
        ),
        (
            markers(tuple(replace(channel, unit="m") for channel in MARKERS)),
            "'m' as unit of channel 1, before 'mm'",
        ),
        (
            markers(MARKERS, 200.0),
            "a rate of 200 Hz, before 100 Hz",
        ),
        (
            markers(MARKERS, axes="right,up,back"),
            "axes 'right,up,back', before 'forward,left,up'",
        ),
    ],
)
def test_of_markers_the_first_difference_is_named(after, change):
    assert after.change_from(markers(MARKERS)) == change


def test_axes_of_the_sender_do_not_matter_where_a_person_states_them():
    stated = Stated(axes="left,back,up")
    before = markers(MARKERS, stated=stated)
    assert markers(MARKERS, axes="right,up,back", stated=stated).change_from(before) == ""


@pytest.mark.parametrize(
    ("sent", "change"),
    [
        ([plate()], ""),
        ([plate(center=(1e-9, 0, 0))], ""),
        ([plate(center=(0.01, 0, 0))], "another place of plate 1"),
        ([], "another place of plate 1"),
    ],
)
def test_a_plate_that_lies_elsewhere_is_named(sent, change):
    after, before = plates(SIX, 1000.0, plates=sent), plates(SIX, 1000.0, plates=[plate()])
    assert after.change_from(before) == change


def test_types_of_channels_and_numbers_of_plates_are_compared():
    before = plates(SIX, 1000.0, plates=[plate()])
    swapped = (replace(SIX[0], type="ForceY"), replace(SIX[1], type="ForceX"), *SIX[2:])
    change = plates(swapped, 1000.0, plates=[plate()]).change_from(before)
    assert change == "'ForceY' as type of channel 1, before 'ForceX'"
    assert change_of_plates(before.plates, ()) == "plates none, before 1"


def test_streams_of_one_program_are_compared_by_names_labels_units_and_rates():
    before = StreamDescription("Left", "analog", ("Fx", "Fy"), ("N", "N"), 1000.0)
    changes = {
        "Right, before Left": {"name": "Right"},
        "'Fz' as label of channel 2, before 'Fy', of Left": {"labels": ("Fx", "Fz")},
        "a rate of 500 Hz, before 1000 Hz, of Left": {"rate_hz": 500.0},
    }
    assert change_of_streams([before], [before]) == ""
    for change, parts in changes.items():
        assert change_of_streams([before], [replace(before, **parts)]) == change


def test_the_error_is_one_line_that_says_what_next():
    change = markers((replace(MARKERS[0], label="A\nB"), *MARKERS[1:])).change_from(
        markers(MARKERS)
    )
    said = str(came_back("stream 'Markers'", change))
    assert said.isprintable()
    assert said.endswith("; begin a new session")
