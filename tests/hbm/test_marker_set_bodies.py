"""Every shipped marker set gives the body of the person that wears the markers."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.calibration_pose.anatomy import LimbMeasures
from hbm.coordinates import COORDINATES, MOVING, SEGMENTS, SIDES
from hbm.ik.tracking import solve_ik
from hbm.markers import marker_sets
from hbm.poses import segment_frames
from hbm.spatial import unit
from tests.hbm.people import mirrored, moved, standing
from tests.hbm.wearers import MEDIAL, PIG, PIG_LOWER, SETS, joints, measured, points, wearing
from tests.synthetic import MASS_KG, STATURE_M

LEGS = ("thigh", "shank", "foot")
ARMS = ("upper_arm", "forearm", "hand")
ROD_M = 0.1
LOOSE_M = {"gait2354": 1e-4, "opencap": 1e-3, "helen_hayes": 1e-3}
"""Sets with fewer markers on trunk or arms than coordinates: these are locked, the markers not."""


def built(markers, **options):
    usual = {"mass": MASS_KG, "sex": "male", "height_m": STATURE_M, "limbs": measured()}
    return build_body(markers, **usual | options)


def errors_mm(body, markers, segments):
    """Distance of the joints of a body in its calibration pose from the person's own."""
    motion = solve_ik(body, markers)
    assert motion.converged.all()
    origin = segment_frames(body, motion.q[:1])[1][0]
    names = [f"{side}_{s}" for side in SIDES for s in segments]
    return {s: 1000 * float(np.linalg.norm(origin[MOVING.index(s)] - joints()[s])) for s in names}


@pytest.mark.parametrize("name", SETS)
def test_every_set_is_recognised_and_makes_a_body_that_fits_its_pose(name):
    static = wearing(SETS[name])
    body = built(static)
    assert body.marker_set == marker_sets()[name]
    assert set(body.markers) == set(static.names)
    assert solve_ik(body, static).marker_error.max() < LOOSE_M.get(name, 1e-9)


@pytest.mark.parametrize("name", ["pig", "cgm2"])
def test_with_medial_markers_all_joints_are_the_person_s_own(name):
    """CGM2.5's T2 is not C7: the trunk's axis, and with it the shoulders, differ by 2.4 mm."""
    static = wearing(SETS[name] | MEDIAL)
    found = errors_mm(built(static), static, (*LEGS, *ARMS))
    shoulders = {s for s in found if s.endswith("upper_arm")}
    assert all(found[s] < (3 if name == "cgm2" else 1e-6) for s in shoulders)
    assert max(found[s] for s in found.keys() - shoulders) < 1e-6


@pytest.mark.parametrize("name", ["ior_lower", "ior"])
def test_the_legs_of_the_rizzoli_set_are_the_person_s_own(name):
    static = wearing(SETS[name])
    assert max(errors_mm(built(static), static, LEGS).values()) < 1e-6


def test_lateral_markers_and_widths_place_the_joints_as_well_as_their_axes_are_known():
    """Half a width of 55, 38, 37 mm times the angle between the true axis and the one taken.

    The person's knee axes are 5 to 6° from the pelvis' own, the ankles' 19° from the knees' (tibial
    torsion) and the elbows' 11° from the perpendicular to the plane of the arm.
    """
    static = wearing(PIG)
    found = errors_mm(built(static), static, (*LEGS, *ARMS))
    limits = {"thigh": 1, "shank": 7, "foot": 16, "upper_arm": 1e-6, "forearm": 11, "hand": 1e-6}
    for s, error in found.items():
        assert error < limits[s.split("_", 1)[1]], s


def test_a_knee_alignment_device_replaces_knee_markers_in_the_pose_and_not_in_the_trial():
    """The marker that the device covers is where its corner was."""
    at, rods = points(), {}
    for s in SIDES.values():
        lateral = unit(at[f"{s}LEK"] - at[f"{s}MEK"])
        up = unit(np.cross(lateral, np.cross([0.0, 0.0, 1.0], lateral)))
        ends = {"KAX": lateral, "KD1": up, "KD2": np.cross(lateral, up)}
        rods |= {s + n: 1000 * (at[f"{s}LEK"] + ROD_M * way) for n, way in ends.items()}
    worn = {label: 1000 * at[point] for label, point in PIG.items() if label[1:] != "KNE"}
    pose = standing(worn | rods)
    body = built(pose)
    assert {"LKNE", "RKNE", "LKAX"} <= set(body.markers)
    assert body.marker_set.name == "pig"
    trial = wearing(PIG)
    assert solve_ik(body, trial).marker_error.max() < 2e-3
    assert max(e for s, e in errors_mm(body, trial, ("shank",)).items()) < 2


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("yaw", [0.8])
def test_the_body_of_a_turned_person_is_the_same(name, yaw):
    static = wearing(SETS[name])
    body, turned = built(static), built(moved(static, yaw, (2.0, -5.0, 0.0)))
    np.testing.assert_allclose(turned.geometry, body.geometry, atol=1e-9)
    np.testing.assert_allclose(turned.inertia_vector, body.inertia_vector, atol=1e-9)
    np.testing.assert_allclose(turned.marker_position, body.marker_position, atol=1e-9)


@pytest.mark.parametrize("name", SETS)
def test_the_body_of_a_mirrored_person_is_mirrored(name):
    static, flip, other = (
        wearing(SETS[name]),
        np.array([1, -1, 1]),
        {"right": "left", "left": "right"},
    )
    limbs = {other[side]: widths for side, widths in measured().items()}
    body, image = built(static), built(mirrored(static), limbs=limbs)
    for s, offset in body.offsets.items():
        side, _, part = s.partition("_")
        opposite = f"{other[side]}_{part}" if side in other else s
        np.testing.assert_allclose(image.offsets[opposite], offset * flip, atol=1e-9, err_msg=s)
    assert sorted(n.code for n in image.notes) == sorted(n.code for n in body.notes)


# -- parts that no marker shows -------------------------------------------------------------------


def test_a_set_of_pelvis_and_legs_locks_all_above_and_says_how_much_of_the_body_that_is():
    """Mid and upper trunk, head and arms are 49.1 % of a man by de Leva's table."""
    body = built(wearing(PIG_LOWER))
    above = COORDINATES[6 : COORDINATES.index("RHipFlexion")]
    assert set(body.locked) == {*above, "RToeFlexion", "LToeFlexion"}
    (note,) = (note for note in body.notes if note.code == "mass_not_shown")
    assert note.level == "warning"
    assert note.values["share"] == pytest.approx(0.4911, abs=1e-4)
    legs = {f"{side}_{part}" for side in SIDES for part in (*LEGS, "toes")}
    assert set(note.values["segments"]) == set(SEGMENTS) - {"pelvis", *legs}


def test_what_no_marker_shows_stands_upright_and_symmetric_on_a_tilted_pelvis():
    static = wearing(PIG_LOWER)
    body = built(static)
    q = solve_ik(body, static).q[:1]
    rotation, origin = (x[0] for x in segment_frames(body, q))
    pelvis = rotation[MOVING.index("pelvis")]
    assert np.degrees(np.arccos(pelvis[2, 2])) > 3, "the person's pelvis is tilted"
    at = {s: origin[MOVING.index(s)] for s in MOVING}

    def center(s):
        return at[s] + rotation[MOVING.index(s)] @ body.segments[s].center

    hips = at["pelvis"]
    for s in ("thorax", "head"):
        np.testing.assert_allclose((center(s) - hips)[:2], 0, atol=1e-9)
    for side in SIDES:
        arm = center(f"{side}_hand") - center(f"{side}_upper_arm")
        np.testing.assert_allclose(unit(arm), [0, 0, -1], atol=1e-9)
    left, right = (center(f"{side}_forearm") - hips for side in ("left", "right"))
    assert left[2] == pytest.approx(right[2])
    assert np.linalg.norm((left + right)[:2]) < 1e-9


def test_a_head_band_shows_the_head_whose_top_is_above_the_band():
    """The top follows the band, and the centre, 50.02 % of the way down, by 49.98 % of that."""
    band = {label: 1000 * points()[label] for label in ("LFHD", "RFHD", "LBHD", "RBHD")}
    others = {label: 1000 * points()[p] for label, p in PIG.items() if label not in band}
    ahead = {label: np.add(point, (40, 0, 0)) for label, point in band.items()}
    body, leaning = (built(standing(others | each)) for each in (band, ahead))
    assert not {"HeadFlexion", "HeadRightBend", "HeadLeftTwist"} & set(body.locked)
    shift = leaning.segments["head"].center - body.segments["head"].center
    assert np.linalg.norm(shift) == pytest.approx((1 - 0.5002) * 0.040, rel=1e-6)


# -- tables that do not fit -----------------------------------------------------------------------


def test_measures_of_one_side_change_that_side_alone():
    static = wearing(PIG)
    wide = measured() | {"left": LimbMeasures(knee_width_m=0.14, ankle_width_m=0.09)}
    body, other = built(static), built(static, limbs=wide)
    beside = other.marker_position[other.markers.index("LKNE")] - other.offsets["left_shank"]
    assert np.linalg.norm(beside) == pytest.approx(0.07 + 0.009)
    for s in ("right_shank", "right_foot"):
        np.testing.assert_allclose(other.offsets[s], body.offsets[s], atol=1e-12)


OPENCAP_LABORATORY = {
    label.replace("_lelbow", "_elbow_lat")
    .replace("_melbow", "_elbow_med")
    .replace("_lwrist", "_wrist_radius")
    .replace("_mwrist", "_wrist_ulna")
    .removesuffix("_study"): point
    for label, point in SETS["opencap"].items()
}
ADDBIOMECHANICS = {"S2": "SACR", "R.Clavicle": "JN", "L.Clavicle": "XIPH"} | {
    f"{side}.{label}": side + point
    for side in "LR"
    for label, point in (
        {"ASIS": "ASIS", "PSIS": "PSIS", "TH1": "LTHI", "TH2": "THAP", "TH3": "THAD"}
        | {"Knee": "LEK", "SH1": "LSHA", "SH2": "TIAP", "SH3": "TIAD", "Ankle": "LM"}
        | {"Heel": "HEE", "MT5": "MT5", "Toe": "TOE", "Shoulder": "SHO", "Biceps": "DELT"}
        | {"Elbow": "LEE", "Forearm": "FRM", "Wrist": "LW"}
    ).items()
}
METATARSALS = {n: p for n, p in SETS["rajagopal"].items() if n[1:] not in ("TOE", "MT5")} | {
    f"{s}{mark}": f"{s}{mark}" for s in "LR" for mark in ("MT1", "MT2")
}
CONDYLES = {
    {"KNE": f"{n[0]}LFC", "KNE_2": f"{n[0]}MFC"}.get(n[1:], n): point
    for n, point in SETS["helen_hayes"].items()
}
CUT_LABELS = {name[:4]: name for name in SETS["hbm2"]}


@pytest.mark.parametrize(
    ("labels", "base", "hidden"),
    [
        (OPENCAP_LABORATORY, "opencap", 0.08),
        (ADDBIOMECHANICS, "rajagopal", 0.10),
        (METATARSALS, "rajagopal", 0.10),
        (CONDYLES, "helen_hayes", 0.17),
        (CUT_LABELS, "hbm2", 0.07),
    ],
    ids=["opencap_laboratory", "addbiomechanics", "metatarsals", "condyles", "four_letters"],
)
def test_labels_that_mix_sets_or_are_cut_short_show_what_they_mark(labels, base, hidden):
    static = wearing(labels)
    body = built(static)
    assert body.marker_set.name.split("+")[0] == base
    assert solve_ik(body, static).marker_error.max() < 2e-3
    shares = [note.values["share"] for note in body.notes if note.code == "mass_not_shown"]
    assert sum(shares) < hidden + 0.005
