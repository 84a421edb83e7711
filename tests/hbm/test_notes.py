"""A note is a code and values, and its sentence states these with their units."""

import json
import pickle
from copy import deepcopy

import pytest

from hbm.notes import Note

LEGS = {"difference_m": 0.041, "left_m": 0.843, "right_m": 0.802}
CHANGED = {"segment": "pelvis", "limit_m": 0.03, "largest_m": {"a–b": 0.0352, "a–c": -0.04}}


def test_the_sentence_of_a_note_states_its_values_with_their_units():
    note = Note.of("legs_differ", **LEGS | {"right_m": float("nan")})
    assert all(part in note.text for part in ("41 mm", "left 0.843 m", "right unknown m"))
    note = Note.of("joint_angles_impossible", share=0.5, extreme_deg={"RHipFlexion": -100.0})
    assert note.text.endswith("extremes RHipFlexion −100°")


def test_numbers_that_people_read_have_a_minus_sign_and_those_they_type_a_hyphen():
    late = Note.of("plates_late", delay_s=-0.012, uncertainty_s=0.002, remedy="Set it.")
    assert "−12 ± 2 ms" in late.text
    command = {"delay_s": 0.02, "interval_s": 0.001, "channels": ["Sway"], "stated_s": -0.02}
    assert Note.of("platform_command_delay", **command).text.endswith("delay_s = -0.0200")


@pytest.mark.parametrize(
    ("code", "values", "reason"),
    [
        ("leg_difers", {}, r"'leg_difers'; .*hbm/notes"),
        ("legs_differ", {"left_m": 0.8}, "difference_m, left_m, right_m, got left_"),
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
