"""A sender that comes back is compared by what numbers depend on, and what differs is named."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Plate
from pipeline.io.streams import Channel
from pipeline.live.lsl import read_description, require_like
from pipeline.live.output import describe

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
        self._root.append(describe("", "", channels, rate_hz, parts, plates).find("desc"))

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
    return read_description(sent, stated or ReadOptions(), is_markers=True)


def plates(*arguments, **options):
    sent = Sent(*arguments, **options)
    return read_description(sent, ReadOptions(axes="forward,left,up"), is_markers=False)


CHANNELS, AXES, PLATES = "description of its channels", "statement of its axes", "description of"


def same(after, before):
    require_like(before, after)


@pytest.mark.parametrize(
    ("after", "other"),
    [
        (markers(MARKERS[3:] + MARKERS[:3]), CHANNELS),
        (markers(tuple(replace(channel, unit="m") for channel in MARKERS)), CHANNELS),
        (markers(MARKERS, 200.0), "rate"),
        (markers(MARKERS, axes="right,up,back"), AXES),
    ],
)
def test_markers_that_are_described_otherwise_are_refused_in_one_line(after, other):
    with pytest.raises(ValueError, match=f"^stream 'Stream' .*another {other}; "):
        same(after, markers(MARKERS))


@pytest.mark.parametrize("rate_hz", [1e9, np.inf, np.nan, -5.0, 0.01])
@pytest.mark.parametrize(
    "described", [lambda rate: markers(MARKERS, rate), lambda r: plates(SIX, r)]
)
def test_a_rate_that_no_instrument_has_is_refused_in_one_line(described, rate_hz):
    with pytest.raises(ValueError, match=r"Stream .*Hz, .* 1 to 50000"):
        described(rate_hz)


def test_two_plates_of_one_number_are_none():
    for twice in (plates(SIX * 2, plates=[plate()]), plates(SIX, plates=[plate(), plate()])):
        (only,) = twice.plates
        assert only.place is None
        assert re.search("ForceX: 1, 7, | 2 places", only.problem)


def test_axes_of_the_sender_do_not_matter_where_a_person_states_them():
    stated = ReadOptions(axes="left,back,up")
    before = markers(MARKERS, stated=stated)
    same(markers(MARKERS, axes="right,up,back", stated=stated), before)
    same(markers(MARKERS, form="double64"), markers(MARKERS))


def test_a_plate_that_lies_elsewhere_is_refused():
    before = plates(SIX, 1000.0, plates=[plate()])
    same(plates(SIX, 1000.0, plates=[plate(center=(1e-9, 0, 0))]), before)
    with pytest.raises(ValueError, match=PLATES):
        same(plates(SIX, 1000.0, plates=[plate(center=(0.01, 0, 0))]), before)
