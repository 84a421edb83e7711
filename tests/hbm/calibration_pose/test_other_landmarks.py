"""Other devices, spine levels and heads without a top give the same joints and frames."""

import numpy as np
import pytest

from hbm.calibration_pose.anatomy import LimbMeasures, Measures
from hbm.calibration_pose.landmarks import locate_anatomy
from hbm.markers import marker_sets
from hbm.notes import Note
from hbm.spatial import rotation_about, unit
from tests.synthetic import T_POSE_MM

MEN = Measures("male")
ROD_M = 0.12


def landmarks(*missing, **added_mm):
    points = {mark: T_POSE_MM[name] for mark, name in marker_sets()["hbm2"].landmark.items()}
    return {
        mark: np.array(point) / 1000
        for mark, point in (points | added_mm).items()
        if mark not in missing
    }


def middle(*names):
    return np.mean([landmarks()[name] for name in names], axis=0)


# -- knee alignment device ------------------------------------------------------------------------


def device(side, corner, lateral, turn_rad=0.4):
    """Three rods at right angles from a corner, the first one along the knee's axis."""
    up = unit(np.cross(lateral, np.cross([0.0, 0.0, 1.0], lateral)))
    rods = lateral, up, np.cross(lateral, up)
    rods = [rotation_about(lateral, turn_rad) @ rod for rod in rods]
    return {side + n: corner + ROD_M * r for n, r in zip(("KAX", "KD1", "KD2"), rods, strict=True)}


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("marker", [True, False])
def test_the_device_gives_the_knee_s_axis_and_stands_in_for_the_marker_that_it_covers(side, marker):
    """Its first rod is at a right angle to the thigh; Bell's hip does not depend on the knee."""
    s = side[0].upper()
    both = locate_anatomy(landmarks(), Measures("male", hip="bell"))
    at = landmarks(s + "MEK") if marker else landmarks(s + "MEK", s + "LEK")
    knee, hip = middle(s + "LEK", s + "MEK"), both.points[f"{side}_hip"]
    axis = both.axes[f"{side}_knee"]
    axis = unit(axis - (axis @ unit(hip - knee)) * unit(hip - knee))
    lateral = axis if side == "left" else -axis
    corner = knee + 0.05 * lateral
    limbs = {side: LimbMeasures(knee_width_m=2 * (0.05 - 0.009))}
    measures = Measures("male", hip="bell", limbs=limbs)
    found = locate_anatomy(at | device(s, corner, lateral), measures)
    np.testing.assert_allclose(found.points[f"{side}_knee"], knee, atol=1e-9)
    np.testing.assert_allclose(found.axes[f"{side}_knee"], axis, atol=1e-9)
    assert list(found.markers) == ([] if marker else [s + "LEK"])
    if not marker:
        np.testing.assert_allclose(found.markers[s + "LEK"], corner, atol=1e-12)


# -- foot -----------------------------------------------------------------------------------------


def test_the_first_metatarsal_head_shows_the_toes_axis_better_than_the_second():
    at = landmarks(LMT1=(140, 96, 40))
    found = locate_anatomy(at, MEN)
    np.testing.assert_allclose(found.points["left_toes"], (at["LMT1"] + at["LMT5"]) / 2)
    np.testing.assert_allclose(found.axes["left_toes"], unit(at["LMT5"] - at["LMT1"]))
    np.testing.assert_allclose(found.axes["left_foot"], unit(at["LMT2"] - at["LHEE"]))


def test_the_middle_of_first_and_fifth_metatarsal_head_stands_in_for_the_second():
    at = landmarks("LMT2", LMT1=(140, 96, 40))
    forefoot = (at["LMT1"] + at["LMT5"]) / 2
    found = locate_anatomy(at, MEN)
    np.testing.assert_allclose(found.axes["left_foot"], unit(forefoot - at["LHEE"]))


@pytest.mark.parametrize("side", ["left", "right"])
def test_swapped_labels_on_a_forefoot_are_noticed(side):
    s = side[0].upper()
    swapped = {f"{s}MT2": T_POSE_MM[f"{s}MT5"], f"{s}MT5": T_POSE_MM[f"{s}MT2"]}
    note = Note.of("metatarsals_swapped", side=side)
    assert note in locate_anatomy(landmarks(**swapped), MEN).notes
    assert note not in locate_anatomy(landmarks(), MEN).notes


def test_a_leg_length_is_as_measured_where_no_marker_shows_the_medial_malleolus():
    limbs = dict.fromkeys(("left", "right"), LimbMeasures(leg_length_m=0.80))
    short = Measures("male", limbs=limbs)
    lateral = landmarks("LMM", "RMM")
    by_markers, measured = (locate_anatomy(lateral, m).points["left_hip"] for m in (MEN, short))
    shown = locate_anatomy(landmarks(), short).points["left_hip"]
    assert measured[2] > by_markers[2] + 0.002
    np.testing.assert_allclose(shown, locate_anatomy(landmarks(), MEN).points["left_hip"])


# -- spine ----------------------------------------------------------------------------------------


def test_the_level_of_the_shoulder_blades_stands_in_for_the_tenth_thoracic_vertebra():
    found = locate_anatomy(landmarks("T10", T8=(-105, 0, 1290)), MEN)
    expected = locate_anatomy(landmarks(T10=(-105, 0, 1290)), MEN)
    np.testing.assert_array_equal(found.frames["thorax"], expected.frames["thorax"])
    assert found.rules["T10"].startswith("T8 ")
    plain = locate_anatomy(landmarks(), MEN).frames["thorax"]
    assert np.degrees(np.arccos(found.frames["thorax"][:, 2] @ plain[:, 2])) < 5


@pytest.mark.parametrize("sex", ["male", "female"])
def test_the_second_thoracic_vertebra_is_raised_to_stand_in_for_the_seventh_cervical_one(sex):
    measures = Measures(sex)
    found = locate_anatomy(landmarks("C7", T2=(-88, 4, 1465)), measures)
    plain = locate_anatomy(landmarks(), measures)
    assert found.rules["C7"].startswith("T2 ")
    assert np.linalg.norm(found.points["cervicale"] - plain.points["cervicale"]) < 0.03
    assert np.linalg.norm(found.points["neck"] - plain.points["neck"]) < 0.03
    assert np.degrees(np.arccos(found.frames["thorax"][:, 2] @ plain.frames["thorax"][:, 2])) < 5


# -- head -----------------------------------------------------------------------------------------

HEADBAND = {
    "LFHEAD": (90, 70, 1690), "RFHEAD": (95, -65, 1694),
    "LBHEAD": (-80, 66, 1660), "RBHEAD": (-76, -72, 1665),
}  # fmt: skip
NO_HEAD = ("LHEAD", "RHEAD", "THEAD")


@pytest.mark.parametrize(
    ("markers", "front", "back"),
    [
        (HEADBAND, ("LFHEAD", "RFHEAD"), ("LBHEAD", "RBHEAD")),
        (
            {"LMAS": (5, 70, 1620), "RMAS": (9, -70, 1624), "GLAB": (105, 2, 1680)},
            ("GLAB",),
            ("LMAS", "RMAS"),
        ),
    ],
    ids=["head band", "mastoids"],
)
def test_a_head_without_a_top_marker_is_level_and_faces_where_its_pairs_do(markers, front, back):
    at = landmarks(*NO_HEAD, **markers)
    found = locate_anatomy(at, MEN)
    head = found.frames["head"]
    pairs = [n[1:] for n in markers if n[0] == "L"]
    left = np.sum([at["L" + n] - at["R" + n] for n in pairs], axis=0)
    np.testing.assert_allclose(head[:, 1], unit(left))
    assert head[2, 0] == pytest.approx(0, abs=1e-12)
    assert head[2, 2] > 0.9
    assert "vertex" not in found.points
    ends = [np.mean([at[name] for name in names], axis=0) for names in (front, back)]
    np.testing.assert_allclose(found.points["mid_head"], np.mean(ends, axis=0))


# -- a trunk that no marker shows -----------------------------------------------------------------
