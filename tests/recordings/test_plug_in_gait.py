"""A person with Plug-in-Gait's markers has the segments that Plug-in-Gait wrote into the file.

Plug-in-Gait wrote the frames of its segments into the static recording: origin (O, the distal
joint), and points ahead (A), to the left (L) and at the proximal end (P).
"""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.calibration_pose.anatomy import Measures
from hbm.calibration_pose.landmarks import locate_anatomy
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers, recognise_marker_set
from hbm.spatial import unit
from pipeline.io.c3d.read import read_c3d
from tests.recordings.recorded import recorded, steps, two_plates

MASS_KG, STATURE_M = 85.0, 1.679
ROD_M = 0.1


@pytest.fixture(scope="module")
def static(shared_data):
    return recorded(steps, shared_data)[1]["static"]


@pytest.fixture(scope="module")
def descent(shared_data):
    return recorded(steps, shared_data)[0]


@pytest.fixture(scope="module")
def anatomy(static):
    present = recognise_marker_set(static.markers.names).present(static.markers.names)
    mean = dict(zip(static.markers.names, static.markers.position.mean(axis=0), strict=True))
    at = {mark: mean[name] for mark, name in present.landmark.items()}
    return locate_anatomy(at, Measures("male", limbs=static.metadata.limbs))


@pytest.fixture(scope="module")
def theirs(static):
    """Point -> its mean position in the lab [m]; the file's axes are the lab's."""
    return {name: points.mean(axis=0) / 1000 for name, points in static.model_outputs.items()}


def built(static, markers=None):
    return build_body(
        markers or static.markers,
        mass=MASS_KG,
        sex="male",
        height_m=STATURE_M,
        limbs=static.metadata.limbs,
    )


def rms_mm(motion):
    return 1000 * np.sqrt(np.mean(motion.marker_error**2))


def angle_deg(a, b):
    return np.degrees(np.arccos(np.clip(abs(unit(a) @ unit(b)), -1, 1)))


def distance_mm(a, b):
    return 1000 * np.linalg.norm(a - b)


def test_the_measures_of_the_file_are_those_of_each_side(static):
    left, right = (static.metadata.limbs[side] for side in ("left", "right"))
    assert (left.knee_width_m, right.knee_width_m) == pytest.approx((0.144, 0.139))
    assert (left.elbow_width_m, right.elbow_width_m) == pytest.approx((0.096, 0.092))
    assert (left.wrist_width_m, right.wrist_width_m) == pytest.approx((0.061, 0.065))
    assert left.hand_thickness_m == right.hand_thickness_m == pytest.approx(0.03)
    assert left.shoulder_offset_m == right.shoulder_offset_m == pytest.approx(0.05)


def test_the_frames_of_pelvis_and_trunk_are_plug_in_gait_s(anatomy, theirs):
    for segment, bone in (("pelvis", "PEL"), ("thorax", "TRX")):
        frame = anatomy.frames[segment]
        for axis, end in enumerate("ALP"):
            assert angle_deg(frame[:, axis], theirs[f"{bone}{end}"] - theirs[f"{bone}O"]) < 0.6


@pytest.mark.parametrize("side", ["left", "right"])
def test_shoulders_elbows_and_wrists_are_plug_in_gait_s(anatomy, theirs, side):
    """Markers are 7 mm from the skin there and 9 mm here; the elbow also follows the true plane."""
    s = side[0].upper()
    for joint, bone, limit_mm in (
        ("shoulder", "CLO", 2.5),
        ("elbow", "HUO", 7),
        ("wrist", "RAO", 2.5),
    ):
        assert distance_mm(anatomy.points[f"{side}_{joint}"], theirs[s + bone]) < limit_mm, joint


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_elbow_s_axis_is_plug_in_gait_s(anatomy, theirs, side):
    """The elbows are bent by 87 and 94°."""
    s = side[0].upper()
    assert angle_deg(anatomy.axes[f"{side}_elbow"], theirs[s + "HUL"] - theirs[s + "HUO"]) < 0.5
    along = anatomy.points[f"{side}_elbow"] - anatomy.points[f"{side}_wrist"]
    assert angle_deg(along, theirs[s + "RAP"] - theirs[s + "RAO"]) < 0.6


@pytest.mark.parametrize("side", ["left", "right"])
def test_hips_are_harrington_s_and_knees_lie_along_the_pelvis(anatomy, theirs, side):
    """Plug-in-Gait: hips by Davis, knee axes by thigh markers, 38 and 40° off the pelvis' own."""
    s = side[0].upper()
    hip, knee = anatomy.points[f"{side}_hip"], anatomy.points[f"{side}_knee"]
    assert 25 < distance_mm(hip, theirs[s + "FEP"]) < 35
    angle = angle_deg(anatomy.axes[f"{side}_knee"], theirs[s + "FEL"] - theirs[s + "FEO"])
    assert 35 < angle < 43
    half_width = distance_mm(knee, theirs[s + "FEO"]) / 2 / np.sin(np.radians(angle / 2))
    assert half_width == pytest.approx(79, abs=5), "the distance that this angle explains"


def test_the_knee_axes_of_the_thigh_markers_fit_the_steps_worse(static, descent):
    """Plug-in-Gait's own, shown by an alignment device, make the errors 1.45 times as large."""
    ours = rms_mm(solve_ik(built(static), descent.markers))
    names, position = list(static.markers.names), [static.markers.position]
    for s in "LR":
        origin = static.model_outputs[f"{s}FEO"] / 1000
        knee = static.markers.position[:, names.index(f"{s}KNE")]
        left, ahead, up = (static.model_outputs[f"{s}FE{end}"] / 1000 - origin for end in "LAP")
        for name, way in (("KAX", left if s == "L" else -left), ("KD1", ahead), ("KD2", up)):
            rod = ROD_M * way / np.linalg.norm(way, axis=1, keepdims=True)
            names.append(s + name)
            position.append((knee + rod)[:, None])
    pose = Markers(static.markers.time, tuple(names), np.concatenate(position, axis=1))
    theirs = rms_mm(solve_ik(built(static, pose), descent.markers))
    assert theirs > 1.4 * ours


def test_every_frame_of_the_steps_is_solved_with_all_39_markers(static, descent):
    body = built(static)
    motion = solve_ik(body, descent.markers)
    assert body.marker_set.name == "pig"
    assert len(body.markers) == 39
    assert motion.converged.all()
    segment = dict(zip(body.markers, body.marker_segment, strict=True))
    for part in ("upper_arm", "forearm", "hand"):
        own = [part in segment[name] for name in motion.markers]
        assert np.sqrt(np.mean(motion.marker_error[:, own] ** 2)) < 0.015, part


def test_a_mixture_of_two_sets_is_recognised_and_fits(shared_data):
    """Human Body Model 2 on trunk and legs, CGM2.5 on head and arms; labels swapped on a foot."""
    markers = read_c3d(shared_data / "full_body_standing" / "1min_CGM_HBM_static.c3d").markers
    body = build_body(markers, mass=83.8)
    assert body.marker_set.name == "hbm2+cgm2"
    assert "metatarsals_swapped" in [note.code for note in body.notes]
    assert solve_ik(body, markers).marker_error.max() < 0.003


def test_frames_without_markers_around_a_walk_change_no_pose_in_it(shared_data):
    walk = recorded(two_plates, shared_data)[0].markers
    body = build_body(walk, mass=MASS_KG)
    seen = np.flatnonzero(np.isfinite(walk.position).any(axis=(1, 2)))
    rows = slice(seen[0], seen[-1] + 1)
    assert 2 * len(seen) < len(walk.time), "few frames are without markers: no test"
    alone = solve_ik(body, Markers(walk.time[rows], walk.names, walk.position[rows]))
    np.testing.assert_allclose(solve_ik(body, walk).q[rows], alone.q, atol=1e-9)
