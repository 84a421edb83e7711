"""Which marker set a recording's labels belong to."""

import numpy as np
import pytest

from hbm.markers import marker_sets, recognise_marker_set

SETS = tuple(marker_sets())
OTHER_POINTS = ("LHipAngles", "CentreOfMass", "PELO", "*115", "unlabelled_1", "wand1", "HEAD")


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
def test_its_other_labels_identify_a_set_as_well(name):
    last = [marker.labels[-1] for marker in marker_sets()[name].markers if not marker.optional]
    assert recognise_marker_set(last).name == name


@pytest.mark.parametrize("name", SETS)
def test_a_set_is_recognised_with_a_fifth_of_its_labels_missing_and_points_of_other_kinds(name):
    rng = np.random.default_rng(SETS.index(name))
    labels = labels_of(name)
    for _ in range(200):
        kept = rng.permutation(labels)[: int(np.ceil(0.8 * len(labels)))].tolist()
        found = recognise_marker_set(rng.permutation([*kept, *OTHER_POINTS]).tolist())
        assert found == marker_sets()[name]


@pytest.mark.parametrize("name", ["pig_lower", "pig"])
@pytest.mark.parametrize(
    ("absent", "added"),
    [
        (("LPSI", "RPSI"), ["SACR"]),
        (("LKNE", "RKNE"), sides("KAX", "KD1", "KD2")),
        (("LKNE", "RKNE", "LPSI", "RPSI"), ["SACR", *sides("KAX", "KD1", "KD2", "MED")]),
        ((), sides("KNM", "MED")),
        ((), sides("MKNE", "MANK")),
    ],
)
def test_the_variants_of_plug_in_gait_are_plug_in_gait(name, absent, added):
    assert recognise_marker_set([*without(labels_of(name), *absent), *added]).name == name


def test_a_trunk_without_arms_is_the_full_set():
    """Plug-in-Gait of pelvis, legs and trunk; the arms are simply not there."""
    found = recognise_marker_set([*labels_of("pig_lower"), "C7", "T10", "CLAV", "STRN"])
    assert found.name == "pig"
    assert (
        recognise_marker_set([*labels_of("hbm2_lower"), "LHEAD", "RHEAD", "THEAD"]).name == "hbm2"
    )


def test_the_versions_of_cgm2_have_one_name_from_the_third_on():
    feet = sides("FMH", "SMH", "VMH")
    head = ["T2", "GLAB", "LMAS", "RMAS"]
    bare = without(labels_of("cgm2"), "C7", *sides("FHD", "BHD"))
    assert recognise_marker_set([*labels_of("cgm2_lower"), *feet]).name == "cgm2_lower"
    assert recognise_marker_set([*bare, *feet, *head]).name == "cgm2"


def test_the_trials_of_a_recording_session_have_the_same_set():
    """The walk lacks what only the calibration pose has, and the pose what the device covers."""
    pose = [*without(labels_of("pig"), "LKNE", "RKNE"), *sides("KAX", "KD1", "KD2", "MED")]
    assert recognise_marker_set(pose) == recognise_marker_set(labels_of("pig"))
    medial = labels_of("ior", optional=True)
    assert recognise_marker_set(medial) == recognise_marker_set(labels_of("ior"))


def test_labels_that_mean_different_things_in_different_sets_are_these():
    meanings = {}
    for chosen in marker_sets().values():
        for marker in chosen.markers:
            for label in marker.labels:
                meanings.setdefault(label, set()).add((marker.segment, marker.landmark))
    assert {label for label, meant in meanings.items() if len(meant) > 1} == {
        "STRN",
        "LTOE",
        "RTOE",
    }


def test_arms_of_another_set_complete_a_body():
    """Human Body Model 2 on trunk and legs, Plug-in-Gait on the arms, three markers of CGM2.5."""
    arms = sides("SHO", "UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
    legs = sides("THI", "THAD", "TIB", "TIAD", "TOE", "SMH")
    labels = [*labels_of("hbm2_lower"), *arms, "GLAB", "LMAS", "RMAS", *legs]
    found = recognise_marker_set(labels)
    present = found.present(labels)
    assert found.name == "hbm2+cgm2"
    assert found.title == (
        "Human Body Model 2, full body, 46 markers; arms and head as in CGM2.3 to 2.5, full body, "
        "47 markers"
    )
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
        match=r"match no known set; nearest is 'hbm1_lower' with 8 of its 21 markers of pelvis and "
        r"legs \(missing .*, …\); rename them \(--rename\) or give a marker set",
    ):
        recognise_marker_set(labels)


def test_no_set_is_named_of_which_no_label_is_there():
    with pytest.raises(ValueError, match=r"none of A1, B2 is a marker of pelvis or legs; rename"):
        recognise_marker_set(["A1", "B2"])


def test_labels_that_differ_in_case_only_are_named():
    with pytest.raises(ValueError, match=r"46 differ in case only, such as 'lasis' for LASIS"):
        recognise_marker_set([name.lower() for name in labels_of("hbm2")])
