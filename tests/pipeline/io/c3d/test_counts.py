"""Where counts of a C3D file contradict each other its size decides, or it is refused."""

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
TRIAL = {"ACTUAL_START_FIELD": np.array([1, 0]), "ACTUAL_END_FIELD": np.array([FRAMES, 0])}
WRONG = {
    "points in the header": lambda n: {"header": {"points": n}},
    "analog samples in the header": lambda n: {"header": {"analog": n}},
    "samples per channel in the header": lambda n: {"header": {"per_frame": n}},
    "POINT:USED": lambda n: {"POINT": {"USED": np.array([n])}},
    "ANALOG:USED": lambda n: {"ANALOG": {"USED": np.array([n])}},
    "rate by POINT:RATE": lambda n: {"POINT": {"RATE": np.array([float(n)])}},
    "rate by the header": lambda n: {"header": {"rate": float(n)}},
    "rate by ANALOG:RATE and the samples per frame": lambda n: {
        "ANALOG": {"RATE": np.array([float(n)])}
    },
    "frames by the header": lambda n: {"header": {"last": n}},
    "frames by the header and its first frame": lambda n: {"header": {"first": n}},
    "frames by POINT:FRAMES": lambda n: {"POINT": {"FRAMES": np.array([n])}},
    "frames by POINT:LONG_FRAMES": lambda n: {"POINT": {"LONG_FRAMES": np.array([float(n)])}},
    "frames by TRIAL:ACTUAL_START_FIELD": lambda n: {
        "TRIAL": TRIAL | {"ACTUAL_START_FIELD": np.array([n, 0])}
    },
    "frames by TRIAL:ACTUAL_END_FIELD": lambda n: {
        "TRIAL": TRIAL | {"ACTUAL_END_FIELD": np.array([n, 0])}
    },
}
"""What is wrong -> how to make it so."""


def made(raw_c3d, change):
    change = {**change, "POINT": LABELS | change.get("POINT", {})}
    return raw_c3d(POSITION, SAMPLES, **change)


def corrections(recording):
    return [fact for fact in recording.facts if fact.kind == "corrected"]


RIGHT = {
    "points in the header": POINTS,
    "POINT:USED": POINTS,
    "analog samples in the header": CHANNELS * PER_FRAME,
    "samples per channel in the header": PER_FRAME,
    "ANALOG:USED": CHANNELS,
    "rate by POINT:RATE": 100,
    "rate by the header": 100,
    "rate by ANALOG:RATE and the samples per frame": 1000,
    "frames by the header and its first frame": 1,
    "frames by TRIAL:ACTUAL_START_FIELD": 1,
}
"""Others are the number of frames."""


@pytest.mark.parametrize("place", WRONG)
@given(
    wrong=st.integers(1, 5000) | st.integers(-3, 3).map(lambda n: -n),
    counted=st.booleans(),
    padding=st.sampled_from([0, 512]),
)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_single_count_that_is_wrong_is_corrected(raw_c3d, place, wrong, counted, padding):
    """Also by one, and where only two places state a number of frames, since the size proves it."""
    right = RIGHT.get(place, FRAMES)
    wrong = right + wrong if wrong <= 0 else wrong
    assume(wrong != right and wrong > 0)
    change = {"TRIAL": TRIAL} if counted else {}
    path = made(raw_c3d, change | WRONG[place](wrong))
    content = path.read_bytes()
    path.write_bytes(content + bytes(-len(content) % padding if padding else 0))
    recording = read_c3d(path, AXES)
    np.testing.assert_allclose(recording.markers.position, POSITION[..., :3] / 1000, rtol=1e-5)
    np.testing.assert_allclose(recording.analog.values, SAMPLES.reshape(-1, CHANNELS), rtol=1e-5)
    assert (recording.markers.rate_hz, recording.analog.rate_hz) == (
        pytest.approx(100),
        pytest.approx(1000),
    )
    said = place.removesuffix(" and its first frame").replace("START", "END")
    assert said in {fact.of for fact in corrections(recording)}


ONE_TOO_LARGE = {
    "TRIAL": TRIAL | {"ACTUAL_END_FIELD": np.array([FRAMES + 1, 0])},
    "POINT": {"FRAMES": np.array([FRAMES + 1]), "LONG_FRAMES": np.array([FRAMES + 1.0])},
}


@pytest.mark.parametrize("places", [("POINT",), ("POINT", "TRIAL")])
@pytest.mark.parametrize("padding", [0, 512])
def test_counts_that_are_one_too_large_are_corrected_where_one_agrees_with_the_size(
    raw_c3d, places, padding
):
    path = made(raw_c3d, {place: ONE_TOO_LARGE[place] for place in places})
    content = path.read_bytes()
    path.write_bytes(content + bytes(-len(content) % padding if padding else 0))
    recording = read_c3d(path, AXES)
    np.testing.assert_allclose(recording.markers.position, POSITION[..., :3] / 1000, rtol=1e-5)
    assert len(corrections(recording)) == 1 + len(places)


@given(
    kept=st.floats(0, 0.999),
    change=st.sampled_from([{}, {"TRIAL": TRIAL}, ONE_TOO_LARGE]),
    whole=st.booleans(),
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_cut_anywhere_is_refused(raw_c3d, kept, change, whole):
    path = made(raw_c3d, change)
    content = path.read_bytes()
    frame = 4 * (4 * POINTS + CHANNELS * PER_FRAME)
    data = len(content) - FRAMES * frame
    left = data + int(kept * FRAMES) * frame if whole else int(kept * len(content))
    path.write_bytes(content[:left])
    with pytest.raises(ValueError, match=r"truncated|damaged|broken|not a C3D|is empty"):
        read_c3d(path, AXES)


def test_contradictory_counts_of_points_that_no_size_proves_are_refused(raw_c3d):
    path = made(raw_c3d, {"POINT": {"USED": np.array([7])}, "header": {"points": 6}})
    with pytest.raises(ValueError, match=r"6 or 7 points .*109 or 114: .*truncated"):
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
    assert [fact.of for fact in recording.facts if fact.kind == "in_doubt"]
    event = {"TIMES": np.array([[0.0], [0.5]]), "LABELS": ["Foot Off"], "CONTEXTS": ["Left"]}
    path = made(raw_c3d, {"TRIAL": trial, "EVENT": event})
    with pytest.raises(ValueError, match=r"first frame: 1 .*, 45 .*TRIAL:.*, 1 used"):
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
    place=st.sampled_from(["POINT:LONG_FRAMES", "TRIAL"]),
    more=st.integers(2, 100_000),
)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_shorter_than_most_of_its_counts_is_refused(raw_c3d, place, more):
    """One count agrees with its size, as after a cut at the frames that it happens to state."""
    low = (FRAMES + more) % 65536
    assume(low > FRAMES)
    change = stated_frames(place, FRAMES + more)
    change["POINT"] = {"FRAMES": np.array([low])} | change.get("POINT", {})
    with pytest.raises(ValueError, match=r"holds 120: .*truncated"):
        read_c3d(made(raw_c3d, change), AXES)


@given(lost=st.integers(1, 60_000), counted_by=st.sampled_from(["TRIAL", "POINT:LONG_FRAMES"]))
@settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_long_file_cut_short_is_refused_however_many_frames_remain(raw_c3d, lost, counted_by):
    """Its 16-bit counts have stopped and would allow for any number of frames above 65,535."""
    frames = 130_000
    points = np.ones((frames - lost, 1, 4))
    change = stated_frames(counted_by, frames)
    change["POINT"] = {"LABELS": ["A"], "FRAMES": np.array([65535])} | change.get("POINT", {})
    path = raw_c3d(points, header={"last": 65535}, **change)
    with pytest.raises(ValueError, match=rf"65535 or 130000 frames .* {frames - lost}:"):
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
