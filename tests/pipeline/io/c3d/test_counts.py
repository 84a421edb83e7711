"""Counts of a C3D file that contradict each other: its size decides, or it is refused."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from pipeline.io.c3d.read import read_c3d

AXES = "forward,left,up"
FRAMES, POINTS, CHANNELS, PER_FRAME = 120, 5, 6, 10
RNG = np.random.default_rng(7)
POSITION = RNG.normal(500, 400, (FRAMES, POINTS, 4)) * [1, 1, 1, 0]
SAMPLES = RNG.normal(size=(FRAMES, PER_FRAME, CHANNELS))
LABELS = {"LABELS": list("ABCDE")}
WRONG = {
    "points in the header": {"header": {"points": 4}},
    "analog samples in the header": {"header": {"analog": 50}},
    "samples per channel in the header": {"header": {"per_frame": 5}},
    "POINT:USED": {"POINT": {"USED": np.array([4])}},
    "ANALOG:USED": {"ANALOG": {"USED": np.array([4])}},
    "the last frame": {"header": {"last": 90}},
    "POINT:FRAMES": {"POINT": {"FRAMES": np.array([90])}},
    "POINT:LONG_FRAMES": {"POINT": {"LONG_FRAMES": np.array([90.0])}},
}
"""What is wrong -> how to make it so."""


def made(raw_c3d, change):
    change = {**change, "POINT": LABELS | change.get("POINT", {})}
    return raw_c3d(POSITION, SAMPLES, **change)


def corrections(recording):
    notes = [note for note in recording.notes if note.code == "c3d_corrected"]
    return [said for note in notes for said in note.values["corrections"]]


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG)
def test_a_count_that_is_too_small_is_corrected_by_the_files_size(raw_c3d, change):
    recording = read_c3d(made(raw_c3d, change), AXES)
    np.testing.assert_allclose(recording.markers.position, POSITION[..., :3] / 1000, rtol=1e-5)
    np.testing.assert_allclose(recording.analog.values, SAMPLES.reshape(-1, CHANNELS), rtol=1e-5)
    assert len(corrections(recording)) == 1


def test_contradictory_counts_of_points_that_no_size_proves_are_refused(raw_c3d):
    path = made(raw_c3d, {"POINT": {"USED": np.array([7])}, "header": {"points": 6}})
    with pytest.raises(ValueError, match=r"6 points .* say 7 and 6, and the file's size fits neit"):
        read_c3d(path, AXES)


def test_frames_beyond_a_count_on_which_all_places_agree_are_left_and_noted(raw_c3d):
    change = {"header": {"last": 90}, "POINT": {"FRAMES": np.array([90])}}
    path = made(raw_c3d, change)
    recording = read_c3d(path, AXES)
    assert len(recording.markers.time) == 90
    assert len(corrections(recording)) == 1


def test_a_contradictory_first_frame_is_a_note_and_with_events_a_refusal(raw_c3d):
    """It names frames, but the times of events count from it."""
    trial = {
        "ACTUAL_START_FIELD": np.array([45, 0]),
        "ACTUAL_END_FIELD": np.array([44 + FRAMES, 0]),
    }
    recording = read_c3d(made(raw_c3d, {"TRIAL": trial}), AXES)
    assert recording.first_frame == 1
    assert corrections(recording)
    event = {"TIMES": np.array([[0.0], [0.5]]), "LABELS": ["Foot Off"], "CONTEXTS": ["Left"]}
    path = made(raw_c3d, {"TRIAL": trial, "EVENT": event})
    with pytest.raises(ValueError, match=r"first frame by TRIAL:.* 45, used: 1: "):
        read_c3d(path, AXES)


def stated_frames(place, frames):
    """Give the change by which a place, and no other, states a number of frames."""
    low, high = frames % 65536, frames // 65536
    return {
        "header": {"header": {"last": min(frames, 65535)}},
        "POINT:FRAMES": {"POINT": {"FRAMES": np.array([min(frames, 65535)])}},
        "POINT:LONG_FRAMES": {"POINT": {"LONG_FRAMES": np.array([float(frames)])}},
        "TRIAL": {
            "TRIAL": {
                "ACTUAL_START_FIELD": np.array([1, 0]),
                "ACTUAL_END_FIELD": np.array([low, high]),
            }
        },
    }[place]


@given(
    place=st.sampled_from(["header", "POINT:FRAMES", "POINT:LONG_FRAMES", "TRIAL"]),
    more=st.integers(1, 100_000),
)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_shorter_than_any_of_its_counts_is_refused(raw_c3d, place, more):
    path = made(raw_c3d, stated_frames(place, FRAMES + more))
    with pytest.raises(ValueError, match=r"but its size holds 120: it is truncated or damaged"):
        read_c3d(path, AXES)


@given(lost=st.integers(1, 60_000), counted_by=st.sampled_from(["TRIAL", "POINT:LONG_FRAMES"]))
@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_long_file_cut_short_is_refused_however_many_frames_remain(raw_c3d, lost, counted_by):
    """Its 16-bit counts have stopped and would allow for any number of frames above 65,535."""
    frames = 130_000
    points = np.ones((frames - lost, 1, 4))
    change = stated_frames(counted_by, frames)
    change["POINT"] = {"LABELS": ["A"], "FRAMES": np.array([65535])} | change.get("POINT", {})
    path = raw_c3d(points, header={"last": 65535}, **change)
    with pytest.raises(ValueError, match=rf"says it has 65535 or 130000 frames, .*{frames - lost}"):
        read_c3d(path, AXES)


@given(
    frames=st.integers(2, 400),
    points=st.integers(1, 12),
    channels=st.integers(0, 8),
    per_frame=st.integers(1, 12),
    too_few=st.integers(1, 11),
)
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_wrong_number_of_points_is_never_read_as_if_it_were_right(
    raw_c3d, frames, points, channels, per_frame, too_few
):
    """Either every sample is where it belongs, or the file is refused."""
    assume(too_few < points)
    position = np.ones((frames, points, 4)) * np.arange(1, points + 1)[:, None] * [100, 1, 1, 0]
    analog = np.zeros((frames, per_frame, channels))
    path = raw_c3d(
        position,
        analog,
        header={"points": points - too_few},
        POINT={"LABELS": [f"P{k}" for k in range(points)]},
    )
    try:
        recording = read_c3d(path, AXES)
    except ValueError:
        return
    np.testing.assert_allclose(recording.markers.position, position[..., :3] / 1000, rtol=1e-6)
