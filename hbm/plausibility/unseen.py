"""Segments that no marker shows, and what residuals hold of their motion."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from hbm.coordinates import FIXED_TO, INDEX, LIMBS, UP
from hbm.ik.problem import undetermined
from hbm.model import Body
from hbm.motion import Motion
from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array, Mask, rotation_about

MIN_SHARE_NOTED: Final = 0.02
"""Share of the body's mass: both hands are 1.2 %, whose own motion hardly matters."""
TRUNK: Final = ("mid_trunk", "thorax")
ARMS: Final = (*LIMBS["right arm"][1:], *LIMBS["left arm"][1:])
SPREAD_PERCENT: Final[Mapping[tuple[str, ...], Sequence[float]]] = {
    TRUNK: (4.4, 3.6, 2.7, 0.85, 1.1, 0.14),
    ("head",): (0.4, 0.3, 0.4, 0.16, 0.25, 0.02),
    ARMS: (1.1, 0.8, 0.5, 0.11, 0.35, 0.17),
}
"""Segments -> SD of what they add to the residual of a walk when no marker shows them: forward,
left, up; about the same axes; % of body weight, and of body weight × stature. All together as in 35
recordings of 28 people of 8 laboratories without the markers of trunk, head and arms; head and arms
as in 7 and 5 recordings of 6 people (`tests.campaign.legs_alone`)."""
LEVERS: Final = ((3, 1, -0.9), (4, 0, 0.77))
"""Moment, force, and their correlation: the forces act above the pelvis."""


def unseen_segments(body: Body, motion: Motion) -> tuple[str, ...]:
    """Give the segments that the markers of a motion leave uncertain by more than 5 cm.

    Gives none that moves with a marker that is seen, and none where all are as light as hands.
    """
    if not motion.converged.any():
        return ()
    markers = seen_markers(motion)
    shown = {body.segment_of[name] for name in markers}
    uncertain = undetermined(body, markers)[1]
    segments = tuple(s for s in uncertain if FIXED_TO.get(s, s) not in shown)
    return segments if mass_share(body, segments) >= MIN_SHARE_NOTED else ()


def seen_markers(motion: Motion) -> list[str]:
    """Give the markers that are seen in any frame of a motion."""
    seen = np.atleast_1d(np.isfinite(motion.marker_error).any(axis=0))
    return [name for name, ever in zip(motion.markers, seen, strict=True) if ever]


def mass_share(body: Body, segments: Sequence[str]) -> float:
    """Give the share of the body's mass in segments."""
    return sum(body.segments[segment].mass for segment in segments) / body.mass


def mass_not_shown(body: Body, segments: tuple[str, ...]) -> tuple[Note, ...]:
    """Say what share of the body's mass these segments are, if it matters."""
    share = mass_share(body, segments)
    if share < MIN_SHARE_NOTED:
        return ()
    return (Note.of("mass_not_shown", segments=segments, share=share),)


def unseen_covariance(body: Body, motion: Motion, frames: Mask) -> Array:
    """Give what the motion of unseen segments adds to the residual of somebody who walks.

    Parameters
    ----------
    body
        The subject.
    motion
        The motion, T frames.
    frames
        Over which to average where the subject faces, (T,); without any, forward is the lab's X.

    Returns
    -------
    Array
        Covariance in lab axes about the pelvis origin, (6, 6) [N, N·m]. Zero where markers show
        trunk, head and arms; hands alone do not count.

    Notes
    -----
    Each part contributes by the share of its mass that is unseen. Other ways of moving differ:
    arms that are held forward in a squat add 6 % of body weight × stature to My.
    """
    segments = unseen_segments(body, motion)
    percent_of = body.mass * GRAVITY_MPS2 / 100 * np.repeat([1.0, body.height_m], 3)
    variance = np.zeros(6)
    for part, percent in SPREAD_PERCENT.items():
        unseen = [segment for segment in part if segment in segments]
        share = mass_share(body, unseen) / mass_share(body, part)
        variance += share * np.square(percent_of * percent)
    covariance = np.diag(variance)
    for moment, force, correlation in LEVERS:
        product = correlation * np.sqrt(variance[moment] * variance[force])
        covariance[moment, force] = covariance[force, moment] = product
    # from axes of heading to those of the lab, in every frame, and their mean
    yaw = motion.q[frames & motion.converged, INDEX["PelvisYaw"]]
    turns = np.kron(np.eye(2), rotation_about(UP, yaw if len(yaw) else [0.0]))
    return np.asarray((turns @ covariance @ turns.transpose(0, 2, 1)).mean(axis=0))
