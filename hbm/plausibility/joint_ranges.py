"""Check of a motion: joint angles that no human joint reaches."""

from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, INDEX, N_Q, SIDES
from hbm.ik.continuity import BALL_JOINTS
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.uncertainty import MAX_UNCERTAINTY_RAD, angle_uncertainty, spread_over
from hbm.spatial import Array

RANGE_DEG: Final = {
    "TrunkFlexion": (-90.0, 130.0),
    "TrunkRightBend": (-75.0, 75.0),
    "TrunkLeftTwist": (-90.0, 90.0),
    "HeadFlexion": (-110.0, 110.0),
    "HeadRightBend": (-85.0, 85.0),
    "HeadLeftTwist": (-120.0, 120.0),
    "ElbowFlexion": (-40.0, 180.0),
    "ForeArmPronation": (-60.0, 230.0),
    "WristFlexion": (-120.0, 120.0),
    "HandAbduction": (-75.0, 75.0),
    "HipFlexion": (-75.0, 180.0),
    "HipAbduction": (-75.0, 130.0),
    "HipInternalRotation": (-110.0, 110.0),
    "KneeFlexion": (-45.0, 180.0),
    "AnklePlantarFlexion": (-70.0, 120.0),
    "FootPronation": (-75.0, 75.0),
    "ToeFlexion": (-120.0, 90.0),
}
"""Lowest and highest angle, without the side; zero as in `hbm.calibration_pose.shape`.

Each end lies 20° or more beyond what has been measured: passive ranges of 674 people of 2 to 69
years (Soucie et al. 2011, Haemophilia 17:500); active ones of foot, wrist and hip rotation (Boone
and Azen 1979, J Bone Joint Surg Am 61:756); plantar flexion of ballet dancers (89°, Russell et al.
2010, Foot Ankle Spec 3:324); internal rotation of hips with anteverted femora (90°). Misplaced
markers of an axis, and a pelvis whose markers are tilted by 30°, shift angles by that much. The
pelvis may have any orientation. Shoulders have no range in these angles, in which an arm reaches
one orientation in several ways."""

MAX_NAMED: Final = 6
"""Coordinates in a note: one wrong label turns several joints."""


def impossible_angles(body: Body, motion: Motion) -> tuple[Note, ...]:
    """Find joint angles beyond any human's range.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion as the inverse kinematics gave it.

    Returns
    -------
    tuple of Note
        One ``joint_angles_impossible``: the coordinates with their extremes, and the share of the
        solved frames in which any of them is beyond its `RANGE_DEG`. Coordinates that no marker
        observes do not count, nor those that are hardly observed: marker errors of 10 mm turn them
        by more than 20° (standard deviation).

    Notes
    -----
    Angles are compared modulo full turns, and those of a ball joint in the one of their two
    equivalent sets, (a, b, c) and (a + π, π − b, c + π), that is nearer to the ranges.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> import hbm
    >>> impossible_angles(body, hbm.solve_ik(body, static))
    ()
    """
    outside = ((motion.q < LOW) | (motion.q > HIGH)).any(axis=1)  # as they are: few frames
    solved = np.flatnonzero(motion.converged & outside)
    angle = _nearest_to_ranges(motion.q[solved])
    beyond = (_excess(angle) > 0) & motion.observed[solved]
    for i in np.flatnonzero(beyond.any(axis=0)):
        some = spread_over(solved[beyond[:, i]])
        if np.median(angle_uncertainty(body, motion, some)[:, i]) > MAX_UNCERTAINTY_RAD:
            beyond[:, i] = False
    if not beyond.any():
        return ()
    excess = np.where(beyond, _excess(angle), 0)
    frame, most = excess.argmax(axis=0), excess.max(axis=0)
    worst = [i for i in np.argsort(-most)[:MAX_NAMED] if most[i] > 0]
    extreme_deg = {COORDINATES[i]: np.degrees(angle[frame[i], i]) for i in worst}
    share = beyond.any(axis=1).sum() / np.count_nonzero(motion.converged)
    return (Note.of("joint_angles_impossible", share=share, extreme_deg=extreme_deg),)


def _limits() -> tuple[Array, Array]:
    """Give the lowest and highest value of every coordinate, (46,) each; infinite where none."""
    low, high = np.full(N_Q, -np.inf), np.full(N_Q, np.inf)
    for name, i in INDEX.items():
        joint = name if name in RANGE_DEG else name.removeprefix(name[0])
        if joint in RANGE_DEG and (joint == name or name[0] in SIDES.values()):
            low[i], high[i] = np.radians(RANGE_DEG[joint])
    return low, high


LOW, HIGH = _limits()
LIMITED: Final = np.isfinite(LOW)
LIMITED_BALL_JOINTS: Final = tuple(i for i in BALL_JOINTS if LIMITED[i])


def _excess(angle: Array, of: slice = slice(None)) -> Array:
    """Give how far coordinates, by default all 46, are beyond their ranges [rad]; 0 within."""
    return np.maximum(0, np.maximum(LOW[of] - angle, angle - HIGH[of]))


def _nearest_to_ranges(q: Array) -> Array:
    """Give equivalent coordinates, (F, 46), that are as little beyond their ranges as can be."""
    best = _within_a_turn(q)
    for i in LIMITED_BALL_JOINTS:
        joint = slice(i, i + 3)
        other = _within_a_turn(best[:, joint] * [1, -1, 1] + np.pi, joint)
        nearer = _excess(other, joint).sum(axis=1) < _excess(best[:, joint], joint).sum(axis=1)
        best[nearer, joint] = other[nearer]
    return best


def _within_a_turn(q: Array, of: slice = slice(None)) -> Array:
    """Add the full turns that bring angles within half a turn of the middle of their range."""
    angle, limited = q.copy(), LIMITED[of]
    middle = (LOW[of][limited] + HIGH[of][limited]) / 2
    angle[:, limited] = (q[:, limited] - middle + np.pi) % (2 * np.pi) - np.pi + middle
    return angle
