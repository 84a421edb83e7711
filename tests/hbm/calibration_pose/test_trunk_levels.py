"""The trunk's parts end where de Leva's table and bodies of known proportions have them."""

import csv
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.body import build_body
from hbm.calibration_pose.anatomy import SHOULDER_DROP_PER_WIDTH, Anatomy
from hbm.calibration_pose.landmarks import (
    HEIGHT_MM,
    height_per_cervicale,
    locate_trunk_levels,
)
from hbm.segments import SEXES
from hbm.spatial import rotation_about
from tests.hbm.people import person
from tests.synthetic import MASS_KG, STATURE_M, T_POSE_MM

LEFT = np.array([0.0, 1.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
SUPR_XYPH_MM = {"male": 170.7, "female": 142.5}
"""Length of de Leva's alternative upper trunk."""
ABOVE_LUMBAR = [n for n in T_POSE_MM if n in ("C7", "T10", "JN", "XIPH") or T_POSE_MM[n][2] > 1300]


def body_of(markers):
    return build_body(markers, mass=MASS_KG, marker_set="hbm2", sex="male", height_m=STATURE_M)


def mean_person(sex, *missing):
    """A standing person with de Leva's mean trunk, whose axis is the lab's vertical through 0."""
    h = {name: mm / 1000 for name, mm in HEIGHT_MM[sex].items()}
    anatomy = Anatomy()
    anatomy.frames["thorax"] = np.eye(3)
    anatomy.points |= {"pelvis": np.array([0.02, 0, 0]), "trunk_top": h["notch"] * UP}
    acromions = h["mid_shoulders"] + SHOULDER_DROP_PER_WIDTH * 0.38
    landmarks = {
        "C7": np.array([-0.07, 0, h["cervicale"]]),
        "JN": np.array([0.05, 0, h["notch"]]),
        "XIPH": np.array([0.10, 0, h["xiphoid"]]),
        "LSHO": np.array([-0.02, 0.19, acromions]),
        "RSHO": np.array([-0.02, -0.19, acromions]),
    }
    shown = {name: p for name, p in landmarks.items() if name not in missing}
    locate_trunk_levels(anatomy, shown, sex)
    return anatomy


@pytest.mark.parametrize("sex", ["male", "female"])
def test_heights_are_sums_of_the_table_s_lengths(sex):
    text = files("hbm").joinpath("de_leva_1996.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    mm = {r["segment"]: float(r["length_mm"]) for r in rows if r["sex"] == sex}
    height = HEIGHT_MM[sex]
    assert height["xiphoid"] == pytest.approx(mm["mid_trunk"] + mm["lower_trunk"])
    assert height["cervicale"] == pytest.approx(height["xiphoid"] + mm["upper_trunk"])
    assert height["notch"] == pytest.approx(height["xiphoid"] + SUPR_XYPH_MM[sex])


def test_the_upper_trunk_s_centre_is_51_percent_of_the_way_from_c7_s_level_to_the_xiphoid_s():
    body = body_of(person())
    c7, notch, t10, xiphoid = (
        body.marker_position[body.markers.index(name)] for name in ("C7", "JN", "T10", "XIPH")
    )
    assert abs((c7 + notch - t10 - xiphoid)[0]) < 1e-12, "the thorax's z axis is the trunk's"
    thorax = body.segments["thorax"]
    assert thorax.center[2] == pytest.approx(c7[2] + 0.5066 * (xiphoid[2] - c7[2]), abs=1e-12)
    np.testing.assert_allclose(thorax.center[:2], (c7 + notch)[:2] / 2, atol=1e-12)
    assert body.lengths["thorax"] == pytest.approx(c7[2] - xiphoid[2], abs=1e-12)


@settings(max_examples=5)
@given(pitch=st.floats(-0.5, 0.5), roll=st.floats(-0.3, 0.3))
def test_a_person_who_bends_the_trunk_in_the_pose_has_the_same_upper_trunk(pitch, roll):
    """The levels are taken along the trunk, not along the lab's vertical."""
    R = rotation_about([0.0, 1.0, 0.0], pitch) @ rotation_about([1.0, 0.0, 0.0], roll)
    pivot = np.array([-40.0, 0, 1040])
    bent = {n: R @ (np.array(T_POSE_MM[n]) - pivot) + pivot for n in ABOVE_LUMBAR}
    upright, found = (body_of(p).segments["thorax"] for p in (person(), person(**bent)))
    np.testing.assert_allclose(found.tensor, upright.tensor, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("depth_mm", [40])
def test_a_deeper_chest_has_the_same_upper_trunk(depth_mm):
    """Half of it in front, half behind, at right angles to the trunk's axis."""
    pose = {name: np.array(T_POSE_MM[name], float) for name in ("C7", "JN", "T10", "XIPH")}
    up = pose["C7"] + pose["JN"] - pose["T10"] - pose["XIPH"]
    ahead = np.cross(np.cross(up, pose["JN"] - pose["C7"]), up)
    ahead *= depth_mm / 2 / np.linalg.norm(ahead)
    deeper = {n: p + (1 if n in ("JN", "XIPH") else -1) * ahead for n, p in pose.items()}
    usual, deep = (body_of(p).segments["thorax"] for p in (person(), person(**deeper)))
    np.testing.assert_allclose(deep.center, usual.center, atol=1e-12)
    np.testing.assert_allclose(np.diag(deep.tensor), np.diag(usual.tensor), rtol=1e-9)


@pytest.mark.parametrize("sex", ["male", "female"])
@pytest.mark.parametrize("missing", [("C7",), ("C7", "JN"), ("XIPH",)])
def test_a_level_that_no_marker_shows_is_right_in_a_person_of_mean_proportions(sex, missing):
    found, seen = mean_person(sex, *missing), mean_person(sex)
    assert seen.rules == {}
    (rule,) = found.rules
    assert missing[0] in rule
    for name in ("cervicale", "xiphoid", "mid_shoulders"):
        np.testing.assert_allclose(found.points[name], seen.points[name], atol=1e-12)
        np.testing.assert_allclose(found.points[name], HEIGHT_MM[sex][name] / 1000 * UP, atol=1e-12)


def test_unspecified_sex_has_the_mean_of_both_shares():
    for level in HEIGHT_MM["male"]:
        men, women, both = (height_per_cervicale(level, sex) for sex in SEXES)
        assert both == pytest.approx((men + women) / 2)


def test_shoulders_that_no_marker_shows_are_at_de_leva_s_level():
    """In men 87.8 of 603.3 mm below the cervicale, measured from mid-hip."""
    arms = [n for n in T_POSE_MM if n[1:] in ("DELT", "LEE", "MEE", "FRM", "LW", "MW", "FIN")]
    body = body_of(person(*arms, "LSHO", "RSHO"))
    c7 = body.marker_position[body.markers.index("C7")]
    hips = -body.offsets["thorax"]  # pelvis and thorax frames differ by the tilt of the pelvis
    shoulder = body.offsets["left_shoulder"]
    expected = 515.5 / 603.3 * (c7[2] - hips[2]) + hips[2]
    assert shoulder[2] == pytest.approx(expected, abs=0.01)
    assert c7[2] - shoulder[2] == pytest.approx(0.088 * STATURE_M / 1.741, abs=0.012)


def test_the_head_ends_on_the_trunk_s_axis_and_not_at_the_marker_behind_it():
    body = body_of(person())
    c7 = body.marker_position[body.markers.index("C7")]
    head, neck = body.segments["head"], body.offsets["head"]
    behind_axis = body.segments["thorax"].center[0] - c7[0]
    assert behind_axis == pytest.approx(0.065, abs=0.005)
    assert head.center[0] + neck[0] - c7[0] > 0.06


def test_a_xiphoid_above_the_neck_is_refused():
    with pytest.raises(ValueError, match="XIPH, C7 and JN"):
        body_of(person(XIPH=(104, 4, 1543), T10=(-98, -3, 1016)))
