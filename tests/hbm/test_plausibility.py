"""What is implausible about a body."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.description import describe
from hbm.markers import Markers
from hbm.plausibility import changed_distances, implausible
from tests.hbm.motions import markers_of, swinging, with_noise, without
from tests.hbm.people import person
from tests.synthetic import MASS_KG, T_POSE_MM, synthetic_body


@pytest.fixture(scope="module")
def walk():
    exact = markers_of(synthetic_body(), swinging(np.random.default_rng(30), frames=100))
    return with_noise(exact, np.random.default_rng(31), 0.004)


def test_a_plausible_body_raises_no_warning(walk):
    assert implausible(synthetic_body(), carried_kg=MASS_KG * 1.02) == ()
    assert changed_distances(synthetic_body(), walk) == ()


def test_legs_of_different_length_are_noticed():
    short = {
        n: (*T_POSE_MM[n][:2], T_POSE_MM[n][2] + 40) for n in ("LLM", "LMM", "LHEE", "LMT2", "LMT5")
    }
    body = build_body(person(**short), mass=MASS_KG)
    (note,) = implausible(body)
    assert (note.code, note.level) == ("legs_differ", "warning")
    assert str(note) in describe(body)


def test_a_mass_that_the_plates_contradict_is_noticed():
    (note,) = implausible(synthetic_body(), carried_kg=80.0)
    assert note.level == "warning"
    assert "74.6 kg differs by -7 % from the 80.0 kg that the plates carry" in note.text


def test_a_marker_that_moved_is_noticed(walk):
    position = walk.position.copy()
    position[:, walk.names.index("RLTHI"), 2] += 0.08
    (note,) = changed_distances(synthetic_body(), Markers(walk.time, walk.names, position))
    assert (note.code, note.level) == ("marker_distances_changed", "warning")
    assert note.values["segment"] == "right_thigh"
    assert all("RLTHI" in pair for pair in note.values["largest_m"])


def test_two_swapped_markers_are_noticed(walk):
    names = list(walk.names)
    a, b = names.index("LLEK"), names.index("LLTHI")
    names[a], names[b] = names[b], names[a]
    notes = changed_distances(synthetic_body(), Markers(walk.time, tuple(names), walk.position))
    assert any(note.values["segment"] == "left_thigh" for note in notes)


def test_gaps_do_not_count_as_changes(walk):
    gone = without(without(walk, ["RLTHI"]), ["LLTHI"], slice(0, 60))
    assert changed_distances(synthetic_body(), gone) == ()
