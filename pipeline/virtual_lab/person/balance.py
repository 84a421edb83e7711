"""Balance: legs that reach the feet, and a centre of mass above its centre of pressure."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_banded
from scipy.ndimage import gaussian_filter1d

from compensation.platform import PlatformPose
from hbm.coordinates import INDEX
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.virtual_lab.person import body, gait
from pipeline.virtual_lab.person.subject import VirtualSubject

JOINT_WEIGHTS: Final = {
    "HipFlexion": 3e-4,
    "HipAbduction": 3e-4,
    "HipInternalRotation": 1e-3,
    "KneeFlexion": 1e-3,
    "AnklePlantarFlexion": 1e-4,
    "FootPronation": 1e-4,
}
"""Weights of the legs' coordinates towards their reference [m²/rad² per unit weight of a sole's
points]; chosen, small against the soles'. The knee's is larger, for a leg that is nearly straight
would otherwise bend by jerks."""


@dataclass(frozen=True, slots=True, eq=False)
class SoleTarget:
    """Where four points of a foot should be: heel, ball inside and outside, and near the ankle.

    Attributes
    ----------
    on_foot
        Their places in the foot's frame, (4, 3) [m].
    places
        Where they should be in the lab, (3, 4, T) [m].
    weight
        (4, T).
    """

    on_foot: Array
    places: Array
    weight: Array

    @classmethod
    def of(cls, sole: gait.Sole, rotation: Array, position: Array, weight: Array) -> "SoleTarget":
        """Give the target of a sole's pose, (T, 3, 3) and (T, 3) [m], and weights, (T, 4)."""
        on_foot, origin = sole.foot_pose(rotation, position)
        # four points that are not in a plane hold the sole in all directions [m]
        ball, aside = sole.ball, 0.04
        on_sole = np.array([[sole.heel, 0, 0], [ball, aside, 0], [ball, -aside, 0], [0, 0, 0.08]])
        held = (on_sole - sole.origin) @ sole.rotation
        places = np.einsum("tij,kj->ikt", on_foot, held) + origin.T[:, None]
        return cls(held, places, np.ascontiguousarray(weight.T))

    def frames(self, part: slice) -> "SoleTarget":
        """Give the target in some frames."""
        return SoleTarget(self.on_foot, self.places[..., part], self.weight[:, part])


def solve_legs(
    subject: VirtualSubject,
    reference: Array,
    targets: Mapping[str, SoleTarget],
    start: Array,
    effort: tuple[float, int],
) -> Array:
    """Find the joint angles of the legs with which the soles are where they should be.

    Parameters
    ----------
    subject
        Whose legs.
    reference
        Coordinates to approach, (46, T); pelvis, trunk, head and arms are kept, the legs' are
        approached where the soles leave a choice or cannot be reached.
    targets
        Side -> target of its sole.
    start
        Coordinates to start from, (46, T).
    effort
        Weight that keeps the pelvis at its height, m² per m² of the soles' points; iterations at
        most.

    Returns
    -------
    Array
        Coordinates, (46, T).

    Notes
    -----
    Least squares over four points of each sole by Gauss–Newton. Each leg's six angles are
    eliminated from the normal equations, which leaves one for the pelvis' height.
    """
    solved = start.copy()
    for part in body.chunks(reference.shape[1]):
        now = {side: target.frames(part) for side, target in targets.items()}
        solved[:, part] = _solve(subject, reference[:, part], now, start[:, part], *effort)
    return solved


def _solve(
    subject: VirtualSubject,
    reference: Array,
    targets: Mapping[str, SoleTarget],
    start: Array,
    height_weight: float,
    iterations: int,
) -> Array:
    # damping, largest step and step at which the iteration ends [rad and m]
    damping, largest_step, tolerance = 1e-6, 0.2, 1e-4
    # the pelvis only rises: its frame is computed once, at height 0
    q, height = reference.copy(), INDEX["PelvisZ"]
    q[height] = 0.0
    pelvis = body.frames(subject.skeleton, (q,), ["pelvis"])["pelvis"]
    solved = [height, *(INDEX[letter + name] for letter in "RL" for name in JOINT_WEIGHTS)]
    q[solved] = start[solved]
    prior = np.array(list(JOINT_WEIGHTS.values()))[:, None]
    for _ in range(iterations):
        # of the pelvis' height alone, to which each leg adds what its angles leave: S r = right
        total = np.full(q.shape[1], height_weight + damping)
        right = height_weight * (reference[height] - q[height])
        legs = []
        for side, target in targets.items():
            letter = side[0].upper()
            rows = [INDEX[letter + name] for name in JOINT_WEIGHTS]
            jacobian, error = _jacobian(subject, pelvis, q, letter, target)
            # normal equations of the leg's angles: Jᵀ W J and Jᵀ W e, with the prior towards q
            weighted = jacobian * target.weight
            square = np.einsum("aikt,bikt->abt", weighted, jacobian)
            square[range(6), range(6)] += prior + damping
            gradient = np.einsum("aikt,ikt->at", weighted, error)
            gradient += prior * (reference[rows] - q[rows])
            # a rise of the pelvis lifts all points of the sole; the leg's angles are eliminated
            coupling = weighted[:, 2].sum(axis=1)
            solution = _solve_symmetric(square, np.stack([gradient, coupling], axis=1))
            total += target.weight.sum(axis=0) - (coupling * solution[:, 1]).sum(axis=0)
            upward = (target.weight * error[2]).sum(axis=0)
            right += upward - (coupling * solution[:, 0]).sum(axis=0)
            legs.append((rows, solution))
        # the rise first, then the angles that go with it
        rise = np.clip(right / total, -largest_step, largest_step)
        q[height] += rise
        change = float(np.abs(rise).max())
        for rows, solution in legs:
            step = np.clip(solution[:, 0] - solution[:, 1] * rise, -largest_step, largest_step)
            q[rows] += step
            change = max(change, float(np.abs(step).max()))
        if change < tolerance:
            break
    return q


def _jacobian(
    subject: VirtualSubject, pelvis: body.Frame, q: Array, letter: str, target: SoleTarget
) -> tuple[Array, Array]:
    """Give how a sole's points move with the leg's angles, (6, 3, 4, T), and their error."""
    skeleton, origin = subject.skeleton, pelvis.origin.copy()
    origin[2] += q[INDEX["PelvisZ"]]
    frame = body.Frame(pelvis.rotation, origin, pelvis.acceleration)
    knee = subject.extra_joints.of_knee(letter, q[INDEX[letter + "KneeFlexion"]])
    axes, places, segment = [], [], "pelvis"
    # axes and places of the leg's angles from hip to foot; the knee's other motion follows these
    for k, link in _LEGS[letter]:
        if link.segment != segment:
            segment = link.segment
            frame = body.placed(frame, skeleton.offsets[segment])
        name = link.name[1:]
        if name in JOINT_WEIGHTS:
            axes.append(skeleton.axes[k] @ frame.rotation[0])
            places.append(frame.origin)
            value = q[body.COLUMN[link.name]]
        else:
            value = knee[body.KNEE.index(name)]
        frame = body.moved(frame, link, skeleton.axes[k], (value,))
    position = np.stack([frame.point(point) for point in target.on_foot], axis=1)
    # a point moves by axis × (point - joint) per angle
    jacobian = np.empty((len(axes), *position.shape))
    for row, axis, place in zip(jacobian, axes, places, strict=True):
        row[:] = np.cross(axis[:, None], position - place[:, None], axis=0)
    return jacobian, target.places - position


def _solve_symmetric(matrix: Array, right: Array) -> Array:
    """Solve positive definite systems (N, N, T) for right sides (N, M, T) by Cholesky's method."""
    count = len(matrix)
    lower, solution = np.zeros_like(matrix), right.copy()
    # A = L Lᵀ column by column, with L y = b on the way; then Lᵀ x = y backwards
    for j in range(count):
        below = matrix[j:, j] - (lower[j:, :j] * lower[j, :j]).sum(axis=1)
        lower[j:, j] = below / np.sqrt(below[0])
        solution[j] -= (lower[j, :j, None] * solution[:j]).sum(axis=0)
        solution[j] /= lower[j, j]
    for j in reversed(range(count)):
        solution[j] -= (lower[j + 1 :, j, None] * solution[j + 1 :]).sum(axis=0)
        solution[j] /= lower[j, j]
    return solution


_LEGS: Final = {
    letter: [
        (k, link)
        for k, link in enumerate(body.LINKS)
        if link.name.startswith(letter) and link.name[1:] in (*JOINT_WEIGHTS, *body.KNEE)
    ]
    for letter in "RL"
}
"""The coordinates from the pelvis to each foot."""


RATE_HZ: Final = 100.0
"""Sampling rate at which walks are computed: the cameras'."""


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
        arrays = ("pressure", "phase", "walking", "steady", "corrected")
        return replace(
            self,
            targets={side: target.frames(part) for side, target in self.targets.items()},
            pose=PlatformPose(self.pose.rotation[part], self.pose.position[part]),
            **{name: getattr(self, name)[part] for name in arrays},
        )

    def moved(self, q: Array, rate_hz: float) -> Array:
        """Give all coordinates (55, T) of a person who moves by (46, T), smoothed.

        The smoothing Gaussian's amplitude response is 1/√2 at 6 Hz: joint motion of walking is
        below it.
        """
        sigma = np.sqrt(np.log(2) / 2) / (2 * np.pi * 6.0) * rate_hz
        smooth = gaussian_filter1d(q, sigma, axis=1, mode="nearest")
        return self.subject.extra_joints.extend(smooth, self.phase, self.walking)


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
    # corrections are found for every second sample: the motion of a centre of mass is slow
    every = 2
    subject, coarse, rate_hz = plan.subject, plan.every(every), RATE_HZ / every
    # weight of the pelvis' height, and iterations: first, from the gait pattern, the legs show how
    # high the pelvis can be; later each correction starts from the solution before
    first, later = (0.1, 10), (1.0, 2)
    # by how much the pelvis has to move, [m], and coordinates near the solution
    q = np.ascontiguousarray(reference[:, ::every])
    shifted, shift = q.copy(), np.zeros((3, q.shape[1]))
    fade = coarse.corrected.copy()
    fade[-int(rate_hz * (1 / 6)) :] = 0.0  # what follows is unknown
    # four corrections; chosen, enough for the pressure to stay under the feet
    for correction in range(4):
        effort = later if correction else first
        q = solve_legs(subject, shifted, coarse.targets, q, effort)
        if correction == 0:
            shift[2] = coarse.walking * (q - shifted)[2, coarse.steady].mean()
        motion = _differentiated(coarse.moved(q, rate_hz), rate_hz)
        oscillators = [body.Oscillator(mass, rate_hz) for mass in subject.wobbling]
        wrench = body.ground_wrench(subject.skeleton, motion, oscillators)
        pressure = in_lab(pressure_on_platform(wrench, coarse.pose), coarse.pose)[:, :2]
        error = np.clip(np.nan_to_num(coarse.pressure - pressure), -0.2, 0.2)
        # a little more than the error, as the body answers less than a point mass; chosen
        shift[:2] += 1.2 * balanced(fade[:, None] * error, coarse.height, rate_hz).T
        shifted[:3] = reference[:3, ::every] + shift

    # the same for every sample
    reference = reference.copy()
    reference[:3] += CubicSpline(time[::every], shift, axis=1)(time)
    q = CubicSpline(time[::every], q, axis=1)(time)
    q = solve_legs(subject, reference, plan.targets, q, later)
    return plan.moved(q, RATE_HZ)


def _differentiated(values: Array, rate_hz: float) -> tuple[Array, Array, Array]:
    """Give values (C, T) with their first and second derivatives, to fourth order."""
    # central differences of five points
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
    # second differences of c make a tridiagonal system; at both ends the mass has no speed
    stiffness = height / GRAVITY_MPS2 * rate_hz**2
    bands = np.empty((3, len(pressure)))
    bands[0], bands[1], bands[2] = -stiffness, 1 + 2 * stiffness, -stiffness
    bands[1, [0, -1]] = 1 + stiffness
    return np.asarray(solve_banded((1, 1), bands, pressure))


def pressure_on_platform(wrench: Array, pose: PlatformPose) -> Array:
    """Give the centre of pressure of a wrench on the platform's surface, in its frame, (T, 2) [m].

    The wrench is in lab axes about the lab origin, (T, 6) [N, N·m].
    """
    # to the platform's axes about its origin, where the surface is z = 0: x = -My/Fz, y = Mx/Fz
    to_platform = np.swapaxes(pose.rotation, 1, 2)
    force = (to_platform @ wrench[:, :3, None])[..., 0]
    moment = wrench[:, 3:] - np.cross(pose.position, wrench[:, :3])
    moment = (to_platform @ moment[..., None])[..., 0]
    return np.column_stack([-moment[:, 1], moment[:, 0]]) / force[:, 2:]


def surface_height(pose: PlatformPose, place: Array) -> Array:
    """Give the height of the platform's surface at a place (2,) [m] in the lab, (T,) [m]."""
    # height of the plane through the platform's origin: n · (p - o) = 0
    normal, away = pose.rotation[:, :, 2], place - pose.position[:, :2]
    sideways = np.sum(normal[:, :2] * away, axis=1)
    return np.asarray(pose.position[:, 2] - sideways / normal[:, 2])


def in_lab(points: Array, pose: PlatformPose) -> Array:
    """Transform points of the platform, (T, 3) or, on its surface, (T, 2), to the lab, (T, 3)."""
    if points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    return pose.to_lab(points)


def sole_targets(
    subject: VirtualSubject,
    placement: gait.FootPlacement,
    reference: Array,
    pose: PlatformPose,
    time: Array,
) -> dict[str, SoleTarget]:
    """Give the soles' poses in the lab and their weights: rolling in stance, free in swing.

    Parameters
    ----------
    subject
        Who walks.
    placement
        Where the feet come down.
    reference
        Coordinates of the gait pattern, (55, T), which the feet follow in swing.
    pose
        The platform's pose at the same times.
    time
        (T,) [s], at `RATE_HZ`.

    Returns
    -------
    dict of str to SoleTarget
        By side.
    """
    targets = {}
    names = [sole.segment for sole in placement.soles.values()]
    feet = body.segment_poses(subject.skeleton, reference, names)
    left = placement.left_share(time)
    for (side, sole), (_, ankle) in zip(placement.soles.items(), feet, strict=True):
        phase, extent = placement.phase(side, time), placement.extent(time)
        pitch, _ = gait.foot_angles(phase)
        pitch = pitch * extent
        heading = placement.heading(side, time)
        rotation = pose.rotation @ gait.orientation(pitch, heading)
        # in swing the foot's place is that of the gait pattern, in stance that of a rolling foot
        away = ankle - (rotation @ sole.origin) - pose.position
        swinging = (np.swapaxes(pose.rotation, 1, 2) @ away[..., None])[..., 0]
        rolling = gait.rolled(sole, pitch, heading)
        path = _path(placement, side, swinging, rolling, time)
        load = left if side == "left" else 1 - left
        # the shoe yields; the sole's height is that of standing, with half of the weight on a foot
        path[:, 2] -= subject.sole_yield_m * (load - 0.5)
        position = in_lab(path, pose)
        walking = np.minimum(extent, 1.0)[:, None]
        weight = 1 - walking * (1 - gait.sole_weights(pitch, phase))
        targets[side] = SoleTarget.of(sole, rotation, position, weight)
    return targets


def _path(
    placement: gait.FootPlacement, side: str, swinging: Array, rolling: Array, time: Array
) -> Array:
    """Join stances and swings: a swing ends where the next stance begins, (T, 3) [m].

    ``swinging`` is the sole's place in the gait pattern, ``rolling`` its displacement while it
    rolls over the belt, both on the platform, (T, 3) [m].
    """
    end, steps = len(time) - 1, placement.steps
    path = np.empty_like(swinging)
    departure, left_at = None, 0
    # left steps are even and begin with standing; the right foot stands before its first step
    first_number = 0 if side == "left" else -1
    for number in range(first_number, len(steps.contact), 2):
        contact = 0.0 if number == first_number else steps.contact[number]
        if number >= 0:
            release = placement.release(number)
        else:  # the right foot, which has stood, is released when walking begins
            released = (gait.GAIT.leaving[0] - 0.5) * steps.overlap / (gait.GAIT.stance - 0.5)
            release = float(steps.contact[0]) + released * placement.step_s
        first, last = int(np.ceil(contact * RATE_HZ)), int(np.floor(release * RATE_HZ))
        stance = slice(min(first, end), min(last, end) + 1)
        held = rolling[stance] + np.pad(
            placement.anchor(side, np.full(len(time[stance]), number), time[stance]),
            ((0, 0), (0, 1)),
        )
        # smoothly from where the last stance left the pattern to where the next begins: 3u² - 2u³
        if departure is not None:
            swing = np.arange(left_at, min(first, end + 1))
            u = ((swing - left_at) / (first - left_at))[:, None]
            arrival = held[0] - swinging[stance.start]
            blend = u * u * (3 - 2 * u)
            path[swing] = swinging[swing] + departure + blend * (arrival - departure)
        if first > end:
            break
        path[stance] = held
        left_at = stance.stop - 1
        departure = held[-1] - swinging[left_at]
    return path
