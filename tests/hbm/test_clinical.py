"""Clinical angles are those of the same pose in the original's order, sequences and signs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.coordinates import COORDINATES, HBM_ORDER, INDEX, MOVING, N_Q, TREE
from hbm.kernels.native import kernels
from hbm.motion import clinical_angles
from hbm.spatial import rotation_about
from tests.synthetic import synthetic_body

SIGN_CHANGES_IN_MIRROR = (
    *("PelvisY", "PelvisYaw", "PelvisRightRoll", "TrunkRightBend", "TrunkLeftTwist"),
    *("HeadRightBend", "HeadLeftTwist"),
)
angles = st.floats(-np.pi, np.pi)


def pose(**values):
    q = np.zeros(N_Q)
    for name, value in values.items():
        q[INDEX[name]] = value
    return q


def clinical(name, q, **options):
    return clinical_angles(q, **options)[..., HBM_ORDER.index(name)]


def mirrored(values, names):
    out = np.empty_like(values)
    for k, name in enumerate(names):
        other = {"R": "L", "L": "R"}.get(name[0], name[0]) + name[1:]
        sign = -1 if name in SIGN_CHANGES_IN_MIRROR else 1
        out[..., k] = sign * values[..., names.index(other)]
    return out


def orientation(values, names, sequence, side):
    R = np.eye(3)
    for rotation in sequence:
        name = f"{side}Shoulder{rotation}"
        R = R @ rotation_about(TREE[INDEX[name]].axis, values[names.index(name)])
    return R


@pytest.mark.parametrize("side", ["R", "L"])
@settings(max_examples=50)
@given(a=angles, f=angles, i=angles)
def test_the_arm_has_the_same_orientation_in_both_sequences(side, a, f, i):
    names = [f"{side}Shoulder{t}" for t in ("Abduction", "Flexion", "InternalRotation")]
    q = pose(**dict(zip(names, (a, f, i), strict=True)))
    ours = orientation(q, COORDINATES, ("Abduction", "Flexion", "InternalRotation"), side)
    theirs = orientation(
        clinical_angles(q), HBM_ORDER, ("Flexion", "Abduction", "InternalRotation"), side
    )
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-7)


@pytest.mark.parametrize("side", ["R", "L"])
@pytest.mark.parametrize("rotation", ["Flexion", "Abduction", "InternalRotation"])
@pytest.mark.parametrize("degrees", [-100, 45, 200])
def test_a_rotation_about_a_single_axis_keeps_its_value(side, rotation, degrees):
    q = pose(**{f"{side}Shoulder{rotation}": np.radians(degrees)})
    expected = q[[INDEX[name] for name in HBM_ORDER]]
    np.testing.assert_allclose(clinical_angles(q), expected, rtol=0, atol=1e-7)


def test_known_angles_of_an_arm_raised_forward_and_outward():
    """45° abduction then 45° flexion: sin A = 1/2, tan F = √2, I = atan2(1/2, 1/√2)."""
    q = pose(RShoulderAbduction=np.pi / 4, RShoulderFlexion=np.pi / 4)
    np.testing.assert_allclose(clinical("RShoulderAbduction", q), np.pi / 6)
    np.testing.assert_allclose(clinical("RShoulderFlexion", q), np.arctan(np.sqrt(2)))
    np.testing.assert_allclose(clinical("RShoulderInternalRotation", q), np.arctan(np.sqrt(0.5)))


def test_a_mirrored_pose_has_mirrored_angles():
    q = np.random.default_rng(2).uniform(-1.2, 1.2, (50, N_Q))
    theirs = clinical_angles(mirrored(q, COORDINATES))
    np.testing.assert_allclose(theirs, mirrored(clinical_angles(q), HBM_ORDER), atol=1e-14)


def test_other_coordinates_are_only_put_in_the_originals_order():
    q = np.random.default_rng(4).normal(size=(7, N_Q))
    out = clinical_angles(q)
    for k, name in enumerate(HBM_ORDER):
        shoulder = ("ShoulderAbduction", "ShoulderFlexion", "ShoulderInternalRotation")
        if not name.endswith(shoulder):
            np.testing.assert_array_equal(out[:, k], q[:, INDEX[name]])


def test_the_originals_ankle_is_minus_78_degrees_in_neutral():
    q = pose(LAnklePlantarFlexion=np.radians(20))
    assert clinical("RAnklePlantarFlexion", q) == 0
    in_line = {
        side: np.degrees(clinical(f"{side}AnklePlantarFlexion", q, ankle_zero="in_line"))
        for side in "RL"
    }
    assert in_line == pytest.approx({"R": -78, "L": -58})


def test_swinging_arms_give_continuous_angles():
    phase = np.linspace(0, 4 * np.pi, 400)
    q = np.zeros((400, N_Q))
    for side, sign in (("R", 1), ("L", -1)):
        q[:, INDEX[f"{side}ShoulderFlexion"]] = sign * 0.6 * np.sin(phase)
        q[:, INDEX[f"{side}ShoulderAbduction"]] = 0.3 + 0.1 * np.cos(phase)
    assert np.abs(np.diff(clinical_angles(q), axis=0)).max() < 0.03


OUTWARD, INWARD = "outward", "inward"
SIGNS = {
    "PelvisYaw": ("RASIS", "y"),
    "PelvisForwardPitch": ("THEAD", "x"),
    "PelvisRightRoll": ("THEAD", "-y"),
    "TrunkFlexion": ("THEAD", "x"),
    "TrunkRightBend": ("THEAD", "-y"),
    "TrunkLeftTwist": ("JN", "y"),
    "HeadFlexion": ("THEAD", "x"),
    "HeadRightBend": ("THEAD", "-y"),
    "HeadLeftTwist": ("FHEAD", "y"),
    "ShoulderUp": ("SHO", "z"),
    "ShoulderForward": ("SHO", "x"),
    "ShoulderInward": ("SHO", INWARD),
    "ShoulderFlexion": ("FIN", "x"),
    "ShoulderAbduction": ("FIN", OUTWARD),
    "ElbowFlexion": ("FIN", "x"),
    "ForeArmPronation": ("MW", "x"),
    "WristFlexion": ("FIN", "x"),
    "HandAbduction": ("FIN", OUTWARD),
    "HipFlexion": ("LM", "x"),
    "HipAbduction": ("LM", OUTWARD),
    "HipInternalRotation": ("MT2", INWARD),
    "KneeFlexion": ("LM", "-x"),
    "AnklePlantarFlexion": ("MT2", "-z"),
    "FootPronation": ("MT5", OUTWARD),
}


@pytest.mark.parametrize("name", [n for n in COORDINATES if n.lstrip("RL") in SIGNS])
def test_positive_angles_move_the_body_as_documented(name):
    body = synthetic_body()
    paired = name not in SIGNS
    marker, direction = SIGNS[name[1:] if paired else name]
    moved = displacement(body, name, f"{name[0]}{marker}" if paired else marker)
    outward = -1 if name[0] == "R" else 1
    component = {"x": 0, "y": 1, "z": 2, OUTWARD: 1, INWARD: 1}[direction.lstrip("-")]
    sign = {OUTWARD: outward, INWARD: -outward}.get(direction, -1 if direction[0] == "-" else 1)
    assert sign * moved[component] > 0.5 * np.abs(moved).max()


@pytest.mark.parametrize("side", ["R", "L"])
def test_internal_rotation_brings_the_hand_of_a_bent_arm_inward(side):
    bent = {f"{side}ElbowFlexion": np.pi / 2}
    name = f"{side}ShoulderInternalRotation"
    moved = displacement(synthetic_body(), name, f"{side}FIN", **bent)
    assert moved[1] * (1 if side == "R" else -1) > 0.9 * np.linalg.norm(moved)


@pytest.mark.parametrize("side", ["R", "L"])
def test_toe_flexion_points_the_toes_down(side):
    q = pose(**{f"{side}ToeFlexion": 0.1})
    toes = "right_toes" if side == "R" else "left_toes"
    forward = segment_poses(synthetic_body(), q)[MOVING.index(toes), 0]
    assert forward[2] < -0.05


def segment_poses(body, q):
    return kernels().segment_poses(q[None], body.geometry)[0].reshape(len(MOVING), 4, 3)


def displacement(body, name, marker, **start):
    """Displacement of a marker when one coordinate increases a little from neutral."""
    k = body.markers.index(marker)
    segment, local = MOVING.index(body.marker_segment[k]), body.marker_position[k]

    def position(**values):
        frame = segment_poses(body, pose(**values))[segment]
        return local @ frame[:3] + frame[3]

    return position(**start, **{name: 0.01}) - position(**start)
