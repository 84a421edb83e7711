"""Notes: a code, and a sentence made of values; warnings and rows of provenance."""

import json
import pickle
from copy import deepcopy

import pytest

from hbm.notes import Note, provenance, warnings_of

LEGS = {"difference_m": 0.041, "left_m": 0.843, "right_m": 0.802}
CHANGED = {"segment": "pelvis", "limit_m": 0.03, "largest_m": {"a–b": 0.0352, "a–c": -0.04}}


def test_the_sentence_of_a_note_states_its_values_with_their_units():
    note = Note.of("legs_differ", **LEGS | {"right_m": float("nan")})
    assert note.text.startswith("the legs differ by 41 mm (left 0.843 m, right unknown m from hip")
    note = Note.of("joint_angles_impossible", share=0.5, extreme_deg={"RHipFlexion": -100.0})
    assert "the extremes being RHipFlexion -100°:" in note.text


def test_names_and_numbers_by_name_are_joined_and_counts_are_singular_or_plural():
    held = Note.of("coordinates_held", coordinates=["Neck", "Head"])
    assert held.text.endswith("not at all: Neck, Head")
    for count, words in ((1, "in 1 frame from"), (2, "in 2 frames from")):
        assert words in Note.of("markers_frozen", frames=count, first_s=0.0, last_s=1.0).text
    changed = Note.of("marker_distances_changed", **CHANGED)
    assert "more than 30 mm, the largest changes being a–b +35 mm, a–c -40 mm;" in changed.text


@pytest.mark.parametrize(
    ("code", "values", "reason"),
    [
        ("leg_difers", {}, r"no note has the code 'leg_difers'; hbm/notes\.toml"),
        ("legs_differ", {"left_m": 0.8}, "its values are difference_m, left_m, right_m, got left_"),
        ("legs_differ", LEGS | {"side": "left"}, "its values are .*, got .*side"),
        ("legs_differ", LEGS | {"left_m": "long"}, "note 'legs_differ': "),
        ("legs_differ", LEGS | {"left_m": None}, "a note's value is a number, text, names or"),
    ],
)
def test_a_note_that_is_not_in_the_catalogue_or_lacks_values_is_refused(code, values, reason):
    with pytest.raises(ValueError, match=reason):
        Note.of(code, **values)


def test_a_note_comes_back_from_json_and_from_pickle():
    note = Note.of("marker_distances_changed", **CHANGED)
    names = Note.of("coordinates_held", coordinates=("Neck",))
    for one in (note, names):
        assert Note.from_dict(json.loads(json.dumps(one.to_dict()))) == one
        assert pickle.loads(pickle.dumps(one)) == deepcopy(one) == one
    assert {note, deepcopy(note)} == {note}
    for stored in (None, "legs", {"code": "landmarks_substituted"}, {"values": {}}):
        with pytest.raises(ValueError, match="note"):
            Note.from_dict(stored)


def test_warnings_stand_apart_from_the_rows_of_provenance():
    first, other = (
        Note.of("landmarks_substituted", rules=(f"{side} (a rule)",)) for side in ("left", "right")
    )
    pose, warning = Note.of("mass_stated", mass_kg=70), Note.of("legs_differ", **LEGS)
    assert warnings_of([first, warning, pose]) == (warning,)
    assert provenance([first, pose, warning, other, first]) == (
        ("Landmarks", "missing: left (a rule); missing: right (a rule)"),
        ("Body mass", "body mass 70.0 kg as stated"),
    )
