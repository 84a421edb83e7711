"""A person walks: coordinates that keep the feet on the belt and the body in balance.

The pattern of the joints comes from `gait`; the feet are where `steps` placed them; the legs reach
them (`reach`); then the pelvis is moved until the ground wrench that follows from the equations of
motion has its centre of pressure where the feet are.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from compensation.platform.pose import PlatformPose
from hbm.center_of_mass import center_of_mass
from hbm.coordinates import INDEX, SEGMENTS
from hbm.kernels.native import kernels
from hbm.poses import segment_frames
from hbm.spatial import Array
from pipeline.virtual_lab.machine.platform import PlatformTrajectory
from pipeline.virtual_lab.machine.treadmill import BeltRamp
from pipeline.virtual_lab.person.balance import (
    RATE_HZ,
    balanced,
    in_lab,
    on_platform,
    pressure_on_platform,
    surface_height,
)
from pipeline.virtual_lab.person.foot_placement import FootPlacement
from pipeline.virtual_lab.person.gait_pattern import STEP_M, foot_angles, foothold, posture, size_of
from pipeline.virtual_lab.person.leg_ik import reach
from pipeline.virtual_lab.person.sole import SIDES, orientation, rolled, sole_of
from pipeline.virtual_lab.person.stance import LEAVING, STANCE, firmness_of
from pipeline.virtual_lab.person.steps import Steps, place_sideways, step_time
from pipeline.virtual_lab.person.subject import VirtualSubject
from pipeline.virtual_lab.trajectories import Trajectory, fit_trajectory, smooth_step

ARMS_DOWN: Final = 0.48, 0.35  # begin and duration, as shares of the time before walking
SMOOTHING_HZ: Final = 6.0  # cut-off of the muscles' and tissues' smoothness
CORRECTIONS: Final = 6
HEIGHT_PULL: Final = 0.1, 1.0  # at first the legs say how high the pelvis can be; then it stays
LOWER: Final = 1.0  # standard deviations of that height
LARGEST_M: Final = 0.2
SETTLE_S: Final = 0.5
WANDER_S: Final = 0.3
STRAIGHTEST: Final = 0.08  # of a knee while walking [rad]: a straight leg cannot give way
CHUNK: Final = 6000


@dataclass(frozen=True, slots=True)
class Walk:
    """What a person did.

    Attributes
    ----------
    subject
        Who.
    motion
        All coordinates over time, 46 columns [rad, m].
    placement
        Where the feet stood.
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
    """Let a person stand in a T-pose, lower the arms, and walk.

    Parameters
    ----------
    subject
        Who walks.
    steps
        When the feet come down; the first contact is when walking begins.
    belt, platform
        What moves under the person.
    duration
        How long [s].
    rng
        Source of the variability.
    jobs
        Threads.

    Returns
    -------
    Walk
        Coordinates, and where the feet stood.
    """
    time = np.arange(round(duration * RATE_HZ) + 1) / RATE_HZ
    placement = _place(subject, steps, belt, platform, rng)
    pose = platform.pose(time)
    reference = _pattern(subject, placement, platform.slope(time), time, rng)
    height = float(center_of_mass(subject.body, subject.standing[None])[0, 2])

    ahead = center_of_mass(subject.body, reference)[:, :2] - reference[:, :2]
    placement = _comfortable(placement, reference, ahead, pose, height, time)
    wanted = in_lab(placement.total_pressure(time), pose)[:, :2]
    reference[:, :2] = balanced(wanted, height) - ahead
    reference[:, 2] += surface_height(pose, subject.standing[:2])

    feet = _feet(subject, placement, reference, pose, time)
    extent = placement.extent(time)
    walking, steady = np.minimum(extent, 1.0), extent > 0.99 * extent[-1]
    q = reference.copy()
    for correction in range(CORRECTIONS):
        pull = HEIGHT_PULL[min(correction, 1)]
        q = reach(subject.body, reference, placement.soles, *feet, q, pull, jobs)
        if correction == 0:
            sunk = (q - reference)[steady, 2]
            reference[:, 2] += walking * (sunk.mean() - LOWER * sunk.std())
        motion = fit_trajectory(_smooth(q), RATE_HZ)
        if correction == CORRECTIONS - 1:
            break
        error = wanted - _pressure(subject, motion, pose, time, jobs)
        error = np.clip(np.nan_to_num(error), -LARGEST_M, LARGEST_M)
        error[-int(RATE_HZ / 6) :] = 0.0
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
    """Decide where the feet come down: forward so that mid-stance is under the person."""
    habits, size = subject.habits, size_of(subject.standing)
    height = float(center_of_mass(subject.body, subject.standing[None])[0, 2])
    sideways = place_sideways(steps, habits, height, platform.sway, rng)
    pace = step_time(habits, belt.speed_mps)
    contact = steps.contact
    middle = (
        np.append(contact[0], steps.off[:-1]) + np.append(contact[1:], contact[-1] + pace)
    ) / 2
    slope, pose = platform.slope(contact), platform.pose(contact)
    forward = (subject.standing[0] - pose.position[:, 0]) / np.cos(slope)
    forward -= size * (STANCE * STEP_M - foothold(slope))
    forward += belt.travelled(middle) - belt.travelled(contact)
    forward += habits.forward_sd * np.clip(rng.normal(size=len(contact)), -3, 3)
    soles = {side: sole_of(subject.body, subject.t_pose, side) for side in SIDES}
    place = np.column_stack([forward, sideways])
    ahead = center_of_mass(subject.body, subject.t_pose[None])[0, 0] - soles["left"].standing[0]
    return FootPlacement(soles, steps, place, belt, STEP_M * size, pace, float(ahead))


def _pattern(
    subject: VirtualSubject,
    placement: FootPlacement,
    slope: Array,
    time: Array,
    rng: np.random.Generator,
) -> Array:
    """Give the coordinates without regard to feet and balance, (T, 46)."""
    begin, lasting = (share * placement.steps.contact[0] for share in ARMS_DOWN)
    arms = smooth_step((time - begin) / lasting)[:, None]
    extent = placement.extent(time)
    walking = np.minimum(extent, 1.0)[:, None]
    q = subject.t_pose + arms * (subject.standing - subject.t_pose)
    mean = posture(placement.phase("right", time), extent, slope, subject.standing)
    q += subject.style.apply(mean - subject.standing, walking)
    wander = gaussian_filter1d(rng.normal(size=q.shape), WANDER_S * RATE_HZ, axis=0)
    wander *= np.sqrt(2 * np.sqrt(np.pi) * WANDER_S * RATE_HZ)
    q += walking * subject.style.wander * wander
    for knee in (INDEX["RKneeFlexion"], INDEX["LKneeFlexion"]):
        bent = q[:, knee] - STRAIGHTEST
        more = (np.hypot(bent, STRAIGHTEST / 2) - bent) / 2
        q[:, knee] += walking[:, 0] * more
    return q


def _comfortable(
    placement: FootPlacement,
    reference: Array,
    ahead: Array,
    pose: PlatformPose,
    height: float,
    time: Array,
) -> FootPlacement:
    """Move the pressure along the feet so that the pelvis is above them as the pattern wants."""
    steady = placement.extent(time) > 0.99 * placement.extent(time)[-1]
    pressure = in_lab(placement.total_pressure(time), pose)[:, :2]
    pelvis = balanced(pressure, height) - ahead
    shift = float(np.mean((reference[:, 0] - pelvis[:, 0])[steady]))
    return replace(placement, pressure_shift=shift)


def _feet(
    subject: VirtualSubject,
    placement: FootPlacement,
    reference: Array,
    pose: PlatformPose,
    time: Array,
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Give the soles' poses in the lab and how firm they are: rolling in stance, free in swing."""
    rotation, position, firmness = {}, {}, {}
    feet = segment_poses(subject, reference, [sole.segment for sole in placement.soles.values()])
    for side, (_, ankle) in zip(placement.soles, feet, strict=True):
        sole = placement.soles[side]
        pitch, _ = foot_angles(placement.phase(side, time))
        pitch = pitch * placement.extent(time)
        heading = placement.heading(side, time)
        rotation[side] = pose.rotation @ orientation(pitch, heading)
        swinging = on_platform(ankle - (rotation[side] @ sole.origin), pose)
        rolling = rolled(sole, pitch, heading)
        position[side] = in_lab(_path(placement, side, swinging, rolling, time), pose)
        firm = firmness_of(pitch, placement.phase(side, time))
        firmness[side] = 1 - np.minimum(placement.extent(time), 1.0)[:, None] * (1 - firm)
    return rotation, position, firmness


def _path(
    placement: FootPlacement, side: str, swinging: Array, rolling: Array, time: Array
) -> Array:
    """Join stances and swings: a swing ends where the next stance begins, (T, 3) [m]."""
    end = len(time) - 1
    own = list(range(0 if side == "left" else 1, len(placement.steps.contact), 2))
    path = np.empty_like(swinging)
    away, left_at = None, 0
    for number in own if side == "left" else [-1, *own]:
        standing = number < 1 if side == "left" else number < 0
        contact = 0.0 if standing else placement.steps.contact[number]
        release = placement.release(number) if number >= 0 else _first_release(placement)
        first, last = int(np.ceil(contact * RATE_HZ)), int(np.floor(release * RATE_HZ))
        stance = slice(min(first, end), min(last, end) + 1)
        held = rolling[stance] + np.pad(
            placement.anchor(side, np.full(len(time[stance]), number), time[stance]),
            ((0, 0), (0, 1)),
        )
        if away is not None:
            swing = np.arange(left_at, min(first, end + 1))
            u = ((swing - left_at) / (first - left_at))[:, None]
            arrival = held[0] - swinging[stance.start]
            path[swing] = swinging[swing] + away + u * u * (3 - 2 * u) * (arrival - away)
        if first > end:
            break
        path[stance] = held
        left_at = stance.stop - 1
        away = held[-1] - swinging[left_at]
    return path


def _first_release(placement: FootPlacement) -> float:
    """Give when the right foot leaves its standing place [s]."""
    released = (LEAVING[0] - 0.5) * placement.steps.overlap / (STANCE - 0.5)
    return float(placement.steps.contact[0]) + released * placement.pace_s


def _smooth(q: Array) -> Array:
    sigma = np.sqrt(np.log(2) / 2) / (2 * np.pi * SMOOTHING_HZ) * RATE_HZ
    return np.asarray(gaussian_filter1d(q, sigma, axis=0, mode="nearest"))


def _pressure(
    subject: VirtualSubject, motion: Trajectory, pose: PlatformPose, time: Array, jobs: int
) -> Array:
    """Give the centre of pressure on the platform, in the lab, that the motion implies, (T, 2)."""
    wrench = ground_wrench(subject, motion, time, jobs)
    points = pressure_on_platform(wrench, pose)
    return in_lab(points, pose)[:, :2]


def ground_wrench(subject: VirtualSubject, motion: Trajectory, time: Array, jobs: int = 1) -> Array:
    """Give the wrench that the ground must exert for the motion to be possible, (T, 6).

    Lab axes about the lab origin [N, N·m]; exact, from the subject's own body.
    """
    body, parts = subject.body, []
    for start in range(0, len(time), CHUNK):
        part = time[start : start + CHUNK]
        state = [motion.at(part, k) for k in range(3)]
        parts.append(
            kernels().newton_euler(*state, body.geometry, body.inertia_vector, jobs=jobs)[1]
        )
    return np.concatenate(parts)


def segment_poses(subject: VirtualSubject, q: Array, names: list[str]) -> list[tuple[Array, Array]]:
    """Give rotations and origins of some segments, (T, 3, 3) and (T, 3) each."""
    chosen = [SEGMENTS.index(name) for name in names]
    parts = [segment_frames(subject.body, q[k : k + CHUNK]) for k in range(0, len(q), CHUNK)]
    rotation = np.concatenate([R[:, chosen] for R, _ in parts])
    origin = np.concatenate([o[:, chosen] for _, o in parts])
    return list(zip(np.moveaxis(rotation, 1, 0), np.moveaxis(origin, 1, 0), strict=True))
