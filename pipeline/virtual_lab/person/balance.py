"""Balance: a centre of mass above its centre of pressure, in the lab and on the tilted platform."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_banded
from scipy.ndimage import gaussian_filter1d

from compensation.platform import PlatformPose
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.virtual_lab.person.body.momentum import ground_wrench
from pipeline.virtual_lab.person.body.wobbling import oscillators_of
from pipeline.virtual_lab.person.leg_ik import SoleTarget, solve_legs
from pipeline.virtual_lab.person.subject import VirtualSubject

RATE_HZ: Final = 100.0
"""Sampling rate at which walks are computed: the cameras'."""

SMOOTHING_HZ: Final = 6.0
"""Cut-off frequency to which joint motion is smoothed: that of walking is below it."""
CORRECTIONS: Final = 4
"""Corrections of the pelvis' place; chosen, enough for the pressure to stay under the feet."""
COARSE: Final = 2
"""Corrections are found for every second sample: the motion of a centre of mass is slow."""
LEG_ITERATIONS: Final = 10, 2
"""Iterations of the legs' inverse kinematics at most: in the first correction, which starts from
the gait pattern, and later, where each starts from the solution before."""
HEIGHT_WEIGHTS: Final = 0.1, 1.0
"""Weight of the pelvis' height in the legs' inverse kinematics, in the first iteration, in which
the legs show how high it can be, and in the others."""
LOWERING_SD: Final = 0.0
"""By how many standard deviations of that height the pelvis is lower than on average in it; chosen:
with more, knees are too bent at initial contact."""
GAIN: Final = 1.2
"""Of the correction: a little more than the error, as the body answers less than the point mass by
which it is corrected; chosen."""
MAX_ERROR_M: Final = 0.2
"""Larger errors of the centre of pressure are corrected as if they were that large."""
FREE_END_S: Final = 1 / 6
"""At the end of a walk balance is not corrected: what follows is unknown."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What a walk has to achieve; arrays have T samples at `RATE_HZ`.

    Attributes
    ----------
    subject
        Who walks.
    targets
        Side -> where its sole should be.
    pressure
        Intended centre of pressure in the lab, (T, 2) [m].
    height
        Height of the centre of mass [m].
    pose
        The platform's.
    phase
        Of the right gait cycle, (T,).
    walking
        From standing (0) to walking (1), (T,).
    steady
        When the belts have their full speed, (T,).
    corrected
        From 0 to 1 as balance begins to be corrected, (T,).
    """

    subject: VirtualSubject
    targets: Mapping[str, SoleTarget]
    pressure: Array
    height: float
    pose: PlatformPose
    phase: Array
    walking: Array
    steady: Mask
    corrected: Array

    def every(self, step: int) -> "Plan":
        """Give the plan for every so many samples."""
        part = slice(None, None, step)
        return replace(
            self,
            targets={side: target.frames(part) for side, target in self.targets.items()},
            pressure=self.pressure[part],
            pose=PlatformPose(self.pose.rotation[part], self.pose.position[part]),
            phase=self.phase[part],
            walking=self.walking[part],
            steady=self.steady[part],
            corrected=self.corrected[part],
        )

    def moved(self, q: Array, rate_hz: float) -> Array:
        """Give all coordinates (55, T) of a person who moves smoothly by (46, T)."""
        extra = self.subject.extra_joints
        return extra.extend(_smooth(q, rate_hz), self.phase, self.walking)


def keep_balance(plan: Plan, reference: Array, time: Array) -> Array:
    """Move a gait pattern so that the feet reach their places and the pressure is under them.

    Parameters
    ----------
    plan
        What has to be achieved.
    reference
        Coordinates of the pattern, (46, T) [rad and m].
    time
        (T,) [s], at `RATE_HZ`.

    Returns
    -------
    Array
        All coordinates, (55, T).
    """
    shift, start = _correction(plan.every(COARSE), reference[:, ::COARSE], RATE_HZ / COARSE)
    coarse = time[::COARSE]
    reference = reference.copy()
    reference[: len(shift)] += CubicSpline(coarse, shift, axis=1)(time)
    q = CubicSpline(coarse, start, axis=1)(time)
    subject = plan.subject
    weight, iterations = HEIGHT_WEIGHTS[1], LEG_ITERATIONS[1]
    q = solve_legs(
        subject.skeleton,
        subject.extra_joints,
        reference,
        plan.targets,
        q,
        weight,
        iterations,
    )
    return plan.moved(q, RATE_HZ)


def _correction(plan: Plan, reference: Array, rate_hz: float) -> tuple[Array, Array]:
    """Give by how much the pelvis has to move, (3, T) [m], and coordinates near the solution."""
    subject, shift = plan.subject, np.zeros((3, reference.shape[1]))
    fade = plan.corrected.copy()
    fade[-int(rate_hz * FREE_END_S) :] = 0.0
    pattern, q = reference[:3].copy(), np.ascontiguousarray(reference)
    reference = q.copy()
    for correction in range(CORRECTIONS):
        later = min(correction, 1)
        weight, iterations = HEIGHT_WEIGHTS[later], LEG_ITERATIONS[later]
        extra = subject.extra_joints
        q = solve_legs(subject.skeleton, extra, reference, plan.targets, q, weight, iterations)
        if correction == 0:
            change = (q - reference)[2, plan.steady]
            shift[2] = plan.walking * (change.mean() - LOWERING_SD * change.std())
        motion = _differentiated(plan.moved(q, rate_hz), rate_hz)
        oscillators = oscillators_of(subject.wobbling, rate_hz)
        wrench = ground_wrench(subject.skeleton, motion, oscillators)
        found = in_lab(pressure_on_platform(wrench, plan.pose), plan.pose)[:, :2]
        error = np.clip(np.nan_to_num(plan.pressure - found), -MAX_ERROR_M, MAX_ERROR_M)
        shift[:2] += GAIN * balanced(fade[:, None] * error, plan.height, rate_hz).T
        reference[:3] = pattern + shift
    return shift, q


def _smooth(q: Array, rate_hz: float) -> Array:
    """Smooth by a Gaussian whose amplitude response is 1/√2 at `SMOOTHING_HZ`, (C, T)."""
    sigma = np.sqrt(np.log(2) / 2) / (2 * np.pi * SMOOTHING_HZ) * rate_hz
    return np.asarray(gaussian_filter1d(q, sigma, axis=1, mode="nearest"))


def _differentiated(values: Array, rate_hz: float) -> tuple[Array, Array, Array]:
    """Give values (C, T) with their first and second derivatives, to fourth order."""
    padded = np.pad(values, ((0, 0), (2, 2)), mode="edge")
    near = padded[:, 3:-1], padded[:, 1:-3]
    far = padded[:, 4:], padded[:, :-4]
    rate = (8 * (near[0] - near[1]) - (far[0] - far[1])) * (rate_hz / 12)
    second = (16 * (near[0] + near[1]) - (far[0] + far[1]) - 30 * values) * (rate_hz**2 / 12)
    return values, rate, second


def balanced(pressure: Array, height: float, rate_hz: float = RATE_HZ) -> Array:
    """Give the bounded motion of a mass above a moving centre of pressure.

    Parameters
    ----------
    pressure
        Horizontal place of the centre of pressure, (T, 2) [m].
    height
        Height of the mass above it [m].
    rate_hz
        Sampling rate [Hz].

    Returns
    -------
    Array
        Horizontal place of the mass, (T, 2) [m].

    Notes
    -----
    Solves ``c - (h/g) c̈ = p``, the linear inverted pendulum, as a boundary value problem (Kajita
    et al. 2003, IEEE ICRA 1620).
    """
    stiffness = height / GRAVITY_MPS2 * rate_hz**2
    bands = np.empty((3, len(pressure)))
    bands[0], bands[1], bands[2] = -stiffness, 1 + 2 * stiffness, -stiffness
    bands[1, [0, -1]] = 1 + stiffness
    return np.asarray(solve_banded((1, 1), bands, pressure))


def pressure_on_platform(wrench: Array, pose: PlatformPose) -> Array:
    """Give the centre of pressure of a wrench on the platform's surface, in its frame, (T, 2) [m].

    The wrench is in lab axes about the lab origin, (T, 6) [N, N·m].
    """
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    force = (to_platform @ wrench[:, :3, None])[..., 0]
    moment = wrench[:, 3:] - np.cross(pose.position, wrench[:, :3])
    moment = (to_platform @ moment[..., None])[..., 0]
    return np.column_stack([-moment[:, 1], moment[:, 0]]) / force[:, 2:]


def surface_height(pose: PlatformPose, place: Array) -> Array:
    """Give the height of the platform's surface at a place (2,) [m] in the lab, (T,) [m]."""
    normal, away = pose.rotation[:, :, 2], place - pose.position[:, :2]
    sideways = np.sum(normal[:, :2] * away, axis=1)
    return np.asarray(pose.position[:, 2] - sideways / normal[:, 2])


def in_lab(points: Array, pose: PlatformPose) -> Array:
    """Transform points of the platform, (T, 3) or, on its surface, (T, 2), to the lab, (T, 3)."""
    if points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    return pose.to_lab(points)


def on_platform(points: Array, pose: PlatformPose) -> Array:
    """Transform points of the lab to the platform's frame, (T, 3) [m]."""
    away = points - pose.position
    return np.asarray((np.swapaxes(pose.rotation, 1, 2) @ away[..., None])[..., 0])
