"""Marker sets are tables, and the one that the labels of a recording belong to is recognised."""

import numpy as np
import pytest

from hbm.markers import (
    marker_sets,
    read_marker_set,
    recognise_marker_set,
)

SETS = tuple(marker_sets())
OTHER_POINTS = ("LHipAngles", "CentreOfMass", "PELO", "*115", "unlabelled_1", "wand1", "HEAD")


@pytest.mark.parametrize("name", ["hbm2", "hbm1", "pig", "cgm2", "ior"])
def test_lower_body_sets_are_parts_of_the_full_ones(name):
    full, lower = marker_sets()[name], marker_sets()[f"{name}_lower"]
    assert lower.segment.items() <= full.segment.items()
    assert lower.landmark.items() <= full.landmark.items()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[markers", "'own' .*valid TOML"),
        ("title = 'x'", r"needs a \[markers\] table with at least one marker"),
        ('[markers]\nA = ["pelvsi"]', "'pelvsi', .*'pelvis'"),
        ('[markers]\n"\\u001b[2J" = 3', r"'own': \?\[2J must be"),
    ],
)
def test_a_malformed_set_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        read_marker_set(text)


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


def labels_of(name, *, optional=False):
    """The first label of each marker of a set."""
    return [m.labels[0] for m in marker_sets()[name].markers if optional or not m.optional]


def without(labels, *absent):
    return [name for name in labels if name not in absent]


def sides(*labels):
    return [side + label for side in "LR" for label in labels]


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("optional", [False, True])
def test_a_trial_s_labels_identify_its_set(name, optional):
    assert recognise_marker_set(labels_of(name, optional=optional)) == marker_sets()[name]


@pytest.mark.parametrize("name", SETS)
def test_a_set_is_recognised_with_a_fifth_of_its_labels_missing_and_points_of_other_kinds(name):
    rng = np.random.default_rng(SETS.index(name))
    labels = labels_of(name)
    for _ in range(50):
        kept = rng.permutation(labels)[: int(np.ceil(0.8 * len(labels)))].tolist()
        found = recognise_marker_set(rng.permutation([*kept, *OTHER_POINTS]).tolist())
        assert found == marker_sets()[name]


@pytest.mark.parametrize("name", ["pig"])
@pytest.mark.parametrize(
    ("absent", "added"),
    [
        (("LPSI", "RPSI"), ["SACR"]),
        (("LKNE", "RKNE", "LPSI", "RPSI"), ["SACR", *sides("KAX", "KD1", "KD2", "MED")]),
        ((), sides("MKNE", "MANK")),
    ],
)
def test_the_variants_of_plug_in_gait_are_plug_in_gait(name, absent, added):
    assert recognise_marker_set([*without(labels_of(name), *absent), *added]).name == name


def test_arms_of_another_set_complete_a_body():
    """Human Body Model 2 on trunk and legs, Plug-in-Gait on the arms, three markers of CGM2.5."""
    arms = sides("SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
    legs = sides("THI", "THAD", "TIB", "TIAD", "TOE", "SMH")
    labels = [*labels_of("hbm2_lower"), *arms, "GLAB", "LMAS", "RMAS", *legs]
    found = recognise_marker_set(labels)
    present = found.present(labels)
    assert found.name == "hbm2+cgm2"
    assert present.landmark["LLEE"] == "LELB"
    assert present.landmark["RWRA"] == "RWRA"
    assert present.landmark["LMT2"] == "LMT2"
    assert not set(legs) & set(present.segment), "the legs are complete"


def test_a_complete_part_takes_no_marker_of_another_set():
    labels = labels_of("hbm2")
    assert recognise_marker_set([*labels, *sides("ELB", "UPA"), "GLAB"]) == marker_sets()["hbm2"]


def test_unknown_labels_are_refused_with_the_nearest_set():
    labels = labels_of("hbm1_lower")[:12]
    with pytest.raises(
        ValueError,
        match=r"SACR, .* hbm1_lower with 8 of .* 21 .* hbm2_lower with 5 of .*--rename",
    ):
        recognise_marker_set(labels)


def test_a_refusal_lists_twenty_labels_and_no_set_of_which_no_label_is_there():
    with pytest.raises(ValueError, match=r"P0, .*, P19 and 10 more; none"):
        recognise_marker_set([f"P{i}" for i in range(30)])


def test_a_beginning_that_unknown_labels_share_is_not_shown():
    with pytest.raises(ValueError, match=r"…P0, .* --label-prefix") as refused:
        recognise_marker_set([f"Anna_P{i}" for i in range(30)])
    assert "Anna" not in str(refused.value)


@pytest.mark.parametrize("name", SETS)
def test_upper_and_lower_case_are_the_same(name):
    lower = [label.lower() for label in labels_of(name)]
    found = recognise_marker_set(lower)
    assert found == marker_sets()[name]
    assert set(found.present(lower).segment) == set(lower)


def test_labels_that_differ_in_signs_alone_are_refused_with_the_options_that_rename_them():
    labels = [f"{name[0]}_{name[1:]}" for name in labels_of("pig_lower")]
    with pytest.raises(ValueError, match=r"--rename L_ASI=LASI --rename") as caught:
        recognise_marker_set(labels)
    options = str(caught.value).split("--rename ")[1:]
    renamed = dict(option.strip().split("=") for option in options)
    assert recognise_marker_set([renamed[label] for label in labels]).name == "pig_lower"


def test_the_labels_of_opencap_s_laboratory_are_those_of_its_videos_without_study():
    labels = [label.removesuffix("_study") for label in labels_of("opencap")]
    assert recognise_marker_set(labels) == marker_sets()["opencap"]
