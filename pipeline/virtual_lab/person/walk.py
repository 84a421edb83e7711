"""A person walks: coordinates that keep the feet on the belt and the body in balance.

The pattern of the joints and the times of the steps come from `gait`; the legs reach the feet, and
the pelvis is moved until the ground wrench that follows from the equations of motion has its centre
of pressure where the feet are (`balance`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from compensation.platform import PlatformPose
from hbm.coordinates import INDEX
from hbm.numbers import read_numbers
from hbm.spatial import Array, transform_wrench
from pipeline.io.recording import Event
from pipeline.virtual_lab.machine.platform import (
    BeltRamp,
    PlatformTrajectory,
    Trajectory,
    fit_trajectory,
    smooth_step,
)
from pipeline.virtual_lab.person import balance, body, gait
from pipeline.virtual_lab.person.subject import VirtualSubject

STYLE: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "style")

FORCES_PER_FRAME: Final = 2
"""Ground forces per sample of the motion: at 200 Hz, between which they are interpolated. The
motion has nothing above 30 Hz."""


@dataclass(frozen=True, slots=True)
class Walk:
    """How a person moved in a trial.

    Attributes
    ----------
    subject
        Who.
    motion
        All coordinates as functions of time, 55 columns [rad, m]: those of the Human Body Model,
        then those of the joints that it does not have.
    ground
        The wrench of the ground, from the person's true mechanics, 6 columns [N, N·m]; lab axes
        about the lab origin.
    left
        The part of it on the left foot, in the same form.
    placement
        Where the feet were.
    platform
        How the platform moved meanwhile.
    """

    subject: VirtualSubject
    motion: Trajectory
    ground: Trajectory
    left: Trajectory
    placement: gait.FootPlacement
    platform: PlatformTrajectory


def simulate_walk(
    subject: VirtualSubject,
    steps: gait.Steps,
    belt: BeltRamp,
    platform: PlatformTrajectory,
    duration: float,
    rng: np.random.Generator,
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

    Returns
    -------
    Walk
        Motion, ground forces and foot placement; a second longer than the trial.
    """
    # a second longer than the trial, as the last tenths of a second depend on what follows
    time = np.arange(round((duration + 1.0) * balance.RATE_HZ) + 1) / balance.RATE_HZ
    height = float(_center(subject, subject.standing)[2])
    placement = _place(subject, steps, belt, platform, height, rng)
    pose = platform.pose(time)
    reference = _pattern(subject, placement, platform.slope(time), time, rng)
    extent = placement.extent(time)
    # steady where steps have nearly their final length
    walking, steady = np.minimum(extent, 1.0), extent > 0.99 * extent[-1]
    phase = placement.phase("right", time)

    def extended(q: Array) -> Array:
        return subject.extra_joints.extend(q, phase, walking)

    ahead = body.center_of_mass(subject.skeleton, extended(reference.T))[:, :2] - reference[:, :2]
    # shift the pressure along the feet so that the pelvis is above them as in the pattern
    pressure = balance.in_lab(placement.total_pressure(time), pose)[:, :2]
    pelvis = balance.balanced(pressure, height) - ahead
    shift = float(np.mean((reference[:, 0] - pelvis[:, 0])[steady]))
    placement = replace(placement, pressure_shift=shift)
    intended = balance.in_lab(placement.total_pressure(time), pose)[:, :2]
    reference[:, :2] = balance.balanced(intended, height) - ahead
    reference[:, 2] += balance.surface_height(pose, subject.standing[:2])

    # the correction of balance begins within half a second after the first step
    targets = balance.sole_targets(subject, placement, extended(reference.T), pose, time)
    plan = balance.Plan(
        subject,
        targets,
        intended,
        height,
        pose,
        phase,
        walking,
        steady,
        smooth_step((time - steps.contact[0]) / 0.5),
    )
    q = balance.keep_balance(plan, np.ascontiguousarray(reference.T), time)
    motion, rate_hz = fit_trajectory(q.T, balance.RATE_HZ), FORCES_PER_FRAME * balance.RATE_HZ
    oscillators = [body.Oscillator(mass, rate_hz) for mass in subject.wobbling]
    # the wrench of the ground follows from the motion; both feet share it
    total = np.concatenate(
        [body.ground_wrench(subject.skeleton, state, oscillators) for _, state in _blocks(motion)]
    )
    time = np.arange(len(total)) / rate_hz
    hip_height = float(subject.standing[INDEX["PelvisZ"]])
    left = left_wrench(total, placement, platform.pose(time), time, hip_height)
    ground, left_only = (fit_trajectory(wrench, rate_hz) for wrench in (total, left))
    return Walk(subject, motion, ground, left_only, placement, platform)


def _blocks(motion: Trajectory) -> Iterator[tuple[Array, tuple[Array, Array, Array]]]:
    """Give times at the rate of the forces, (N,) [s], and the motion with two derivatives there."""
    count = round(motion.duration * balance.RATE_HZ) * FORCES_PER_FRAME + 1
    size = 8192  # samples at a time, to bound memory
    for first in range(0, count, size):
        samples = np.arange(first, min(first + size, count))
        value, rate, second = (
            np.ascontiguousarray(motion.at_knots(samples / FORCES_PER_FRAME, order).T)
            for order in range(3)
        )
        yield samples / (FORCES_PER_FRAME * balance.RATE_HZ), (value, rate, second)


def _center(subject: VirtualSubject, q: Array) -> Array:
    """Give the centre of mass in a posture (46,), (3,) [m]."""
    still = np.zeros(1)
    full = subject.extra_joints.extend(q[:, None], still, still)
    return np.asarray(body.center_of_mass(subject.skeleton, full)[0])


def _place(
    subject: VirtualSubject,
    steps: gait.Steps,
    belt: BeltRamp,
    platform: PlatformTrajectory,
    height: float,
    rng: np.random.Generator,
) -> gait.FootPlacement:
    """Choose where the feet come down: forward so that mid-stance is under the person."""
    parameters, size = subject.step_parameters, gait.size_of(subject.standing)
    sideways = gait.place_sideways(steps, parameters, height, platform.sway, rng)
    step_s = gait.step_time(parameters, belt.speed_mps)
    contact = steps.contact
    # mid-stance: half-way between foot off and contact of the other foot
    middle = (
        np.append(contact[0], steps.off[:-1]) + np.append(contact[1:], contact[-1] + step_s)
    ) / 2
    # under the standing person at mid-stance, by the pattern's place of the foot at contact and by
    # how far the belt carries it until then
    slope, pose = platform.slope(contact), platform.pose(contact)
    forward = (subject.standing[0] - pose.position[:, 0]) / np.cos(slope)
    forward -= size * (gait.GAIT.stance * gait.STEP_M - gait.foothold(slope))
    forward += belt.travelled(middle) - belt.travelled(contact)
    deviation = np.clip(
        rng.normal(size=len(contact)), -gait.GAIT.largest_deviation, gait.GAIT.largest_deviation
    )
    forward += parameters.forward_sd * deviation
    place = np.column_stack([forward, sideways])
    ahead = float(_center(subject, subject.t_pose)[0] - subject.soles["left"].standing[0])
    return gait.FootPlacement(subject.soles, steps, place, belt, gait.STEP_M * size, step_s, ahead)


def _pattern(
    subject: VirtualSubject,
    placement: gait.FootPlacement,
    slope: Array,
    time: Array,
    rng: np.random.Generator,
) -> Array:
    """Give the person's gait pattern without regard to feet and balance, (T, 46)."""
    # the arms are lowered in the second half of the time before walking
    begin, duration = (fraction * placement.steps.contact[0] for fraction in (0.48, 0.35))
    lowered = smooth_step((time - begin) / duration)[:, None]
    extent = placement.extent(time)
    walking = np.minimum(extent, 1.0)[:, None]
    # the mean pattern, with the person's own range and mean angles
    q = subject.t_pose + lowered * (subject.standing - subject.t_pose)
    mean = gait.posture(placement.phase("right", time), extent, slope, subject.standing)
    q += (mean - subject.standing) * subject.gain + walking * subject.offset
    # slow variations: white noise through a Gaussian, scaled to a standard deviation of 1
    wander = gaussian_filter1d(
        rng.normal(size=q.shape), STYLE.wander_time * balance.RATE_HZ, axis=0
    )
    wander *= np.sqrt(2 * np.sqrt(np.pi) * STYLE.wander_time * balance.RATE_HZ)
    q += walking * subject.wander * wander
    # a knee below the least flexion is bent to it, by a smooth maximum: (x + √(x² + a²)) / 2
    for knee in (INDEX["RKneeFlexion"], INDEX["LKneeFlexion"]):
        excess = q[:, knee] - STYLE.least_knee_flexion
        more = (np.hypot(excess, STYLE.least_knee_flexion / 2) - excess) / 2
        q[:, knee] += walking[:, 0] * more
    return q


def left_wrench(
    total: Array, placement: gait.FootPlacement, pose: PlatformPose, time: Array, height: float
) -> Array:
    """Give the wrench on the left foot; the right one carries the rest.

    Parameters
    ----------
    total
        Of both feet, lab axes about the lab origin, (T, 6) [N, N·m].
    placement
        Where the feet are, and how they share the weight.
    pose
        The platform's.
    time
        (T,) [s].
    height
        Height of the centre of mass above the feet, roughly [m].

    Returns
    -------
    Array
        Action on the subject, lab axes about the lab origin, (T, 6) [N, N·m].

    Notes
    -----
    In single support the stance foot carries all. In double support the weight is transferred
    smoothly; the total's centre of pressure is split into one under each foot, and each foot's
    force is inclined from there towards the centre of mass as the total is from its own centre of
    pressure, so that the leading foot brakes and the trailing foot pushes; the free moment is
    shared in proportion to the weight.
    """
    on_platform, fraction = _on_platform(total, pose), placement.left_share(time)
    shear, vertical = on_platform[:, :2], on_platform[:, 2:3]
    pressure = balance.pressure_on_platform(total, pose)
    error = pressure - placement.total_pressure(time)
    # each foot's shear, inclined from its own pressure towards the centre of mass; its moment
    shears, places, moments = [], [], []
    for side, part in (("left", fraction), ("right", 1 - fraction)):
        place = placement.pressure(side, time) + error
        inclined = vertical * (pressure - place) / height
        force = part[:, None] * (shear + inclined)
        moments.append(place[:, 0] * force[:, 1] - place[:, 1] * force[:, 0])
        shears.append(force)
        places.append(place)
    # what the total's vertical moment has beyond both forces at their pressures is shared by weight
    free_moment = on_platform[:, 5] - moments[0] - moments[1]
    weight, (x, y) = fraction * on_platform[:, 2], places[0].T
    moment = moments[0] + fraction * free_moment
    left = np.column_stack([shears[0], weight, y * weight, -x * weight, moment])
    left[fraction == 0] = 0.0
    return np.asarray(transform_wrench(left, pose.rotation, pose.position))


def _on_platform(wrench: Array, pose: PlatformPose) -> Array:
    """Bring wrenches about the lab origin to the platform's frame about its origin, (T, 6)."""
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    origin = (to_platform @ pose.position[..., None])[..., 0]
    return np.asarray(transform_wrench(wrench, to_platform, -origin))


def foot_wrenches(walk: Walk, time: Array) -> dict[str, Array]:
    """Give the wrench on each foot.

    Parameters
    ----------
    walk
        The walk.
    time
        When, (T,) [s].

    Returns
    -------
    dict of str to Array
        "left" and "right" -> action on the subject, lab axes about the lab origin, (T, 6) [N,
        N·m]. Their sum is what the equations of motion require, to rounding.
    """
    total, left = walk.ground.at(time), walk.left.at(time)
    # exactly nothing on a foot in the air, where interpolation would leave a little
    fraction = walk.placement.left_share(time)
    left[fraction == 0] = 0.0
    left[fraction == 1] = total[fraction == 1]
    return {"left": left, "right": total - left}


def foot_events(walk: Walk, duration_s: float) -> tuple[Event, ...]:
    """Give when each foot really strikes and leaves the ground.

    Parameters
    ----------
    walk
        The walk.
    duration_s
        Of the trial [s].

    Returns
    -------
    tuple of Event
        In order of time: where the vertical force on a foot passes 20 N, to 0.1 ms.
    """
    events, contact_n = [], 20.0  # the definition
    # intervals of 10 ms in which the force passes that value, divided into ten steps: a foot is
    # loaded and unloaded in a tenth of a second
    coarse = np.linspace(0.0, duration_s, round(duration_s * 100.0) + 1)
    within = np.linspace(0.0, coarse[1] - coarse[0], 10 + 1)
    for side, wrench in foot_wrenches(walk, coarse).items():
        passing = np.flatnonzero(np.diff(wrench[:, 2] > contact_n))
        time = coarse[passing, None] + within
        force = foot_wrenches(walk, time.ravel())[side][:, 2].reshape(time.shape)
        # the force is a straight line within a step
        for instants, above in zip(time, force - contact_n, strict=True):
            for k in np.flatnonzero((above[:-1] > 0) != (above[1:] > 0)):
                step = instants[k + 1] - instants[k]
                at = instants[k] + step * above[k] / (above[k] - above[k + 1])
                events.append(Event(float(at), "foot_off" if above[k] > 0 else "foot_strike", side))
    return tuple(sorted(events, key=lambda event: event.time))


def plate_wrenches(walk: Walk, time: Array) -> list[Array]:
    """Give the wrench of the person on each plate.

    Parameters
    ----------
    walk
        The walk.
    time
        When, (N,) [s].

    Returns
    -------
    list of Array
        Left and right plate, in the moving platform's frame about its origin, (N, 6) each [N,
        N·m]. A foot is on one plate for the whole of a step, even if it reaches beyond the
        middle.
    """
    pose = walk.platform.pose(time)
    plates = [np.zeros((len(time), 6)), np.zeros((len(time), 6))]
    for side, wrench in foot_wrenches(walk, time).items():
        on_platform = _on_platform(wrench, pose)
        on_left = walk.placement.lateral(side, time) > 0
        plates[0] += np.where(on_left[:, None], on_platform, 0.0)
        plates[1] += np.where(on_left[:, None], 0.0, on_platform)
    return plates


def leg_moments(walk: Walk, time: Array) -> dict[str, Array]:
    """Give the true internal moments of the legs' coordinates.

    Parameters
    ----------
    walk
        How the person moved.
    time
        When, (T,) [s].

    Returns
    -------
    dict of str to Array
        Coordinate, such as "RHipFlexion" -> moment about its axis, positive in the direction in
        which it grows, (T,) [N·m].
    """
    rate_hz = FORCES_PER_FRAME * balance.RATE_HZ
    oscillators = [body.Oscillator(mass, rate_hz) for mass in walk.subject.wobbling]
    parts = [
        body.moments_of(walk.subject.skeleton, state, foot_wrenches(walk, at), oscillators)
        for at, state in _blocks(walk.motion)
    ]
    moments = fit_trajectory(np.concatenate(parts, axis=1).T, rate_hz).at(time)
    return dict(zip(body.LEG_COORDINATES, moments.T, strict=True))
