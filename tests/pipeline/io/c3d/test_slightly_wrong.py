"""What is unambiguous in a slightly wrong file is read with a note, and the rest is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from pipeline.io.c3d.read import merge_events, read_c3d
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Event

AXES = "forward,left,up"
FRAMES, CHANNELS, PER_FRAME = 20, 6, 10
RNG = np.random.default_rng(3)
POSITION = RNG.normal(500, 400, (FRAMES, 2, 4)) * [1, 1, 1, 0]
SAMPLES = RNG.normal(size=(FRAMES, PER_FRAME, CHANNELS))
MADE_TO_ORDER = settings(
    max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def made(raw_c3d, position=POSITION, samples=SAMPLES, **change):
    change["POINT"] = {"LABELS": ["A", "B"]} | change.get("POINT", {})
    return raw_c3d(position, samples, **change)


def codes(recording):
    return {note.code for note in recording.notes} - {"axes"}


# Rates


@pytest.mark.parametrize("rate", [0.0, np.nan, 1e9])
@pytest.mark.parametrize("place", ["POINT", "ANALOG", "header"])
def test_a_place_that_states_no_rate_is_noted_and_the_others_are_used(raw_c3d, place, rate):
    change = (
        {"header": {"rate": rate}} if place == "header" else {place: {"RATE": np.array([rate])}}
    )
    path = made(raw_c3d, **change)
    recording = read_c3d(path, AXES)
    assert recording.markers.rate_hz == pytest.approx(100)
    assert recording.analog.rate_hz == pytest.approx(1000)
    assert codes(recording) == {"corrected"}


@given(factor=st.floats(0.02, 50), channels=st.booleans())
@MADE_TO_ORDER
def test_rates_of_which_no_two_agree_are_refused(raw_c3d, factor, channels):
    assume(all(abs(factor / other - 1) > 0.0042 for other in (1, 2)))
    samples = SAMPLES if channels else np.zeros((FRAMES, 1, 0))
    change = {"POINT": {"RATE": np.array([100 * factor])}, "ANALOG": {"RATE": np.array([2000.0])}}
    with pytest.raises(ValueError, match="Hz on which most"):
        read_c3d(made(raw_c3d, samples=samples, **change), AXES)


def test_the_rate_of_video_may_be_rounded(raw_c3d):
    recording = read_c3d(made(raw_c3d, rate=60.0, POINT={"RATE": np.array([59.94])}), AXES)
    assert recording.markers.rate_hz == pytest.approx(59.94)
    assert codes(recording) == {"corrected"}


# Offsets and scales


@pytest.mark.parametrize("absent", ["ANALOG:OFFSET", "ANALOG:SCALE"])
def test_without_offsets_or_scales_real_samples_are_in_their_units(raw_c3d, absent):
    path = made(raw_c3d, absent=(absent,))
    recording = read_c3d(path, AXES)
    np.testing.assert_allclose(recording.analog.values, SAMPLES.reshape(-1, CHANNELS), rtol=1e-6)
    assert codes(recording) == {"corrected"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"absent": ("ANALOG:SCALE",), "scale": 0.1}, "ANALOG:SCALE has 0 .* 6 analog"),
        ({"absent": ("ANALOG:SCALE", "ANALOG:UNITS")}, "ANALOG:SCALE has 0 .* 6 analog"),
        ({"ANALOG": {"SCALE": np.ones(2)}}, "ANALOG:SCALE has 2 .* 6 analog"),
        (
            {"absent": ("ANALOG:OFFSET",), "scale": 0.1, "ANALOG": {"FORMAT": "UNSIGNED"}},
            "ANALOG:OFFSET has 0 .* 6 analog",
        ),
    ],
)
def test_samples_whose_size_is_unknown_are_refused(raw_c3d, change, message):
    with pytest.raises(ValueError, match=message):
        read_c3d(made(raw_c3d, **change), AXES)


# Units


@pytest.mark.parametrize("unit", ["", "in"])
def test_a_unit_that_is_unknown_is_stated_by_the_person(raw_c3d, unit):
    path = made(raw_c3d, POINT={"UNITS": unit})
    with pytest.raises(ValueError, match=r"--units.*study\.toml"):
        read_c3d(path, AXES)
    recording = read_c3d(path, ReadOptions(AXES, units="mm"))
    np.testing.assert_allclose(recording.markers.position, POSITION[..., :3] / 1000, rtol=1e-5)


# Points or channels alone


def test_channels_without_points_are_a_recording(raw_c3d):
    """As of an empty treadmill, whose parameters need not name what is not there."""
    names = ("POINT:USED", "POINT:UNITS", "POINT:LABELS", "POINT:FRAMES")
    path = made(raw_c3d, np.zeros((FRAMES, 0, 4)), absent=names)
    recording = read_c3d(path, AXES)
    assert recording.markers.position.shape == (FRAMES, 0, 3)
    np.testing.assert_allclose(recording.analog.values, SAMPLES.reshape(-1, CHANNELS), rtol=1e-6)
    assert recording.analog.rate_hz == pytest.approx(1000)


def test_points_without_channels_are_a_recording(raw_c3d):
    path = made(raw_c3d, samples=np.zeros((FRAMES, 1, 0)), header={"per_frame": 0})
    recording = read_c3d(path, AXES)
    np.testing.assert_allclose(recording.markers.position, POSITION[..., :3] / 1000, rtol=1e-5)
    assert recording.analog is None
    assert codes(recording) == set()


# Events

KINDS = {"foot_strike": "Foot Strike", "foot_off": "Foot Off"}
times = st.lists(
    st.tuples(
        st.integers(0, 5),
        st.floats(0, 59.5, width=32),
        st.sampled_from(list(KINDS)),
        st.sampled_from(["left", "right"]),
    ),
    min_size=1,
    max_size=12,
)


def events_of(recording):
    return [(round(e.time, 3), e.label, e.side) for e in recording.events]


@given(stated=times, shape=st.sampled_from(["rows", "flat", "row"]), by=st.booleans())
@MADE_TO_ORDER
def test_times_of_events_are_read_in_every_shape(raw_c3d, stated, shape, by):
    """Minutes and seconds in two rows, or alternating in one list; sides as context or label."""
    pairs = np.array([[minutes, seconds] for minutes, seconds, _, _ in stated], float)
    values = {"rows": pairs.T, "flat": pairs.ravel(), "row": pairs.reshape(1, -1)}[shape]
    labels = [KINDS[kind] for _, _, kind, _ in stated]
    sides = [side.capitalize() for *_, side in stated]
    group = {"USED": np.array([len(stated)]), "TIMES": values}
    if by:
        group |= {"LABELS": labels, "CONTEXTS": sides}
    else:
        group |= {"LABELS": [f"{s} {label}" for s, label in zip(sides, labels, strict=True)]}
    recording = read_c3d(made(raw_c3d, EVENT=group), AXES)
    single, _ = merge_events([Event(60 * m + s, kind, side) for m, s, kind, side in stated])
    expected = sorted((round(e.time, 3), e.label, e.side) for e in single)
    assert sorted(events_of(recording)) == expected


@pytest.mark.parametrize(
    ("label", "context", "event"),
    [
        ("RHS", "", ("foot_strike", "right")),
        ("L_FO", "", ("foot_off", "left")),
        ("Initial Contact R", "", ("foot_strike", "right")),
        ("LTO", "Left", ("foot_off", "left")),
        ("LTO", "Right", None),
        ("left foot off right", "", None),
        ("RMS", "", None),
    ],
)
def test_kind_and_side_of_an_event_are_known_or_it_is_left_out(raw_c3d, label, context, event):
    group = {
        "TIMES": np.array([[0.0], [0.1]]),
        "LABELS": [label],
        "CONTEXTS": [context] if context else [],
    }
    recording = read_c3d(made(raw_c3d, EVENT=group), AXES)
    assert [(e.label, e.side) for e in recording.events] == ([event] if event else [])
    assert ("events_left_out" in codes(recording)) == (event is None)


@given(
    starts=st.lists(st.floats(0.7, 2.0), min_size=1, max_size=8),
    later=st.lists(st.floats(0.0, 0.29), min_size=8, max_size=8),
)
def test_events_that_are_there_twice_are_one_from_first_strike_to_last_foot_off(starts, later):
    """No swing is shorter than 0.3 s; sides and kinds do not touch each other."""
    once = [
        Event(float(at), kind, side)
        for at in np.cumsum(starts)
        for kind in KINDS
        for side in ("left", "right")
    ]
    again = [replace(e, time=e.time + s) for e, s in zip(once, 4 * later, strict=False)]
    events, facts = merge_events(once + again)
    kept = [e if e.label == "foot_strike" else late for e, late in zip(once, again, strict=True)]
    assert sorted(events, key=str) == sorted(kept, key=str)
    assert [fact.kind for fact in facts] == ["joined"]
    assert merge_events(events) == (events, [])


def test_doubled_events_of_a_file_are_read_once_and_said(raw_c3d):
    group = {
        "TIMES": np.array([[0.0, 0.0], [0.1, 0.13]]),
        "LABELS": ["Foot Strike"] * 2,
        "CONTEXTS": ["Left"] * 2,
    }
    recording = read_c3d(made(raw_c3d, EVENT=group), AXES)
    assert [(e.label, e.side) for e in recording.events] == [("foot_strike", "left")]
    assert any(fact.of.startswith("1 of 2 ") for fact in recording.facts)
    assert "joined" in codes(recording)
