"""Marker sets and marker trajectories."""

from collections import Counter

import numpy as np
import pytest

from hbm.markers import LANDMARKS, Markers, marker_sets, read_marker_set, recognise_marker_set

PAIRED = {name[1:] for name in LANDMARKS if f"L{name[1:]}" in LANDMARKS and name[0] == "R"}
CUSTOM = """
title = "Our pelvis"
[markers]
LASI = ["pelvis", "LASIS"]
RASI = ["pelvis", "RASIS"]
"PEL 3" = ["pelvis"]
"""


@pytest.mark.parametrize(
    ("name", "count"), [("hbm2", 46), ("hbm2_lower", 26), ("hbm1", 47), ("hbm1_lower", 25)]
)
def test_shipped_sets_have_the_documented_number_of_markers(name, count):
    assert len(marker_sets()[name].segment) == count


@pytest.mark.parametrize("name", ["hbm2", "hbm1"])
def test_lower_body_sets_are_parts_of_the_full_ones(name):
    full, lower = marker_sets()[name], marker_sets()[f"{name}_lower"]
    assert lower.segment.items() <= full.segment.items()
    assert lower.landmark.items() <= full.landmark.items()


@pytest.mark.parametrize("name", ["hbm2", "hbm2_lower", "hbm1", "hbm1_lower"])
def test_sets_are_symmetric(name):
    chosen = marker_sets()[name]
    attached = Counter(chosen.segment.values())
    for segment, count in attached.items():
        side, _, part = segment.partition("_")
        other = {"left": f"right_{part}", "right": f"left_{part}"}.get(side, segment)
        assert attached[other] == count
    left, right = ({m[1:] for m in chosen.landmark if m[0] == s and m[1:] in PAIRED} for s in "LR")
    assert left == right


@pytest.mark.parametrize("name", ["hbm2", "hbm2_lower", "hbm1", "hbm1_lower"])
def test_a_trial_s_labels_identify_its_set_even_if_one_is_missing(name):
    labels = list(marker_sets()[name].segment)
    assert recognise_marker_set([*labels, "extra"]).name == name
    assert recognise_marker_set(labels[1:]).name == name


def test_unknown_labels_are_refused_with_the_nearest_set():
    labels = list(marker_sets()["hbm1_lower"].segment)[:12]
    with pytest.raises(
        ValueError, match=r"nearest is 'hbm1_lower' with 12 of 25 present \(missing"
    ):
        recognise_marker_set(labels)


def test_labels_that_differ_in_case_only_are_named():
    labels = [name.lower() for name in marker_sets()["hbm2"].segment]
    with pytest.raises(ValueError, match=r"46 differ in case only, such as 'lasis' for LASIS"):
        recognise_marker_set(labels)


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
        ("title = 'x'", r"needs a \[markers\] table with at least one marker"),
        ("[markers]", r"needs a \[markers\] table with at least one marker"),
        ("markers = 3", r"needs a \[markers\] table with at least one marker"),
    ],
)
def test_a_malformed_set_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        read_marker_set(text)


def test_a_gap_in_one_direction_is_a_gap():
    position = np.zeros((2, 1, 3))
    position[1, 0, 2] = np.nan
    assert np.isnan(Markers([0.0, 0.1], ("A",), position).position[1]).all()


def test_markers_keep_a_read_only_copy():
    position = np.zeros((2, 1, 3))
    markers = Markers([0.0, 0.1], ("A",), position)
    position[:] = 9
    assert markers.position.max() == 0
    with pytest.raises(ValueError, match="read-only"):
        markers.position[:] = 1
    assert markers.rate_hz == pytest.approx(10)


@pytest.mark.parametrize(
    ("time", "names", "shape", "message"),
    [
        ([0, 1], ("A",), (2, 3), r"must have shape \(2, 1, 3\)"),
        ([0, 1], ("A", "B"), (2, 1, 3), r"must have shape \(2, 2, 3\)"),
        ([0, 1], ("A", "A"), (2, 2, 3), r"unique, but these appear twice: \['A'\]"),
        ([0, 0], ("A",), (2, 1, 3), "marker times must increase"),
    ],
)
def test_inconsistent_markers_are_refused(time, names, shape, message):
    with pytest.raises(ValueError, match=message):
        Markers(time, names, np.zeros(shape))
