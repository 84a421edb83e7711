"""A person walks: coordinates that keep the feet on the belt and the body in balance.

The pattern of the joints comes from `gait_pattern`; the feet are where `steps` placed them; the
legs reach them (`leg_ik`); then the pelvis is moved until the ground wrench that follows from the
equations of motion has its centre of pressure where the feet are.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from compensation.platform.pose import PlatformPose
from hbm.coordinates import INDEX
from hbm.poses import center_of_mass
from hbm.spatial import Array
from pipeline.virtual_lab.machine.platform import PlatformTrajectory
from pipeline.virtual_lab.machine.treadmill import BeltRamp
from pipeline.virtual_lab.person.balance import (
    RATE_HZ,
    balanced,
    in_lab,
    pressure_on_platform,
    surface_height,
)
from pipeline.virtual_lab.person.dynamics import ground_wrench
from pipeline.virtual_lab.person.foot_placement import FootPlacement
from pipeline.virtual_lab.person.gait_pattern import (
    STEP_M,
    foothold,
    posture,
    size_of,
)
from pipeline.virtual_lab.person.leg_ik import solve_legs
from pipeline.virtual_lab.person.sole import SIDES, sole_of
from pipeline.virtual_lab.person.sole_path import sole_targets
from pipeline.virtual_lab.person.stance import STANCE
from pipeline.virtual_lab.person.steps import (
    MAX_DEVIATION_SD,
    Steps,
    place_sideways,
    step_time,
)
from pipeline.virtual_lab.person.subject import VirtualSubject
from pipeline.virtual_lab.trajectories import Trajectory, fit_trajectory, smooth_step

ARMS_DOWN: Final = 0.48, 0.35
"""When lowering the arms begins, and how long it takes, as shares of the time before walking."""
SMOOTHING_HZ: Final = 6.0
"""Cut-off frequency to which joint motion is smoothed: that of walking is below it."""
CORRECTIONS: Final = 6
"""Iterations of legs and balance; chosen, enough for the pressure to stay under the feet."""
HEIGHT_WEIGHTS: Final = 0.1, 1.0
"""Weight of the pelvis' height in the legs' inverse kinematics, in the first iteration, in which
the legs show how high it can be, and in the others."""
LOWERING_SD: Final = 1.0
"""By how many standard deviations of that height the pelvis is lower than on average in it."""
MAX_ERROR_M: Final = 0.2
"""Larger errors of the centre of pressure are corrected as if they were that large."""
SETTLE_S: Final = 0.5
"""Time from the first step on in which the correction of balance begins."""
FREE_END_S: Final = 1 / 6
"""At the end of a walk balance is not corrected: what follows is unknown."""
WANDER_S: Final = 0.3
"""Time constant of slow variations of the joint angles; assumed."""
MIN_KNEE_RAD: Final = 0.08
"""Smallest flexion of a knee in walking: a straight leg cannot give way."""
STEADY_SHARE: Final = 0.99
"""Walking is steady when steps have this share of their final length."""


@dataclass(frozen=True, slots=True)
class Walk:
    """How a person moved in a trial.

    Attributes
    ----------
    subject
        Who.
    motion
        All coordinates as functions of time, 46 columns [rad, m].
    placement
        Where the feet were.
    platform
        How the platform moved meanwhile.
    """

    subject: VirtualSubject
    motion: Trajectory
    placement: FootPlacement
    platform: PlatformTrajectory


def simulate_walk(
    subject: VirtualSubject,
    steps: Steps,
    belt: BeltRamp,
    platform: PlatformTrajectory,
    duration: float,
    rng: np.random.Generator,
    *,
    jobs: int = 1,
) -> Walk:
    """Simulate a person who stands in a T-pose, lowers the arms, and walks.

    Parameters
    ----------
    subject
        Who walks.
    steps
        Times of the steps; walking begins with the first contact.
    belt, platform
        How the treadmill moves under the person.
    duration
        Of the trial [s].
    rng
        Source of the variability.
    jobs
        Number of threads.

    Returns
    -------
    Walk
        Coordinates and foot placement.
    """
    time = np.arange(round(duration * RATE_HZ) + 1) / RATE_HZ
    placement = _place(subject, steps, belt, platform, rng)
    pose = platform.pose(time)
    reference = _pattern(subject, placement, platform.slope(time), time, rng)
    height = float(center_of_mass(subject.body, subject.standing[None])[0, 2])

    ahead = center_of_mass(subject.body, reference)[:, :2] - reference[:, :2]
    placement = _shifted_pressure(placement, reference, ahead, pose, height, time)
    intended = in_lab(placement.total_pressure(time), pose)[:, :2]
    reference[:, :2] = balanced(intended, height) - ahead
    reference[:, 2] += surface_height(pose, subject.standing[:2])

    targets = sole_targets(subject, placement, reference, pose, time)
    extent = placement.extent(time)
    walking, steady = np.minimum(extent, 1.0), extent > STEADY_SHARE * extent[-1]
    q = reference.copy()
    for correction in range(CORRECTIONS):
        height_weight = HEIGHT_WEIGHTS[min(correction, 1)]
        q = solve_legs(subject.body, reference, targets, q, height_weight, jobs)
        if correction == 0:
            change = (q - reference)[steady, 2]
            reference[:, 2] += walking * (change.mean() - LOWERING_SD * change.std())
        motion = fit_trajectory(_smooth(q), RATE_HZ)
        if correction == CORRECTIONS - 1:
            break
        error = intended - _pressure(subject, motion, pose, time, jobs)
        error = np.clip(np.nan_to_num(error), -MAX_ERROR_M, MAX_ERROR_M)
        error[-int(RATE_HZ * FREE_END_S) :] = 0.0
        error *= smooth_step((time - steps.contact[0]) / SETTLE_S)[:, None]
        reference[:, :2] += balanced(error, height)
    return Walk(subject, motion, placement, platform)


def _place(
    subject: VirtualSubject,
    steps: Steps,
    belt: BeltRamp,
    platform: PlatformTrajectory,
    rng: np.random.Generator,
) -> FootPlacement:
    """Choose where the feet come down: forward so that mid-stance is under the person."""
    parameters, size = subject.step_parameters, size_of(subject.standing)
    height = float(center_of_mass(subject.body, subject.standing[None])[0, 2])
    sideways = place_sideways(steps, parameters, height, platform.sway, rng)
    step_s = step_time(parameters, belt.speed_mps)
    contact = steps.contact
    middle = (
        np.append(contact[0], steps.off[:-1]) + np.append(contact[1:], contact[-1] + step_s)
    ) / 2
    slope, pose = platform.slope(contact), platform.pose(contact)
    forward = (subject.standing[0] - pose.position[:, 0]) / np.cos(slope)
    forward -= size * (STANCE * STEP_M - foothold(slope))
    forward += belt.travelled(middle) - belt.travelled(contact)
    deviation = np.clip(rng.normal(size=len(contact)), -MAX_DEVIATION_SD, MAX_DEVIATION_SD)
    forward += parameters.forward_sd * deviation
    soles = {side: sole_of(subject.body, subject.t_pose, side) for side in SIDES}
    place = np.column_stack([forward, sideways])
    ahead = center_of_mass(subject.body, subject.t_pose[None])[0, 0] - soles["left"].standing[0]
    return FootPlacement(soles, steps, place, belt, STEP_M * size, step_s, float(ahead))


def _pattern(
    subject: VirtualSubject,
    placement: FootPlacement,
    slope: Array,
    time: Array,
    rng: np.random.Generator,
) -> Array:
    """Give the person's gait pattern without regard to feet and balance, (T, 46)."""
    begin, duration = (share * placement.steps.contact[0] for share in ARMS_DOWN)
    lowered = smooth_step((time - begin) / duration)[:, None]
    extent = placement.extent(time)
    walking = np.minimum(extent, 1.0)[:, None]
    q = subject.t_pose + lowered * (subject.standing - subject.t_pose)
    mean = posture(placement.phase("right", time), extent, slope, subject.standing)
    q += subject.style.apply(mean - subject.standing, walking)
    wander = gaussian_filter1d(rng.normal(size=q.shape), WANDER_S * RATE_HZ, axis=0)
    wander *= np.sqrt(2 * np.sqrt(np.pi) * WANDER_S * RATE_HZ)
    q += walking * subject.style.wander * wander
    for knee in (INDEX["RKneeFlexion"], INDEX["LKneeFlexion"]):
        excess = q[:, knee] - MIN_KNEE_RAD
        more = (np.hypot(excess, MIN_KNEE_RAD / 2) - excess) / 2
        q[:, knee] += walking[:, 0] * more
    return q


def _shifted_pressure(
    placement: FootPlacement,
    reference: Array,
    ahead: Array,
    pose: PlatformPose,
    height: float,
    time: Array,
) -> FootPlacement:
    """Shift the pressure along the feet so that the pelvis is above them as in the pattern.

    ``ahead`` is the centre of mass from the pelvis, (T, 2) [m].
    """
    extent = placement.extent(time)
    steady = extent > STEADY_SHARE * extent[-1]
    pressure = in_lab(placement.total_pressure(time), pose)[:, :2]
    pelvis = balanced(pressure, height) - ahead
    shift = float(np.mean((reference[:, 0] - pelvis[:, 0])[steady]))
    return replace(placement, pressure_shift=shift)


def _smooth(q: Array) -> Array:
    """Smooth by a Gaussian whose amplitude response is 1/√2 at `SMOOTHING_HZ`."""
    sigma = np.sqrt(np.log(2) / 2) / (2 * np.pi * SMOOTHING_HZ) * RATE_HZ
    return np.asarray(gaussian_filter1d(q, sigma, axis=0, mode="nearest"))


def _pressure(
    subject: VirtualSubject, motion: Trajectory, pose: PlatformPose, time: Array, jobs: int
) -> Array:
    """Give the centre of pressure that follows from the motion, in the lab, (T, 2) [m]."""
    wrench = ground_wrench(subject, motion, time, jobs)
    points = pressure_on_platform(wrench, pose)
    return in_lab(points, pose)[:, :2]
