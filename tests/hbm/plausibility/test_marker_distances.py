"""Markers of one segment that change their distances."""

from hbm.markers import Markers
from hbm.plausibility.labels import changed_distances
from tests.hbm.motions import relabelled, without
from tests.synthetic import synthetic_body


def test_skin_and_noise_change_no_distance_noticeably(walk):
    assert changed_distances(synthetic_body(), walk) == ()


def test_a_marker_that_moved_is_noticed(walk):
    position = walk.position.copy()
    position[:, walk.names.index("RLTHI"), 2] += 0.08
    (note,) = changed_distances(synthetic_body(), Markers(walk.time, walk.names, position))
    assert (note.code, note.level) == ("marker_distances_changed", "warning")
    assert note.values["segment"] == "right_thigh"
    assert all("RLTHI" in pair for pair in note.values["largest_m"])


def test_two_swapped_markers_are_noticed(walk):
    notes = changed_distances(synthetic_body(), relabelled(walk, ("LLEK", "LLTHI")))
    assert any(note.values["segment"] == "left_thigh" for note in notes)


def test_gaps_do_not_count_as_changes(walk):
    gone = without(without(walk, ["RLTHI"]), ["LLTHI"], slice(0, 30))
    assert changed_distances(synthetic_body(), gone) == ()
