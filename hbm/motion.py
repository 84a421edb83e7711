"""Motion: the coordinates of a trial over time, and the clinical angles that they are.

All coordinates but the shoulders' three rotations are clinical angles already. Zero is the
anatomical position: upright, arms hanging, palms forward, feet at right angles to the shanks (foot
pronation and toes as in the calibration pose). A positive value means, on both sides of the body:

=========================  =====================================================================
PelvisX, Y, Z              forward, left, up
PelvisYaw                  rotated to the left
PelvisForwardPitch         top tilted forward
PelvisRightRoll            right side down
Trunk-, HeadFlexion        bent forward
Trunk-, HeadRightBend      bent to the right
Trunk-, HeadLeftTwist      rotated to the left
ShoulderUp, -Forward       shoulder point up, forward
ShoulderInward             shoulder point towards the middle of the body
ShoulderFlexion            arm forward
ShoulderAbduction          arm away from the body
ShoulderInternalRotation   front of the arm towards the middle of the body
ElbowFlexion               forearm forward and up
ForeArmPronation           thumb forward and inward (palm from forward to backward)
WristFlexion               hand towards the palm
HandAbduction              hand towards the thumb
HipFlexion                 thigh forward
HipAbduction               thigh away from the body
HipInternalRotation        front of the thigh towards the middle of the body
KneeFlexion                shank backward
AnklePlantarFlexion        toes down
FootPronation              lateral edge of the foot up
ToeFlexion                 toes down
=========================  =====================================================================

About the lab's axes, left and right are therefore opposite where the motion is away from or towards
the middle of the body: abduction is about -x on the right and +x on the left, internal rotation
about +z on the right and -z on the left.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from hbm.coordinates import COORDINATES, HBM_ORDER, INDEX, N_Q
from hbm.spatial import Array, Mask, freeze_arrays


@dataclass(frozen=True, slots=True)
class Motion:
    """Coordinates over time.

    Attributes
    ----------
    time
        (T,) [s].
    q, v, a
        Coordinates and their derivatives in the order of `hbm.coordinates.COORDINATES`, (T, 46)
        [m and rad, per s, per s²]. ``v`` and ``a`` are NaN until the motion has been filtered. A
        frame that could not be solved is NaN.
    markers
        Names of the markers that it was solved from, (K,).
    marker_error
        Distance of each marker from the model, (T, K) [m]; NaN where the marker was missing.
    converged
        Whether the inverse kinematics converged, (T,).
    observed
        Whether the visible markers determined each coordinate, (T, 46); the others were held at
        zero or interpolated in time.

    Examples
    --------
    With ``static``, the markers of a calibration pose, and ``body``, built from them:

    >>> import hbm
    >>> motion = hbm.solve_ik(body, static)
    >>> motion.q.shape, motion.names[:3], bool(motion.converged.all())
    ((100, 46), ('PelvisX', 'PelvisY', 'PelvisZ'), True)
    >>> f"{motion.coordinate('PelvisZ')[0]:.3f} m"
    '0.926 m'
    """

    time: Array
    q: Array
    v: Array
    a: Array
    markers: tuple[str, ...]
    marker_error: Array
    converged: Mask
    observed: Mask

    def __post_init__(self) -> None:
        frames = len(self.time)
        freeze_arrays(self, "motion", time=(frames,), converged=(frames,))
        freeze_arrays(self, "motion", **dict.fromkeys(("q", "v", "a", "observed"), (frames, N_Q)))
        freeze_arrays(self, "motion", marker_error=(frames, len(self.markers)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of ``q``, ``v`` and ``a``."""
        return COORDINATES

    def coordinate(self, name: str) -> Array:
        """Give one coordinate over time by its name, (T,) [m or rad]."""
        if name not in INDEX:
            raise KeyError(f"no coordinate {name!r}; there are: {', '.join(COORDINATES)}")
        return np.asarray(self.q[:, INDEX[name]])


AnkleZero = Literal["right_angle", "in_line"]
ANKLE_IN_LINE_RAD: Final = np.radians(-78.0)
"""Ankle angle of neutral standing in the Human Body Model: -90° + 12° (Wang's gait2d model)."""


def clinical_angles(q: ArrayLike, *, ankle_zero: AnkleZero = "right_angle") -> Array:
    """Give coordinates as the Human Body Model exports them.

    Parameters
    ----------
    q
        Coordinates in the order of `hbm.coordinates.COORDINATES`, (..., 46) [m and rad].
    ankle_zero
        Zero of AnklePlantarFlexion: "right_angle", foot at a right angle to the shank, or
        "in_line", foot in line with the shank, as in the Human Body Model, where neutral standing
        is -78°.

    Returns
    -------
    Array
        In the order of `hbm.coordinates.HBM_ORDER`, (..., 46) [m and rad].

    Raises
    ------
    ValueError
        If the last dimension is not 46 or ``ankle_zero`` is neither of the two.

    Notes
    -----
    The body's shoulder rotates by abduction a, flexion f, internal rotation i; the export's by
    flexion F, abduction A, internal rotation I, each about axes moved by those before it. For the
    same orientation of the arm, on both sides::

        sin A = sin a cos f
        F     = atan2(sin f, cos a cos f)
        I     = i + atan2(sin a sin f, cos a)

    and a second solution F ± 180°, 180° - A, I ± 180°, which is used where a is beyond 90°.

    Singular at A = ±90°, that is an arm held straight out sideways, as in a T-pose: only the sum or
    difference of F and I is defined there, and their noise grows as 1/cos A. At the singularity
    itself F is zero; across it, F and I may jump by 180°. Hanging arms are far from it.

    The ankle's zero is that of Wang's conversion to the gait2d model, ankle = -APF - 90° + 12°.

    Deviations from the original
    ----------------------------
    The original solves for these shoulder angles directly, so which of the two solutions it gives
    depends on the frames before.
    """
    q = np.asarray(q, float)
    if q.shape[-1:] != (len(HBM_ORDER),):
        raise ValueError(f"coordinates must have shape (..., {len(HBM_ORDER)}), got {q.shape}")
    if ankle_zero not in ("right_angle", "in_line"):
        raise ValueError(f"ankle_zero must be 'right_angle' or 'in_line', got {ankle_zero!r}")
    out = q[..., [INDEX[name] for name in HBM_ORDER]]
    for side in "RL":
        names = [f"{side}Shoulder{axis}" for axis in ("Abduction", "Flexion", "InternalRotation")]
        # the original's shoulder begins with flexion, ours with abduction: the same rotation
        angles = np.stack([q[..., INDEX[name]] for name in names])
        for name, angle in zip(names, _flexion_first(*angles), strict=True):
            out[..., HBM_ORDER.index(name)] = angle
        # the original measures the ankle from a foot in line with the shank
        if ankle_zero == "in_line":
            out[..., HBM_ORDER.index(f"{side}AnklePlantarFlexion")] += ANKLE_IN_LINE_RAD
    return out


def _flexion_first(a: Array, f: Array, i: Array) -> tuple[Array, Array, Array]:
    """Give abduction, flexion and internal rotation of the sequence that begins with flexion."""
    # abduction a, flexion f, rotation i; arcsin gives ±90°, so poses beyond are mirrored
    beyond = np.cos(a) < 0
    sign = np.where(beyond, -1.0, 1.0)
    # entries of R_flexion R_abduction R_internal = R_abduction R_flexion R_internal(i)
    abduction = np.arcsin(np.clip(np.sin(a) * np.cos(f), -1, 1))
    abduction = np.where(beyond, np.pi - abduction, abduction)
    flexion = np.arctan2(sign * np.sin(f), sign * np.cos(a) * np.cos(f))
    rotation = i + np.arctan2(sign * np.sin(a) * np.sin(f), sign * np.cos(a))
    # of equivalent angles those near ours, so that curves do not jump
    return _nearest_equivalent(abduction, a), _nearest_equivalent(flexion, f), rotation


def _nearest_equivalent(angle: Array, reference: Array) -> Array:
    """Add the full turns that bring an angle within half a turn of a reference."""
    return angle + 2 * np.pi * np.round((reference - angle) / (2 * np.pi))
