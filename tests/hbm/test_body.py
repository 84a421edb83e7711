"""A body has the parts of its calibration pose, and nothing else changes it."""

import numpy as np
import pytest

from hbm.body import ImplausibleLegs, build_body
from hbm.coordinates import COORDINATES, INDEX, MOVING, N_Q, SEGMENTS
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers, marker_sets
from hbm.poses import segment_frames
from hbm.segments import proportions
from tests.hbm.motions import markers_of, motion_of, swinging, with_noise, without
from tests.hbm.people import mirrored, person, standing
from tests.synthetic import MASS_KG, RATE_HZ, STATURE_M, T_POSE_MM, synthetic_t_pose

ARM = ("LLEE", "LMEE", "LDELT", "LFRM", "LLW", "LMW", "LFIN")
HIPS = {"right": np.array([-0.05, -0.085, -0.08]), "left": np.array([-0.05, 0.085, -0.08])}


def built(markers, **options):
    return build_body(markers, **{"mass": MASS_KG, "sex": "male", "height_m": STATURE_M} | options)


@pytest.fixture(scope="module")
def t_pose(body):
    """The coordinates of the calibration pose."""
    return solve_ik(body, synthetic_t_pose()).q[0]


def same(one, other, atol=1e-9):
    np.testing.assert_allclose(one.geometry, other.geometry, atol=atol)
    np.testing.assert_allclose(one.inertia_vector, other.inertia_vector, atol=atol)
    ours, theirs = (dict(zip(b.markers, b.marker_position, strict=True)) for b in (one, other))
    assert ours.keys() == theirs.keys()
    for name, position in ours.items():
        np.testing.assert_allclose(position, theirs[name], atol=atol, err_msg=name)


# -- structure ------------------------------------------------------------------------------------


def test_the_mid_trunk_has_de_leva_s_inertia_and_moves_with_the_thorax(body):
    part, mid, whole = (
        proportions("male")["mid_trunk"],
        body.segments["mid_trunk"],
        body.rigid_bodies,
    )
    assert mid.mass == pytest.approx(part.mass * MASS_KG)
    moments = mid.mass * (part.gyration * body.lengths["mid_trunk"]) ** 2
    np.testing.assert_allclose(np.linalg.eigvalsh(mid.tensor), np.sort(moments), rtol=1e-12)
    together = body.segments["thorax"] + mid
    assert whole["thorax"].mass == together.mass
    np.testing.assert_array_equal(whole["thorax"].tensor, together.tensor)
    assert sum(part.mass for part in whole.values()) == pytest.approx(MASS_KG, rel=1e-14)


def test_the_body_fits_its_calibration_pose_exactly(body):
    assert solve_ik(body, synthetic_t_pose()).marker_error.max() < 1e-9


def test_neutral_is_upright_with_hanging_arms_and_frames_parallel_to_the_lab(body):
    rotation, origin = segment_frames(body, np.zeros((1, N_Q)))
    np.testing.assert_allclose(rotation[0], np.tile(np.eye(3), (len(MOVING), 1, 1)), atol=1e-12)
    height = dict(zip(MOVING, origin[0, :, 2], strict=True))
    assert height["right_hand"] < height["right_forearm"] < height["right_upper_arm"]
    assert height["right_foot"] < height["right_shank"] < height["pelvis"] < height["head"]


def test_the_thigh_has_de_leva_s_inertia(body):
    length = np.linalg.norm(body.offsets["right_shank"])
    thigh, part = body.segments["right_thigh"], proportions("male")["thigh"]
    assert body.lengths["right_thigh"] == pytest.approx(length)
    assert thigh.mass == pytest.approx(0.1416 * MASS_KG)
    np.testing.assert_allclose(thigh.center, 0.4095 * body.offsets["right_shank"], atol=1e-12)
    moments = thigh.mass * (part.gyration * length) ** 2
    np.testing.assert_allclose(np.linalg.eigvalsh(thigh.tensor), np.sort(moments), rtol=1e-12)


# -- what must not matter -------------------------------------------------------------------------


def test_the_order_of_the_markers_does_not_matter(body):
    static = synthetic_t_pose()
    order = np.random.default_rng(20).permutation(len(static.names))
    names = tuple(static.names[k] for k in order)
    shuffled = built(Markers(static.time, names, static.position[:, order]))
    assert shuffled.markers == body.markers
    same(shuffled, body, atol=1e-15)


@pytest.mark.parametrize("degrees", [17.0])
def test_an_a_pose_gives_the_same_body_as_a_t_pose(body, t_pose, degrees):
    """Arms as far from the trunk as in other protocols; the shoulders do not rise."""
    q = t_pose.copy()
    for s in "RL":
        q[INDEX[f"{s}ShoulderAbduction"]] = np.radians(degrees)
    a_pose = markers_of(body, motion_of(np.arange(50) / RATE_HZ, *[np.tile(q, (50, 1))] * 3))
    low = q[INDEX["LShoulderAbduction"]] < t_pose[INDEX["LShoulderAbduction"]] - 0.5
    assert low
    same(built(a_pose), body)


def test_a_walk_without_a_static_trial_gives_nearly_the_same_body(body):
    """Leg length changes with knee flexion, and Harrington's hip with it a little."""
    walk = markers_of(body, swinging(np.random.default_rng(21), frames=300, degrees=25))
    found = built(walk)
    assert found.notes[0].values["posture"].startswith("moving at")
    for segment, offset in body.offsets.items():
        assert np.linalg.norm(found.offsets[segment] - offset) < 0.005, segment
    for segment, part in body.segments.items():
        assert found.segments[segment].mass == pytest.approx(part.mass, rel=1e-9)
        np.testing.assert_allclose(found.segments[segment].center, part.center, atol=0.005)


@pytest.mark.parametrize("far_m", [0.5, 3.0, 15.0])
def test_single_positions_far_from_where_a_marker_is_do_not_change_the_body(body, far_m):
    walk = markers_of(body, swinging(np.random.default_rng(21), frames=400, degrees=25))
    random = np.random.default_rng(25)
    frames, columns = random.integers(400, size=30), random.integers(len(walk.names), size=30)
    frames[:2] = 0, 399
    position = walk.position.copy()
    position[frames, columns] += far_m * random.normal(size=(30, 3))
    found, sound = built(Markers(walk.time, walk.names, position)), built(walk)
    same(found, sound, atol=0.002)
    (note,) = (note for note in found.notes if note.code == "jumps_left_out")
    assert note.values["positions"] >= 25
    assert "jumps_left_out" not in [note.code for note in sound.notes]


def test_tracking_markers_of_a_walk_are_at_their_mean_position_on_the_fitted_skeleton(body):
    """A landmark stays where it defines the joint; a tracking marker varies about its mean."""
    walk = markers_of(body, swinging(np.random.default_rng(22), frames=400, degrees=25))
    noisy = with_noise(walk, np.random.default_rng(23), 0.004)
    found = built(noisy)
    motion = solve_ik(found, noisy)
    own = [found.markers.index(n) for n in ("LLTHI", "RLTHI", "LLSHA", "RLSHA", "LFRM", "RFRM")]
    rotation, origin = segment_frames(found, motion.q)
    for k in own:
        s = MOVING.index(found.marker_segment[k])
        measured = noisy.position[:, noisy.names.index(found.markers[k])] - origin[:, s]
        seen = np.einsum("tji,tj->ti", rotation[:, s], measured).mean(axis=0)
        np.testing.assert_allclose(seen, found.marker_position[k], atol=0.002)


def test_scaled_by_s_a_person_s_inertias_scale_by_s_squared():
    """With given hips, for the regressions of hips have constant terms."""
    s = 1.17
    small = built(synthetic_t_pose(), hip=HIPS)
    t = synthetic_t_pose()
    large = built(
        Markers(t.time, t.names, s * t.position),
        hip={side: s * at for side, at in HIPS.items()},
        height_m=s * STATURE_M,
    )
    for segment in set(SEGMENTS) - {"left_toes", "right_toes"}:
        one, other = small.segments[segment], large.segments[segment]
        assert other.mass == pytest.approx(one.mass, rel=1e-12)
        np.testing.assert_allclose(other.center, s * one.center, atol=1e-12)
        np.testing.assert_allclose(other.tensor, s**2 * one.tensor, rtol=1e-9, atol=1e-12)


def test_the_mirrored_subject_has_the_mirrored_residual(body):
    """Markers and forces mirrored: forward and up stay, left becomes right."""
    frames = swinging(np.random.default_rng(24), frames=120, degrees=25)
    markers = with_noise(markers_of(body, frames), np.random.default_rng(25), 0.003)
    image = built(mirrored(synthetic_t_pose()))
    wrench = np.random.default_rng(26).normal([0, 0, 700, 0, 0, 0], 50, (120, 6))
    flip = np.array([1, -1, 1, -1, 1, -1])
    residuals = []
    for who, seen, foot, force in (
        (body, markers, "left_foot", wrench),
        (image, mirrored(markers), "right_foot", wrench * flip),
    ):
        motion = filter_motion(solve_ik(who, seen), cutoff=6.0)
        residuals.append(inverse_dynamics(who, motion, {foot: force}).residual)
    np.testing.assert_allclose(residuals[1], residuals[0] * flip, atol=1e-6)


# -- what is missing ------------------------------------------------------------------------------


def test_an_arm_without_markers_is_locked_in_neutral(body):
    found = built(person(*ARM, "LSHO"))
    arm = {n for n in COORDINATES if n[0] == "L" and INDEX[n] < INDEX["RHipFlexion"]}
    assert set(found.locked) == arm | {
        "RToeFlexion",
        "LToeFlexion",
    }
    hand = found.segments["left_hand"]
    assert hand.mass == pytest.approx(body.segments["left_hand"].mass)
    origin = segment_frames(found, np.zeros((1, N_Q)))[1][0]
    assert origin[MOVING.index("left_hand"), 2] < origin[MOVING.index("left_upper_arm"), 2] - 0.4


def test_a_lower_body_set_estimates_stature_and_sizes_the_rest_by_it(body):
    names = marker_sets()["hbm2_lower"].segment
    found = build_body(standing({n: T_POSE_MM[n] for n in names}), mass=MASS_KG, sex="male")
    assert found.marker_set.name == "hbm2_lower"
    assert found.height_m == pytest.approx(STATURE_M, abs=0.1)
    assert "legs" in found.notes[0].values["source"]
    for part in ("left_upper_arm", "right_forearm", "head"):
        share = proportions("male")[part.split("_", 1)[-1] if "_" in part else part].length
        if part != "head":
            assert found.lengths[part] == pytest.approx(share * found.height_m)
    centers = {s: found.segments[s].center for s in ("left_upper_arm", "right_upper_arm")}
    np.testing.assert_allclose(*(c * [1, 0, 1] for c in centers.values()), atol=1e-9)


# -- calibration pose -----------------------------------------------------------------------------


def moving_and_standing(body, t_pose, *, still=slice(200, 350)):
    """Five seconds of motion during which the subject stands still for a while."""
    frames = swinging(np.random.default_rng(27), frames=500, degrees=20)
    q = frames.q.copy()
    q[still] = t_pose
    return markers_of(body, motion_of(frames.time, q, q, q))


def test_the_second_of_standing_still_is_found(body, t_pose):
    markers = with_noise(moving_and_standing(body, t_pose), np.random.default_rng(28), 0.0003)
    found = built(markers)
    note = found.notes[0]
    assert note.values["posture"] == "standing still"
    assert 2.0 <= note.values["start_s"] < note.values["stop_s"] <= 3.5
    same(found, body, atol=0.002)


def test_a_given_window_is_used(body, t_pose):
    found = built(moving_and_standing(body, t_pose), window_s=(2.5, 3.2))
    values = found.notes[0].values
    assert (values["start_s"], values["stop_s"]) == pytest.approx((2.5, 3.19))
    assert values["posture"] == "standing still"
    same(found, body)


def test_a_pose_of_one_frame_is_said_to_be_one():
    pose = synthetic_t_pose()
    note = built(Markers(pose.time[:1], pose.names, pose.position[:1])).notes[0]
    assert (note.code, note.values["instants"]) == ("calibration_pose", 1)


def test_a_recording_that_never_shows_all_markers_at_once_is_refused():
    t = synthetic_t_pose()
    gaps = without(without(t, ["C7"], slice(0, 60)), ["T10"], slice(40, 100))
    with pytest.raises(ValueError, match=r"at once; (C7|T10)"):
        built(gaps)


# -- impossible input -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mass": 74600}, "10 and 400 kg, got 74600; .*grams"),
        ({"height_m": 178}, "stature .*0.5 and 2.6 m, got 178"),
        ({"marker_set": "hbm3"}, "'hbm3'; .*hbm2_lower, hbm2, hbm1_lower, hbm1"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        built(synthetic_t_pose(), **options)


@pytest.mark.parametrize("factor", [1 / 25.4, 10.0])
@pytest.mark.parametrize("height_m", [None, 1.78])
def test_legs_that_nobody_has_show_another_unit_than_metres(factor, height_m):
    t_pose = synthetic_t_pose()
    wrong = Markers(t_pose.time, t_pose.names, factor * t_pose.position)
    with pytest.raises(ImplausibleLegs, match=r"0\.5 to 2\.6 m: .*unit"):
        build_body(wrong, mass=MASS_KG, height_m=height_m)
