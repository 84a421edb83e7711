"""The axes of a laboratory are inferred from its markers, or asked for where these do not tell."""

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hbm.markers import read_marker_set
from pipeline.io.axes import DIRECTIONS, mean_force, parse_axes, settle_axes
from pipeline.io.recording import Fact

OPPOSITES = (("forward", "back"), ("left", "right"), ("up", "down"))
ALL_AXES = [
    ",".join(words)
    for order in permutations(OPPOSITES)
    for words in product(*order)
    if round(np.linalg.det(np.array([DIRECTIONS[word] for word in words]))) == 1
]


def in_file_axes(vectors, axes):
    """Rotate vectors in lab axes, (..., 3), into the axes of a file."""
    return np.asarray(vectors) @ parse_axes(axes)


@pytest.mark.parametrize("axes", ALL_AXES)
def test_any_axes_of_a_file_are_inferred_from_a_standing_subject(subject, axes):
    position = in_file_axes(subject.position, axes)
    force = in_file_axes([[20, 5, 400]], axes)
    found, _ = settle_axes(None, position, subject.names, plate_forces=force)
    assert found == axes
    np.testing.assert_allclose(position @ parse_axes(found).T, subject.position, atol=1e-12)


@pytest.mark.parametrize("axes", ["", "x,y,z", "forward,right,up", "left,left,up"])
def test_axes_that_are_no_right_handed_directions_are_refused(axes):
    with pytest.raises(ValueError, match=r"three of forward|not right-handed"):
        parse_axes(axes)


def test_a_loaded_plate_shows_up_where_no_marker_is_known():
    position = np.tile([[0.0, 0.1, 1], [0, -0.1, 1]], (5, 1, 1))
    names = ("LF", "RF")
    found, _ = settle_axes(None, position, names, plate_forces=[[0, 0, 300.0]])
    assert found == "forward,left,up"
    with pytest.raises(ValueError, match=r"no shipped set.* without a person"):
        settle_axes(None, position, names, plate_forces=[[0, 0, 20.0]])


@pytest.mark.parametrize(
    ("evidence", "complaint"),
    [
        ({"plate_forces": [[0, 0, -400.0]]}, "-z is up .*plate 1, but"),
        ({"plate_normals": [[0, 1.0, 0]]}, "surface of plate 1;"),
        ({"screen_up": "+Y"}, "but not by Y_SCREEN;"),
    ],
)
def test_contradicting_evidence_of_up_needs_stated_axes(subject, evidence, complaint):
    with pytest.raises(ValueError, match=rf"{complaint}.*give the axes"):
        settle_axes(None, subject.position, subject.names, **evidence)


@given(
    axes=st.sampled_from(ALL_AXES),
    signs=st.lists(st.sampled_from([-1.0, 1.0]), min_size=1, max_size=4),
    screen=st.booleans(),
)
def test_up_is_where_most_witnesses_have_it_whatever_sign_plates_store(axes, signs, screen):
    """Pelvis above feet, and surfaces or the screen; plates that are alike count once."""
    names = ("LASIS", "RASIS", "LHEE", "RHEE", "LTOE", "RTOE")
    places = [
        [0.1, 0.1, 1],
        [0.1, -0.1, 1],
        [0, 0.1, 0],
        [0, -0.1, 0],
        [0.2, 0.1, 0],
        [0.2, -0.1, 0],
    ]
    position = in_file_axes(np.tile(places, (5, 1, 1)), axes)
    loads = in_file_axes([[20 * sign, 5, 400 * sign] for sign in signs], axes)
    letter = int(np.argmax(np.abs(in_file_axes([0, 0, 1.0], axes))))
    sign = "+" if in_file_axes([0, 0, 1.0], axes)[letter] > 0 else "-"
    down = in_file_axes([[0, 0, -1.0]] * len(signs), axes)
    shown = {"screen_up": f"{sign}{'XYZ'[letter]}"} if screen else {"plate_normals": down}
    found, (note, *_) = settle_axes(None, position, names, plate_forces=loads, **shown)
    assert found == axes
    pulling = [f"load on plate {k}" for k, each in enumerate(signs, 1) if each < 0]
    assert not any(name in note.text for name in pulling)
    assert settle_axes(axes, position, names, plate_forces=loads, **shown)[0] == axes


@pytest.mark.parametrize("exchanged", [{"L": "R", "R": "L"}, {"HEE": "MT2", "MT2": "HEE"}])
def test_toes_that_point_backwards_are_exchanged_labels_or_mirrored_coordinates(subject, exchanged):
    sides_or_sites = ((name[0], name[1:]) for name in subject.names)
    swapped = tuple(f"{exchanged.get(a, a)}{exchanged.get(b, b)}" for a, b in sides_or_sites)
    with pytest.raises(ValueError, match=r"toes point .*mirrored"):
        settle_axes(None, subject.position, swapped)


def test_a_subject_who_turns_around_needs_stated_axes(subject):
    position = subject.position - [0, 0.1, 0]
    position[35:, :, :2] *= -1
    with pytest.raises(ValueError, match="turns around"):
        settle_axes(None, position, subject.names)


def test_stated_axes_that_turn_the_subject_upside_down_are_refused(subject):
    with pytest.raises(ValueError, match=r"\+z is up .*down by pelvis"):
        settle_axes("forward,left,up", subject.position * [1, 1, -1], subject.names)


def test_stated_axes_that_confuse_forward_and_sideways_are_warned_of(subject):
    """Otherwise residuals of x and y would be exchanged without notice."""
    _, note = settle_axes("left,back,up", subject.position, subject.names)[1]
    assert (note.code, note.level) == ("subject_faces_sideways", "warning")
    assert note.values["direction"] == "left"


TABLE = """
[markers]
hip_r_front = ["pelvis", "RASIS"]
hip_l_front = ["pelvis", "LASIS"]
heel_right = ["right_foot", "RHEE"]
heel_left = ["left_foot", "LHEE"]
ball_right = ["right_foot", "RMT2"]
ball_left = ["left_foot", "LMT2"]
"""
TABLE_LABELS = {
    "LASIS": "hip_l_front",
    "RASIS": "hip_r_front",
    "LHEE": "heel_left",
    "RHEE": "heel_right",
    "LMT2": "ball_left",
    "RMT2": "ball_right",
}


@pytest.mark.parametrize("axes", ALL_AXES[::8])
def test_the_landmarks_of_a_table_show_the_axes_whatever_its_labels_are(subject, axes):
    """Nothing but markers: up from the feet, left across the pelvis, forward along the feet."""
    table = read_marker_set(TABLE, "own")
    names = tuple(TABLE_LABELS[name] for name in subject.names)
    position = in_file_axes(subject.position, axes)
    assert settle_axes(None, position, names, marker_set=table)[0] == axes


def test_a_table_overrules_what_labels_usually_mean(subject):
    """This laboratory's left is the subject's right; by the labels, the toes would point back."""
    swapped = tuple({"L": "R", "R": "L"}[name[0]] + name[1:] for name in subject.names)
    rows = (
        f'{label} = ["pelvis", "{landmark}"]'
        for label, landmark in zip(swapped, subject.names, strict=True)
    )
    table = read_marker_set("\n".join(["[markers]", *rows]), "swapped")
    assert settle_axes(None, subject.position, swapped, marker_set=table)[0] == "forward,left,up"


@given(
    axes=st.sampled_from(ALL_AXES),
    frame=st.integers(0, 49),
    marker=st.integers(0, 5),
    component=st.integers(0, 2),
    bit=st.integers(0, 31),
)
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_one_flipped_bit_of_a_marker_never_turns_the_axes(
    subject, axes, frame, marker, component, bit
):
    position = in_file_axes(subject.position, axes).astype("<f4")
    word = position[frame, marker, component : component + 1].view("<u4")
    word ^= np.uint32(1 << bit)
    with np.errstate(invalid="ignore"):
        damaged = position.astype(float)
    damaged[~np.isfinite(damaged).all(axis=-1)] = np.nan
    found, _ = settle_axes(None, damaged, subject.names)
    assert found == axes


def test_a_damaged_sample_of_a_plate_does_not_turn_the_axes():
    force = np.tile([5.0, 3.0, 400.0], (2000, 1))
    force[700, 0] = -1e30
    force[900] = np.nan
    np.testing.assert_allclose(mean_force(force), [5, 3, 400], rtol=2e-3)


@pytest.mark.parametrize(
    ("exchanged", "doubtful"),
    [
        ((), None),
        (("PSIS",), "LPSIS/RPSIS"),
        (("ASIS",), "LASIS/RASIS"),
        (("SHO",), "LSHO/RSHO"),
    ],
)
def test_a_pair_that_lies_the_other_way_round_is_a_warning(exchanged, doubtful):
    found, notes = settle_sides(("ASIS", "PSIS", "SHO", "HEE"), exchanged)
    assert found == "forward,left,up"
    doubts = [note.of for note in notes if isinstance(note, Fact)]
    assert doubts == ([f"marker pair {doubtful}"] if doubtful else [])


def test_as_many_pairs_the_other_way_round_as_not_are_refused():
    with pytest.raises(ValueError, match=r"marker pairs .*as many"):
        settle_sides(("ASIS", "SHO"), ("SHO",))


def settle_sides(sites, exchanged):
    """Settle the axes of a subject on a plate, with the labels of both sides exchanged at some."""
    places = {"ASIS": (0.1, 0.15, 1.0), "PSIS": (-0.1, 0.15, 1), "SHO": (0, 0.2, 1.5)}
    places["HEE"] = (0.0, 0.1, 0.05)
    names, position = [], []
    for site in sites:
        for side, sign in (("L", 1), ("R", -1)):
            x, y, z = places[site]
            names.append(side + site)
            position.append((x, -sign * y if site in exchanged else sign * y, z))
    still = np.tile(np.array(position), (20, 1, 1))
    return settle_axes(None, still, names, plate_forces=[[0, 0, 700.0]])


def test_plates_that_pull_the_subject_down_are_refused(subject):
    with pytest.raises(ValueError, match=r"the plate stores.*1: reverse"):
        settle_axes(
            "forward,left,up", subject.position, subject.names, plate_forces=[[0, 0, -400.0]]
        )
