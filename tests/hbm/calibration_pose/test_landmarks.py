"""Joint centres and axes follow the published rules, and a landmark that is missing is named."""

import numpy as np
import pytest

from hbm.calibration_pose.anatomy import LimbMeasures, Measures
from hbm.calibration_pose.landmarks import hip_center, locate_anatomy, pelvis_frame
from hbm.markers import marker_sets
from tests.hbm.people import hbm1_person
from tests.synthetic import T_POSE_MM

MEN = Measures("male")


def landmarks(*missing, **moved_mm):
    """The synthetic person's landmarks in metres."""
    points = {**T_POSE_MM, **moved_mm}
    return {
        mark: np.array(points[name]) / 1000
        for mark, name in marker_sets()["hbm2"].landmark.items()
        if mark not in missing
    }


def hbm1_landmarks(name, *missing):
    chosen = marker_sets()[name]
    markers = hbm1_person(chosen.segment)
    at = dict(zip(markers.names, markers.position[0], strict=True))
    return {mark: at[n] for mark, n in chosen.landmark.items() if mark not in missing}


def located(*missing, measures=MEN, **moved_mm):
    return locate_anatomy(landmarks(*missing, **moved_mm), measures)


def middle(*names):
    return np.mean([landmarks()[name] for name in names], axis=0)


# -- pelvis and hips ------------------------------------------------------------------------------


def test_harrington_s_hip_of_a_pelvis_24_cm_wide_and_15_cm_deep_with_legs_of_90_cm():
    """In mm: 0.24·150 + 9.9 back, 0.28·150 + 0.16·240 + 7.9 out, 0.16·240 + 0.04·900 + 7.1 down."""
    bare = Measures(marker_offset_m=0.0)
    expected = np.array([-45.9, 88.3, -81.5]) / 1000
    np.testing.assert_allclose(hip_center("left", 0.24, 0.15, 0.9, bare), expected)
    np.testing.assert_allclose(hip_center("right", 0.24, 0.15, 0.9, bare), expected * [1, -1, 1])


def test_harrington_s_hip_without_leg_length():
    """In mm: 0.33·240 + 7.3 out and 0.30·240 + 10.9 down."""
    found = hip_center("left", 0.24, 0.15, None, Measures(marker_offset_m=0.0))
    np.testing.assert_allclose(found, np.array([-45.9, 86.5, -82.9]) / 1000)


def test_bell_s_hip_is_a_share_of_the_pelvis_width():
    found = hip_center("left", 0.24, 0.15, 0.9, Measures(hip="bell", marker_offset_m=0.0))
    np.testing.assert_allclose(found, 0.24 * np.array([-0.19, 0.36, -0.30]))


def test_the_hips_follow_from_the_subject_s_own_pelvis_and_legs():
    at = landmarks()
    R, origin, back, _ = pelvis_frame(at)
    width = np.linalg.norm(at["LASIS"] - at["RASIS"])
    depth = np.linalg.norm(origin - back)
    leg = np.linalg.norm(at["RASIS"] - at["RMEK"]) + np.linalg.norm(at["RMEK"] - at["RMM"])
    expected = origin + R @ hip_center("right", width, depth, leg, MEN)
    np.testing.assert_allclose(located().points["right_hip"], expected)


def test_the_pelvis_frame_lies_in_the_plane_of_the_spines():
    at = landmarks()
    R, origin, back, _ = pelvis_frame(at)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1)
    left = (at["LASIS"] - at["RASIS"]) / np.linalg.norm(at["LASIS"] - at["RASIS"])
    np.testing.assert_allclose(R[:, 1], left)
    assert R[:, 2] @ (origin - back) == pytest.approx(0, abs=1e-12)
    assert R[2, 2] > 0.9


@pytest.mark.parametrize("name", ["LASIS", "RPSIS"])
def test_a_single_missing_spine_is_the_mirror_image_of_its_opposite(name):
    """As far from the right as its opposite is from the left, and straight across."""
    found, at = located(name), landmarks()
    side, kind, other = name[0], name[1:], ("R" if name[0] == "L" else "L")
    assert found.rules == {name: f"the mirror image of {other + kind}"}
    image = 2 * found.points["mid_asis" if kind == "ASIS" else "mid_psis"] - at[other + kind]
    pair = "PSIS" if kind == "ASIS" else "ASIS"
    for a, b in ((side, other), (other, side)):
        distance = np.linalg.norm(image - at[a + pair])
        assert distance == pytest.approx(np.linalg.norm(at[other + kind] - at[b + pair]))
    across = np.cross(image - at[other + kind], at[side + pair] - at[other + pair])
    np.testing.assert_allclose(across, 0, atol=1e-12)


def test_the_sacrum_marker_replaces_both_posterior_spines():
    at = landmarks("LPSIS", "RPSIS") | {"SACR": middle("LPSIS", "RPSIS")}
    found = locate_anatomy(at, MEN)
    assert "PSIS" in found.rules
    np.testing.assert_allclose(found.points["left_hip"], located().points["left_hip"])


def test_the_lumbar_joint_is_a_share_of_the_pelvis_width():
    R, origin, _, _ = pelvis_frame(landmarks())
    width = np.linalg.norm(landmarks()["LASIS"] - landmarks()["RASIS"])
    for sex, share in (("male", (-0.264, 0, 0.126)), ("female", (-0.289, 0, 0.172))):
        found = located(measures=Measures(sex)).points["lumbar"]
        np.testing.assert_allclose(found, origin + R @ (width * np.array(share)))


# -- legs -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("s", "LR")
def test_knees_and_ankles_are_midway_and_their_axes_point_left(s):
    side = {"L": "left", "R": "right"}[s]
    found, at = located(), landmarks()
    np.testing.assert_allclose(found.points[f"{side}_knee"], middle(s + "LEK", s + "MEK"))
    np.testing.assert_allclose(found.points[f"{side}_ankle"], middle(s + "LM", s + "MM"))
    for joint, (a, b) in {"knee": ("LEK", "MEK"), "ankle": ("LM", "MM")}.items():
        across = at[s + a] - at[s + b] if s == "L" else at[s + b] - at[s + a]
        axis = found.axes[f"{side}_{joint}"]
        np.testing.assert_allclose(axis, across / np.linalg.norm(across))
        assert axis[1] > 0.8


@pytest.mark.parametrize(
    ("missing", "joint", "lateral", "share"),
    [("RMEK", "knee", "RLEK", 0.118), ("RMM", "ankle", "RLM", 0.085)],
)
def test_without_a_medial_marker_the_centre_is_a_share_of_the_shank_away(
    missing, joint, lateral, share
):
    found, at = located(missing), landmarks()
    center = found.points[f"right_{joint}"]
    shank = np.linalg.norm(at["RLEK"] - at["RLM"])
    assert np.linalg.norm(center - at[lateral]) == pytest.approx(share * shank)
    proximal = found.points["right_hip" if joint == "knee" else "right_knee"]
    assert (center - at[lateral]) @ (center - proximal) == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(center - located().points[f"right_{joint}"]) < 0.02
    assert {f"right_{joint}", lateral} <= set(found.rules[missing].split())


def test_width_and_marker_radius_are_the_centre_s_distance_from_the_lateral_marker():
    limbs = {
        "left": LimbMeasures(knee_width_m=0.10, ankle_width_m=0.07),
        "right": LimbMeasures(knee_width_m=0.11, ankle_width_m=0.08),
    }
    measures = Measures("male", limbs=limbs, marker_offset_m=0.012)
    found, at = located("LMEK", "LMM", "RMEK", "RMM", measures=measures), landmarks()
    for joint, lateral, distance in (
        ("left_knee", "LLEK", 0.062),
        ("left_ankle", "LLM", 0.047),
        ("right_knee", "RLEK", 0.067),
        ("right_ankle", "RLM", 0.052),
    ):
        assert np.linalg.norm(found.points[joint] - at[lateral]) == pytest.approx(distance)


def test_a_trochanter_gives_the_frontal_plane_of_the_thigh():
    hbm1 = hbm1_landmarks("hbm1")
    found = locate_anatomy(hbm1, MEN)
    normal = np.cross(
        found.points["left_hip"] - hbm1["LGTRO"], found.points["left_hip"] - hbm1["LLEK"]
    )
    center = found.points["left_knee"] - found.points["left_hip"]
    assert normal @ center / np.linalg.norm(normal) == pytest.approx(0, abs=1e-12)


def test_the_foot_extends_from_the_heel_beyond_the_second_metatarsal_head():
    found, at = located(), landmarks()
    along = at["LMT2"] - at["LHEE"]
    np.testing.assert_allclose(found.points["left_toe_tip"], at["LHEE"] + 1.25 * along)
    np.testing.assert_allclose(found.points["left_toes"], middle("LMT2", "LMT5"))


def test_a_toe_marker_is_the_tip_of_the_foot():
    at = hbm1_landmarks("hbm1")
    found = locate_anatomy(at, MEN)
    np.testing.assert_allclose(found.points["left_toe_tip"], at["LTOE"])
    along = (at["LTOE"] - at["LHEE"]) / np.linalg.norm(at["LTOE"] - at["LHEE"])
    ball = at["LHEE"] + ((at["LMT5"] - at["LHEE"]) @ along) * along
    np.testing.assert_allclose(found.points["left_toes"], ball)


# -- trunk, head, arms ----------------------------------------------------------------------------


def test_the_neck_is_55_percent_of_the_way_from_c7_to_the_notch_8_degrees_up():
    found, at = located(), landmarks()
    forward, neck = at["JN"] - at["C7"], found.points["neck"] - at["C7"]
    assert np.linalg.norm(neck) == pytest.approx(0.55 * np.linalg.norm(forward))
    cosine = neck @ forward / np.linalg.norm(neck) / np.linalg.norm(forward)
    assert np.degrees(np.arccos(cosine)) == pytest.approx(8)
    assert neck @ found.frames["thorax"][:, 2] > forward @ found.frames["thorax"][:, 2] * 0.55


def test_the_trunk_axis_runs_from_lower_to_upper_ribcage():
    found = located()
    up = middle("C7", "JN") - middle("T10", "XIPH")
    np.testing.assert_allclose(found.frames["thorax"][:, 2], up / np.linalg.norm(up))


def test_shoulders_are_17_percent_of_their_distance_below_the_acromions():
    found, at = located(), landmarks()
    drop = at["LSHO"] - found.points["left_shoulder"]
    np.testing.assert_allclose(
        drop, 0.17 * np.linalg.norm(at["LSHO"] - at["RSHO"]) * found.frames["thorax"][:, 2]
    )


def test_a_wrist_with_one_marker_has_the_elbow_s_axis():
    found = located("LMW")
    np.testing.assert_allclose(found.points["left_wrist"], landmarks()["LLW"])
    np.testing.assert_allclose(found.axes["left_wrist"], found.axes["left_elbow"])
    assert any("left wrist" in what for what in found.rules)


def test_an_arm_is_found_without_the_other_acromion():
    """The width is then twice the distance from the mid-plane; the person is nearly symmetric."""
    found = located("RSHO")
    assert "right_shoulder" not in found.points
    difference = found.points["left_shoulder"] - located().points["left_shoulder"]
    assert np.linalg.norm(difference) < 0.01


# -- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        (("LASIS", "LPSIS"), "pelvis .*LASIS .*ASIS .*PSIS"),
        (("LLEK",), "left knee .*LLEK .*knee_width_m"),
        (("RMT2",), "right foot .*RTOE .*RMT2"),
    ],
)
def test_a_landmark_that_no_rule_replaces_is_named(missing, message):
    with pytest.raises(ValueError, match=message):
        located(*missing)


@pytest.mark.parametrize(("a", "b", "joint"), [("LLEK", "LMEK", "knee"), ("RLM", "RMM", "ankle")])
def test_swapped_lateral_and_medial_markers_are_refused(a, b, joint):
    swapped = {a: T_POSE_MM[b], b: T_POSE_MM[a]}
    said = rf"{joint}'s lateral .*medial side; .*{a}, {b}\)"
    with pytest.raises(ValueError, match=said):
        located(**swapped)
