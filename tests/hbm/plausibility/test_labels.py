"""Labels that are exchanged, markers that moved and positions that were repeated are named."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hbm.markers import Markers
from hbm.plausibility.labels import (
    changed_distances,
    frozen_frames,
    labels_exchanged,
    repeated_positions,
    sides_exchanged,
)
from tests.hbm.motions import (
    displaced,
    exchanged,
    held,
    markers_of,
    relabelled,
    swinging,
    with_noise,
)
from tests.hbm.people import moved
from tests.synthetic import synthetic_body, synthetic_t_pose

BODY = synthetic_body()
MARKS = BODY.marker_set.landmark
PAIRS = [(MARKS[m], MARKS[f"R{m[1:]}"]) for m in MARKS if m[0] == "L"]
LEGS = [pair for pair in PAIRS if BODY.marker_set.segment[pair[0]].endswith(("thigh", "shank"))]


@pytest.fixture(scope="module")
def long_walk():
    motion = swinging(np.random.default_rng(5), frames=200, degrees=20.0)
    return with_noise(markers_of(BODY, motion), np.random.default_rng(6), 0.001)


def found(markers):
    return [note.values for note in labels_exchanged(markers, BODY.markers)]


@settings(max_examples=30)
@given(
    pair=st.sampled_from(PAIRS),
    start=st.integers(5, 100),
    duration=st.integers(2, 90),
)
def test_every_pair_is_found_with_its_times_however_short(long_walk, pair, start, duration):
    """Where its markers are 5 cm apart; nearer ones pass each other in this motion."""
    own = [long_walk.names.index(name) for name in pair]
    left, right = long_walk.position[[start, start + duration]][:, own].swapaxes(0, 1)
    assume((np.linalg.norm(left - right, axis=1) > 0.05).all())
    (values,) = found(exchanged(long_walk, slice(start, start + duration), pair))
    assert values["pairs"] == "/".join(pair)
    assert values["first_s"] == pytest.approx(start / 100)
    assert values["last_s"] == pytest.approx((start + duration) / 100)


@settings(max_examples=30)
@given(cm=st.floats(3.5, 80), frame=st.integers(5, 190), seed=st.integers(0, 99))
def test_a_marker_that_jumps_alone_has_exchanged_nothing(long_walk, cm, frame, seed):
    direction = np.random.default_rng(seed).normal(size=3)
    offset_m = cm / 100 * direction / np.linalg.norm(direction)
    assert found(displaced(long_walk, "LHEE", offset_m, slice(frame, None))) == []


def named(markers):
    """The pairs that are named."""
    exchanged = sides_exchanged(BODY.marker_set, markers, "walk.c3d")
    return ["/".join(pair) for pair in (exchanged.pairs if exchanged else ())]


def test_labels_that_are_right_raise_no_warning(walk):
    assert sides_exchanged(BODY.marker_set, synthetic_t_pose(), "pose.c3d") is None
    assert sides_exchanged(BODY.marker_set, walk, "walk.c3d") is None


@pytest.mark.parametrize("pair", [p for p in PAIRS if p != ("LFIN", "RFIN")], ids="/".join)
def test_every_single_pair_is_named(walk, pair):
    """Those of forearms, which people cross, by their distances; of a hand with one marker none."""
    exchanged = relabelled(walk, pair)
    if BODY.marker_set.segment[pair[0]].endswith("forearm"):
        segments = {note.values["segment"] for note in changed_distances(BODY, exchanged)}
        assert {"left_forearm", "right_forearm"} <= segments
    else:
        assert named(exchanged) == ["/".join(pair)]


@settings(max_examples=20)
@given(yaw=st.floats(-np.pi, np.pi), pairs=st.sets(st.sampled_from(LEGS), min_size=1, max_size=3))
def test_where_the_subject_faces_does_not_matter(walk, yaw, pairs):
    found = named(moved(relabelled(walk, *pairs), yaw, (3.0, -2.0, 0.0)))
    assert set(found) == {"/".join(pair) for pair in pairs}
    assert named(moved(walk, yaw)) == []


@settings(max_examples=30)
@given(cm=st.floats(-20, 20))
def test_a_left_marker_is_on_the_wrong_side_from_4_cm_on_and_never_below(walk, cm):
    position = walk.position.copy()
    left, right = (walk.names.index(name) for name in ("LMT5", "RMT5"))
    front = position[:, [walk.names.index(n) for n in ("LASIS", "RASIS")]].mean(axis=1)
    back = position[:, [walk.names.index(n) for n in ("LPSIS", "RPSIS")]].mean(axis=1)
    forward = (front - back) * [1, 1, 0]
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    position[:, left] = position[:, right] + cm / 100 * np.cross([0, 0, 1], forward)
    found = named(Markers(walk.time, walk.names, position))
    assert (found != []) == (cm < -4)


def test_hands_held_on_each_other_s_side_are_not_exchanged(walk):
    """Arms folded: forearms and hands are on the other side, and keep their own distances."""
    crossing = [p for p in PAIRS if BODY.marker_set.segment[p[0]].endswith(("forearm", "hand"))]
    assert len(crossing) == 3
    assert named(relabelled(walk, *crossing)) == []


def test_a_marker_that_moved_is_noticed(walk):
    (note,) = changed_distances(synthetic_body(), displaced(walk, "RLTHI", [0, 0, 0.08]))
    assert (note.code, note.level) == ("marker_distances_changed", "warning")
    assert note.values["segment"] == "right_thigh"
    assert all("RLTHI" in pair for pair in note.values["largest_m"])


def codes(markers):
    return [note.code for note in repeated_positions(BODY, markers)]


@settings(max_examples=30)
@given(start=st.integers(0, 100), repeats=st.integers(1, 90))
def test_a_drop_out_is_found_from_a_twentieth_of_a_second_on_and_never_below(
    long_walk, start, repeats
):
    frames = slice(start, start + repeats + 1)
    frozen = frozen_frames(held(long_walk, frames), BODY.markers)
    expected = np.zeros(200, bool)
    if repeats >= 5:
        expected[start + 1 : start + repeats + 1] = True
    np.testing.assert_array_equal(frozen, expected)


@settings(max_examples=30)
@given(name=st.sampled_from(BODY.markers), repeats=st.integers(2, 150))
def test_a_marker_held_alone_is_found_from_half_a_second_on_and_never_below(
    long_walk, name, repeats
):
    notes = repeated_positions(BODY, held(long_walk, slice(20, 21 + repeats), [name]))
    if repeats < 50:
        assert notes == ()
    else:
        (note,) = notes
        assert (note.code, note.level) == ("markers_constant", "warning")
        assert note.values["constant_s"] == {name: pytest.approx(repeats / 100)}


def test_a_foot_that_rests_while_the_body_moves_is_not_constant(long_walk):
    """In the stance of a noise-free or rounded recording all its markers repeat together."""
    foot = [m for m, s in zip(BODY.markers, BODY.marker_segment, strict=True) if s == "left_foot"]
    assert codes(held(long_walk, slice(20, 120), foot)) == []
