"""Marker sets as tables."""

from collections import Counter
from pathlib import Path

import pytest

from hbm.markers import LANDMARKS, MarkerSet, SetMarker, marker_sets, read_marker_set

PAIRED = {name[1:] for name in LANDMARKS if f"L{name[1:]}" in LANDMARKS and name[0] == "R"}
CUSTOM = """
title = "Our pelvis"
[markers]
LASI = ["pelvis", "LASIS"]
RASI = ["pelvis", "RASIS"]
"PEL 3" = ["pelvis"]
"""


SETS = tuple(marker_sets())


@pytest.mark.parametrize("name", SETS)
def test_shipped_sets_have_the_number_of_markers_that_their_title_states(name):
    needed = [marker for marker in marker_sets()[name].markers if not marker.optional]
    assert marker_sets()[name].title.endswith(f", {len(needed)} markers")


@pytest.mark.parametrize("name", ["hbm2", "hbm1", "pig", "cgm2", "ior"])
def test_lower_body_sets_are_parts_of_the_full_ones(name):
    full, lower = marker_sets()[name], marker_sets()[f"{name}_lower"]
    assert lower.segment.items() <= full.segment.items()
    assert lower.landmark.items() <= full.landmark.items()


@pytest.mark.parametrize("name", SETS)
def test_sets_are_symmetric(name):
    chosen = marker_sets()[name]
    attached = Counter(chosen.segment.values())
    for segment, count in attached.items():
        side, _, part = segment.partition("_")
        other = {"left": f"right_{part}", "right": f"left_{part}"}.get(side, segment)
        assert attached[other] == count
    left, right = ({m[1:] for m in chosen.landmark if m[0] == s and m[1:] in PAIRED} for s in "LR")
    assert left == right


def test_a_custom_set_is_a_table():
    custom = read_marker_set(CUSTOM, "lab")
    assert custom.name == "lab"
    assert custom.title == "Our pelvis"
    assert custom.segment == {"LASI": "pelvis", "RASI": "pelvis", "PEL 3": "pelvis"}
    assert custom.landmark == {"LASIS": "LASI", "RASIS": "RASI"}


def test_all_faults_of_a_set_are_listed_at_once():
    text = """
    [markers]
    A = ["pelvsi"]
    B = ["pelvis", "LASI"]
    C = ["pelvis", "RASIS"]
    D = ["pelvis", "RASIS"]
    E = "pelvis"
    F = ["pelvis", "SACR", "C7"]
    G = [3]
    H = ["pelvis", ["C7"]]
    I = ["trunk"]
    J = ["mid_trunk"]
    """
    with pytest.raises(ValueError, match="marker set 'lab'") as caught:
        read_marker_set(text, "lab")
    message = str(caught.value)
    for fault in (
        "A: no segment 'pelvsi', did you mean 'pelvis'?",
        "B: no landmark 'LASI', did you mean 'LASIS'?",
        "D and C both mark RASIS",
        "E must be [segment] or [segment, landmark], got 'pelvis'",
        "F must be [segment] or [segment, landmark]",
        "G must be [segment] or [segment, landmark], got [3]",
        "H must be [segment] or [segment, landmark], got ['pelvis', ['C7']]",
        "I: no segment 'trunk', write 'thorax'",
        "J: 'mid_trunk' has no coordinates; write 'thorax', to which it is fixed",
    ):
        assert fault in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[markers", "marker set 'own' is not valid TOML"),
        (f"a = {'[' * 5000}", "marker set 'own' is not valid TOML: it is nested too deeply"),
        ("title = 'x'", r"needs a \[markers\] table with at least one marker"),
        ("[markers]", r"needs a \[markers\] table with at least one marker"),
        (f"markers.{'.'.join('a' * 5000)} = 1", "not valid TOML: it is nested too deeply"),
        (f"[markers]\nA = 0x{'F' * 6000}", "A must be .* got a very large int$"),
        (f"[markers]\nA = {'9' * 400}", "A must be .* got 9{39}…$"),
        ('[markers]\n"\\u001b[2J" = 3', r"'own': \?\[2J must be"),
        ('title = 3\n[markers]\nA = ["pelvis"]', "title must be a text, got 3"),
        ("markers = 3", r"needs a \[markers\] table with at least one marker"),
    ],
)
def test_a_malformed_set_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        read_marker_set(text)


@pytest.mark.parametrize("name", SETS)
def test_every_label_of_a_set_stands_for_one_marker(name):
    labels = Counter(label for marker in marker_sets()[name].markers for label in marker.labels)
    assert max(labels.values()) == 1


def test_a_question_mark_stands_for_both_sides():
    text = '[markers]\n"?KNE" = ["thigh", "LEK"]\n"F?THI" = ["thigh"]\n"?ASI" = ["pelvis", "ASIS"]'
    found = read_marker_set(text)
    assert found.segment == {
        "LKNE": "left_thigh", "FLTHI": "left_thigh", "LASI": "pelvis",
        "RKNE": "right_thigh", "FRTHI": "right_thigh", "RASI": "pelvis",
    }  # fmt: skip
    assert found.landmark == {
        "LLEK": "LKNE", "LASIS": "LASI", "RLEK": "RKNE", "RASIS": "RASI",
    }  # fmt: skip


def test_a_recording_s_own_label_of_a_marker_is_used():
    found = read_marker_set('[markers]\n"?KNM|?MEPI" = ["thigh", "MEK"]').present(["RMEPI", "X"])
    assert found.segment == {"RMEPI": "right_thigh"}
    assert found.landmark == {"RMEK": "RMEPI"}


def test_a_set_can_extend_others_and_say_otherwise():
    text = """
    title = "Our laboratory"
    extends = "hbm2_lower"
    [markers]
    LSMH = ["left_foot", "LMT2"]
    RMT2 = ["right_foot", "RMT5"]
    RSMH = ["right_foot", "RMT2"]
    """
    found, base = read_marker_set(text), marker_sets()["hbm2_lower"]
    assert set(found.segment) == {*base.segment, "LSMH", "RSMH"}
    expected = {"LMT2": "LSMH", "RMT5": "RMT2", "RMT2": "RSMH"}
    assert found.landmark == base.landmark | expected
    assert found.segment["LMT2"] == found.segment["RMT5"].replace("right", "left") == "left_foot"


def test_an_optional_marker_marks_its_landmark_where_it_is_present():
    """The second metatarsal head of CGM2.4, where the older sets only have the toe marker."""
    chosen = marker_sets()["cgm2_lower"]
    toe, head = ["LTOE", "LHEE"], ["LTOE", "LSMH"]
    assert chosen.present(toe).landmark == {"LHEE": "LHEE", "LMT2": "LTOE"}
    assert chosen.present(head).landmark == {"LMT2": "LSMH"}
    assert chosen.present(head).segment == {"LTOE": "left_foot", "LSMH": "left_foot"}


def test_every_landmark_is_explained_and_marked_by_some_set():
    assert all(LANDMARKS.values())
    marked = {mark for chosen in marker_sets().values() for mark in chosen.landmark}
    assert marked == set(LANDMARKS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('extends = "pgi"\n[markers]\nA = ["pelvis"]', "no marker set 'pgi', did you mean 'pig'?"),
        ('extends = 3\n[markers]\nA = ["pelvis"]', "extends must be the name of a set"),
        ('optional = 3\n[markers]\nA = ["pelvis"]', r"\[optional\] must be a table"),
        ('[markers]\n"A|B" = ["pelvis"]\nB = ["pelvis"]', "label B occurs twice"),
        (
            '[markers]\n"?A" = ["thihg", "LKE"]',
            r"'own': \?A: no segment 'thihg', did you mean 'thigh'\?; "
            r"\?A: no landmark 'LKE', did you mean 'LEK'\?$",
        ),
    ],
)
def test_faults_of_the_table_s_own_keys_are_named(text, message):
    with pytest.raises(ValueError, match=message):
        read_marker_set(text)


def test_a_set_is_equal_to_one_of_the_same_markers():
    markers = (SetMarker(("LASI",), "pelvis", "LASIS"),)
    assert read_marker_set('[markers]\nLASI = ["pelvis", "LASIS"]') == MarkerSet(
        "own", "own", markers
    )


def test_the_documentation_lists_every_set_and_every_landmark():
    page = (Path(__file__).resolve().parents[3] / "docs" / "marker_sets.md").read_text("utf-8")
    rows = {row.split("|")[1].strip(): row for row in page.splitlines() if row.startswith("| `")}
    listed = {name.strip("` ") for row in rows for name in row.split(",")}
    assert set(SETS) <= listed
    for landmark, meaning in LANDMARKS.items():
        assert f"`{landmark}`" in page
        assert meaning.removesuffix(", left").removesuffix(", right") in page
