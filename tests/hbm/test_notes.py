"""Notes: a code, a level, and a sentence made of values."""

import json
import pickle
from copy import deepcopy

import pytest

from hbm.notes import Note, warnings_first

LEGS = {"difference_m": 0.041, "left_m": 0.843, "right_m": 0.802}


def test_the_sentence_of_a_note_states_its_values_with_their_units():
    note = Note.of("legs_differ", **LEGS)
    assert note.level == "warning"
    assert str(note) == note.text
    assert note.text.startswith("the legs differ by 41 mm (left 0.843 m, right 0.802 m from hip")


def test_names_and_numbers_by_name_are_joined_by_commas():
    locked = Note.of("coordinates_locked", coordinates=["Neck", "Head"])
    assert locked.text.endswith("shows them: Neck, Head")
    changed = Note.of(
        "marker_distances_changed",
        segment="right_shank",
        pairs=2,
        limit_m=0.03,
        largest_m={"RLEK–RANK": 0.0352, "RLEK–RMM": -0.04},
    )
    assert (
        "more than 30 mm, the largest changes being RLEK–RANK +35 mm, RLEK–RMM -40 mm;"
        in changed.text
    )


@pytest.mark.parametrize(("count", "words"), [(1, "1 marker distance differs"), (2, "2 marker d")])
def test_counts_are_written_in_singular_and_plural(count, words):
    values = {"segment": "pelvis", "limit_m": 0.03, "largest_m": {"a–b": 0.05}}
    assert words in Note.of("marker_distances_changed", pairs=count, **values).text


def test_an_unknown_code_is_refused():
    with pytest.raises(ValueError, match=r"no note has the code 'leg_difers'; hbm/notes\.toml"):
        Note.of("leg_difers")


def test_a_missing_and_a_surplus_value_are_refused():
    with pytest.raises(ValueError, match="its values are difference_m, left_m, right_m, got left_"):
        Note.of("legs_differ", left_m=0.8)
    with pytest.raises(ValueError, match="its values are missing, rule, got side"):
        Note.of("landmark_substituted", side="left")


def test_a_value_that_does_not_fit_its_sentence_is_refused():
    with pytest.raises(ValueError, match="note 'legs_differ': "):
        Note.of("legs_differ", **LEGS | {"left_m": "long"})
    with pytest.raises(ValueError, match="a note's value is a number, text, names or numbers by"):
        Note.of("legs_differ", **LEGS | {"left_m": None})


def test_a_note_comes_back_from_json_and_from_pickle():
    note = Note.of(
        "marker_distances_changed", segment="pelvis", pairs=1, limit_m=0.03, largest_m={"a–b": 0.05}
    )
    plain = json.loads(json.dumps(note.to_dict()))
    assert set(plain) == {"code", "level", "text", "values"}
    assert Note.from_dict(plain) == note
    names = Note.of("coordinates_locked", coordinates=("Neck",))
    assert Note.from_dict(json.loads(json.dumps(names.to_dict()))) == names
    assert pickle.loads(pickle.dumps(note)) == deepcopy(note) == note


@pytest.mark.parametrize("stored", [None, "legs", {"code": "landmark_substituted"}, {"values": {}}])
def test_what_is_not_a_note_is_refused(stored):
    with pytest.raises(ValueError, match="note"):
        Note.from_dict(stored)


def test_equal_notes_are_one_in_a_set_and_values_cannot_be_changed():
    note, same = (Note.of("legs_differ", **LEGS) for _ in range(2))
    assert {note, same} == {note}
    with pytest.raises(TypeError):
        note.values["left_m"] = 0.8


def test_warnings_come_first_and_the_rest_keeps_its_order():
    info, other = (
        Note.of("landmark_substituted", missing=side, rule="") for side in ("left", "right")
    )
    warning = Note.of("legs_differ", **LEGS)
    assert warnings_first([info, warning, other]) == (warning, info, other)


def test_a_number_that_is_not_known_is_called_unknown():
    note = Note.of("legs_differ", **LEGS | {"left_m": float("nan")})
    assert "(left unknown m, right 0.802 m from hip" in note.text


def test_degrees_stand_next_to_their_number():
    note = Note.of("joint_angles_impossible", share=0.5, extreme_deg={"RHipFlexion": -100.0})
    assert "the extremes being RHipFlexion -100°:" in note.text
