"""Left and right labels that are exchanged throughout a recording."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.markers import Markers, marker_sets, read_marker_set
from hbm.plausibility.labels import changed_distances, counterparts, sides_exchanged
from tests.hbm.motions import relabelled, without
from tests.hbm.people import moved
from tests.synthetic import synthetic_body, synthetic_t_pose

BODY = synthetic_body()
PAIRS = list(counterparts(BODY.marker_set).items())
LEGS = [pair for pair in PAIRS if BODY.marker_set.segment[pair[0]].endswith(("thigh", "shank"))]


def named(markers):
    """The pairs of the note, and how many there are."""
    notes = sides_exchanged(BODY, markers, "walk.c3d")
    return [(note.values["named"], note.values["pairs"]) for note in notes]


def test_labels_that_are_right_raise_no_warning(walk):
    assert sides_exchanged(BODY, synthetic_t_pose(), "pose.c3d") == ()
    assert sides_exchanged(BODY, walk, "walk.c3d") == ()


@pytest.mark.parametrize("pair", [p for p in PAIRS if p != ("LFIN", "RFIN")], ids="/".join)
def test_every_single_pair_is_named(walk, pair):
    """Those of forearms, which people cross, by their distances; of a hand with one marker none."""
    exchanged = relabelled(walk, pair)
    if BODY.marker_set.segment[pair[0]].endswith("forearm"):
        segments = {note.values["segment"] for note in changed_distances(BODY, exchanged)}
        assert {"left_forearm", "right_forearm"} <= segments
    else:
        assert named(exchanged) == [(("/".join(pair),), 1)]


def test_the_sentence_names_recording_and_pair(walk):
    (note,) = sides_exchanged(BODY, relabelled(walk, ("LHEE", "RHEE")), "walk.c3d")
    assert note.level == "warning"
    assert "in walk.c3d, 1 pair of left and right markers carries each other's" in note.text
    assert "LHEE/RHEE" in note.text


def test_the_markers_of_both_legs_are_named(walk):
    ((names, pairs),) = named(relabelled(walk, *LEGS))
    assert pairs == len(LEGS)
    assert set(names) <= {"/".join(pair) for pair in LEGS} | {"…"}


def test_a_whole_side_is_named_by_its_first_pairs(walk):
    ((names, pairs),) = named(relabelled(walk, *PAIRS))
    arms = [a for a, _ in PAIRS if BODY.marker_set.segment[a].endswith(("forearm", "hand"))]
    assert pairs == len(PAIRS) - len(arms)
    assert len(names) == 7
    assert names[-1] == "…"


@settings(deadline=None, max_examples=20)
@given(yaw=st.floats(-np.pi, np.pi), pairs=st.sets(st.sampled_from(LEGS), min_size=1, max_size=3))
def test_where_the_subject_faces_does_not_matter(walk, yaw, pairs):
    ((_, count),) = named(moved(relabelled(walk, *pairs), yaw, (3.0, -2.0, 0.0)))
    assert count == len(pairs)
    assert named(moved(walk, yaw)) == []


@settings(deadline=None)
@given(cm=st.floats(-20, 20))
def test_a_left_marker_is_on_the_wrong_side_from_4_cm_on_and_never_below(walk, cm):
    """Tracking markers of the thigh, whose distances to their segments fit neither way."""
    position = walk.position.copy()
    left, right = (walk.names.index(name) for name in ("LLTHI", "RLTHI"))
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
    assert len(crossing) == 4
    assert named(relabelled(walk, *crossing)) == []


def test_markers_that_are_missing_are_not_judged(walk):
    assert named(without(walk, ["LHEE"])) == []
    assert named(without(relabelled(walk, ("LHEE", "RHEE")), ["LASIS", "RASIS"])) == []
    nothing = without(relabelled(walk, ("LHEE", "RHEE")), list(walk.names))
    assert named(nothing) == []


def test_labels_of_other_sets_are_paired_by_landmark_or_by_one_letter():
    own = read_marker_set(
        """
        [markers]
        "l.knee" = ["left_thigh", "LLEK"]
        "knee right" = ["right_thigh", "RLEK"]
        "L.Thigh" = ["left_thigh"]
        "R.Thigh" = ["right_thigh"]
        FLTHI = ["left_thigh"]
        FRTHI = ["right_thigh"]
        CLAV = ["thorax", "JN"]
        """
    )
    assert counterparts(own) == {
        "l.knee": "knee right",
        "L.Thigh": "R.Thigh",
        "FLTHI": "FRTHI",
    }


@pytest.mark.parametrize("name", marker_sets())
def test_every_left_marker_of_a_shipped_set_has_its_counterpart(name):
    chosen = marker_sets()[name]
    left = {marker for marker, segment in chosen.segment.items() if segment.startswith("left_")}
    assert left <= set(counterparts(chosen))
