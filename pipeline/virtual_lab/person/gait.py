"""Gait: the mean pattern of adults, when and where the feet come down, and how their soles roll.

Timing is the person's own; places follow from balance. Sideways a foot is placed a constant
distance outside of where the extrapolated centre of mass will be when weight is transferred (Hof
2008, Hum Mov Sci 27:112): the person walks straight on, and when the platform sways, the narrow,
crossed or wide steps that follow result from this rule.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, PchipInterpolator

from hbm.coordinates import INDEX, TREE
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.virtual_lab.machine.platform import BeltRamp, smooth_step

FOOT: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "foot")
GAIT: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "gait")


def roll_over(phase: Array) -> Array:
    """Give the place of the centre of pressure between heel (0) and toe tip (1), (T,)."""
    return np.asarray(np.interp(np.clip((phase % 1) / GAIT.stance, 0, 1), *GAIT.roll_over))


def sole_weights(pitch: Array, phase: Array) -> Array:
    """Give how closely a sole's points follow their path: weights of the leg's inverse kinematics.

    Parameters
    ----------
    pitch
        How far the foot points down, (T,) [rad].
    phase
        Phase of the foot's own gait cycle, (T,).

    Returns
    -------
    Array
        Weights of heel, inner and outer ball, and ankle, (T, 4). The heel is free where only the
        ball is on the floor, and the ball where only the heel is; a swinging foot has little weight
        altogether.
    """
    # the heel rises as the foot points down, the ball as it points up, and is then free
    low, high = np.radians(GAIT.releasing)
    heel, ball = (
        1 - (1 - GAIT.free_end_weight) * smooth_step((angle - low) / (high - low))
        for angle in (pitch, -pitch)
    )
    # in swing, between release and arrival, the whole sole follows its path only a little
    cycle = phase % 1
    released, arrived = (
        smooth_step((cycle - a) / (b - a)) for a, b in (GAIT.leaving, GAIT.arriving)
    )
    whole = 1 - (1 - GAIT.swing_weight) * (released - arrived)
    ends = np.stack([heel, ball, ball, np.minimum(heel, ball)], axis=1)
    return np.asarray(whole[:, None] * ends)


STEP_M: Final = GAIT.speed * GAIT.stride / 2
"""Step length of the mean gait pattern (``tests/virtual_gait``)."""
_FEET: Final = ("foot pitch", "foot progression", "foothold")
"""What the table has beside coordinates."""


def posture(phase: Array, extent: Array, slope: Array, standing: Array) -> Array:
    """Give the coordinates of walking in the mean pattern of healthy adults.

    Parameters
    ----------
    phase
        Phase of the right gait cycle from initial contact, (T,), in gait cycles.
    extent
        Step length relative to that of the norms, (T,); 0 for standing. The motion is scaled by it.
    slope
        How steeply the belt rises forward, (T,) [rad].
    standing
        The person's coordinates in standing with the arms hanging, (46,).

    Returns
    -------
    Array
        Coordinates, (T, 46) [rad and m]. The pelvis moves about its place in standing.
    """
    change = np.zeros((len(phase), len(standing)))
    # the left side does what the right side does half a gait cycle before
    polynomials = _polynomials(slope)
    bases = {side: _basis(phase + (0.5 if side == "L" else 0.0)) for side in " RL"}
    for name, (about_standing, _) in _table()[1].items():
        if name in _FEET:
            continue
        for side in "RL" if name.startswith("R") else " ":
            i = INDEX[name if side == " " else side + name[1:]]
            value = _evaluate(name, bases[side], polynomials)
            if not TREE[i].translates:
                value = np.radians(value)
            from_standing = about_standing or name in ("PelvisX", "PelvisY")
            change[:, i] = value - (0.0 if from_standing else standing[i])
    # displacements of the pelvis are scaled to the person by leg length
    size = size_of(standing)
    change[:, :2] *= size
    change[:, 2] *= size * extent  # the height of a pendulum changes with the square of its angle
    return np.asarray(standing + extent[:, None] * change)


def size_of(standing: Array) -> float:
    """Give leg length relative to that of the person the coefficients were fitted for."""
    return float(standing[INDEX["PelvisZ"]] / GAIT.hip_height)


def foot_angles(phase: Array) -> tuple[Array, Array]:
    """Give a foot's pitch (down) and progression (inwards) over its gait cycle, (T,) each [rad]."""
    basis, level = _basis(phase), _polynomials(np.zeros_like(phase))
    pitch, progression = (np.radians(_evaluate(name, basis, level)) for name in _FEET[:2])
    return pitch, progression


def foothold(slope: Array) -> Array:
    """Give how far ahead of the pelvis' mean place the ankle is at initial contact, (T,) [m]."""
    return _evaluate("foothold", _basis(np.zeros_like(slope)), _polynomials(slope))


def _basis(phase: Array) -> tuple[Array, Array]:
    """Give the cosines and sines of all harmonics, (T, K) each."""
    harmonics = next(iter(_table()[1].values()))[1].shape[1]
    angle = 2 * np.pi * np.outer(phase, np.arange(harmonics))
    return np.cos(angle), np.sin(angle)


def _evaluate(name: str, basis: tuple[Array, Array], polynomials: Array) -> Array:
    """Evaluate a coordinate at phases and slopes, given what is common to all coordinates, (T,)."""
    (cosines, sines), (cosine, sine) = np.moveaxis(_table()[1][name][1], 2, 0), basis
    # Fourier series at every slope of the table, then the polynomial through these
    by_slope = cosine @ cosines.T + sine @ sines.T
    return np.asarray(np.sum(by_slope * polynomials, axis=1))


def _polynomials(slope: Array) -> Array:
    """Give the Lagrange polynomials over the slopes of the table, (T, slopes)."""
    at = np.degrees(slope)[:, None]
    nodes = _table()[0].tolist()
    out = np.ones((len(slope), len(nodes)))
    for j, node in enumerate(nodes):
        for other in nodes:
            if other != node:
                out[:, j] *= (at[:, 0] - other) / (node - other)
    return out


@cache
def _table() -> tuple[Array, dict[str, tuple[bool, Array]]]:
    """Give the slopes [deg]; by name whether values add to standing, cosines and sines.

    The last are (slopes, K, 2).
    """
    path = Path(__file__).with_name("gait.csv")
    rows = pd.read_csv(path, comment="#")
    slopes, at = np.unique(rows["slope_deg"].to_numpy(float), return_inverse=True)
    rows = rows.assign(at=at)
    count = int(rows["harmonic"].max()) + 1
    coefficients: dict[str, tuple[bool, Array]] = {}
    for name, terms in rows.groupby("coordinate", sort=False):
        values = np.zeros((len(slopes), count, 2))
        places = terms["at"].to_numpy(), terms["harmonic"].to_numpy()
        values[places] = terms[["cosine", "sine"]].to_numpy()
        coefficients[str(name)] = bool((terms["about"] == "standing").all()), values
    return slopes, coefficients


NORMAL_OVERLAP: Final = 2 * (GAIT.stance - 0.5)
"""Double support as a share of step time at 1.3 m/s."""


@dataclass(frozen=True, slots=True)
class StepParameters:
    """A person's spatiotemporal parameters, with their variability; the defaults are typical.

    Attributes
    ----------
    step_m
        Length of a step at 1.3 m/s [m].
    width_m
        Sideways distance between the centres of pressure of both feet [m].
    time_sd, forward_sd, side_sd
        Standard deviations from step to step: duration relative to its mean, place forward and
        sideways [m].
    """

    step_m: float = STEP_M
    width_m: float = 0.15
    time_sd: float = 0.015
    forward_sd: float = 0.008
    side_sd: float = 0.003


@dataclass(frozen=True, slots=True)
class Steps:
    """Times of steps, alternately left (even) and right (odd).

    Attributes
    ----------
    contact
        Initial contacts, (S,) [s]; the first is when walking begins, with the left foot on the
        floor already.
    off
        When each foot leaves the floor again, (S,) [s].
    overlap
        Double support as a share of step time.
    """

    contact: Array
    off: Array
    overlap: float


def step_time(parameters: StepParameters, speed_mps: float) -> float:
    """Give the mean duration of a step [s].

    Notes
    -----
    Step length grows with the square root of speed, as cadence does: their ratio, the walk ratio,
    is constant (Sekiya and Nagasaki 1998, Gait Posture 7:225).
    """
    return parameters.step_m * float(np.sqrt(speed_mps / GAIT.speed)) / speed_mps


def schedule(
    parameters: StepParameters,
    speed_mps: float,
    start: float,
    stop: float,
    rng: np.random.Generator,
) -> Steps:
    """Choose the times of the steps.

    Parameters
    ----------
    parameters
        The person's spatiotemporal parameters.
    speed_mps
        Belt speed [m/s].
    start, stop
        Beginning of walking, and end of the trial [s]; steps continue a little longer.
    rng
        Source of the variability.

    Returns
    -------
    Steps
        Times of contact and foot off.
    """
    mean = step_time(parameters, speed_mps)
    # a tenth and six steps more than expected, so that none is missing at the end
    count = int(np.ceil((stop - start) / mean * (1 + 0.1))) + 6
    deviation = np.clip(rng.normal(size=count), -GAIT.largest_deviation, GAIT.largest_deviation)
    duration = mean * (1 + parameters.time_sd * deviation)
    contact = start + np.append(0.0, np.cumsum(duration))
    # double support as a share of step time: the slower, the more
    overlap = NORMAL_OVERLAP + GAIT.overlap_by_speed * (GAIT.speed - speed_mps)
    overlap = float(np.clip(overlap, GAIT.least_overlap, GAIT.largest_overlap))
    # a foot leaves the floor when double support after the other's contact is over
    off = np.append(contact[1:], contact[-1] + mean) + overlap * np.append(duration, mean)
    return Steps(contact, off, overlap)


def phase_of(steps: Steps, time: Array) -> Array:
    """Give the phase of the right gait cycle at which the gait pattern is evaluated, (T,).

    It is an integer at the right foot's contacts and a half more at the left's; between them it is
    scaled so that double support has the same phases at all speeds.
    """
    numbers = CubicSpline(steps.contact, np.arange(len(steps.contact)) - 1.0)(time)
    # contacts and the ends of double support, in steps: those of these steps on those of 1.3 m/s,
    # over three contacts, so that slopes are the same at both ends of a step
    contacts = np.array([-1.0, 0.0, 1.0])
    knots, normal = (
        np.append(np.sort(np.append(contacts, contacts[:2] + overlap)), 1 + overlap)
        for overlap in (steps.overlap, NORMAL_OVERLAP)
    )
    whole = np.floor(numbers)
    return np.asarray((whole + PchipInterpolator(knots, normal)(numbers - whole)) / 2)


def place_sideways(
    steps: Steps,
    parameters: StepParameters,
    height_m: float,
    sway: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Array:
    """Choose where the feet come down sideways.

    Parameters
    ----------
    steps
        Times of the steps.
    parameters
        The person's spatiotemporal parameters.
    height_m
        Height of the centre of mass [m].
    sway
        Sideways position of the platform at any times [s] -> [m].
    rng
        Source of the variability.

    Returns
    -------
    Array
        Places in the platform's frame, (S,) [m], left positive.

    Notes
    -----
    Linear inverted pendulum: with ``ω = √(g/h)`` the extrapolated centre of mass ``ξ = y + ẏ/ω``
    obeys ``ξ̇ = ω (ξ - p)`` about the centre of pressure ``p``, which moves with the platform and
    changes feet in the middle of double support.
    """
    # ω of the pendulum, and instants at which the pressure changes feet
    rate = np.sqrt(GRAVITY_MPS2 / height_m)
    duration = np.diff(steps.contact, append=2 * steps.contact[-1] - steps.contact[-2])
    change = steps.contact + steps.overlap / 2 * duration
    # with this distance outside of ξ, regular steps have the person's step width (Hof 2008)
    margin = parameters.width_m / (1 + np.mean(np.exp(rate * np.diff(change))))
    place = np.empty(len(change))
    place[0] = parameters.width_m / 2
    xi = place[0] - margin
    for k in range(1, len(place)):
        # ξ at the next change: e^(ωT) ξ - ω ∫ e^(ω(T-t)) p dt, sampled every 10 ms or so
        time = np.linspace(change[k - 1], change[k], 60)
        remaining = np.exp(rate * (change[k] - time))
        pressure = place[k - 1] + sway(time)
        xi = remaining[0] * xi - rate * np.trapezoid(remaining * pressure, time)
        # on the platform, outside of ξ, and further out where the person has drifted to that side
        here = xi - float(sway(change[k : k + 1])[0])
        outward = -1.0 if k % 2 else 1.0
        middle = (place[k - 1] + here) / 2
        place[k] = (
            here + outward * margin + GAIT.steering * middle + parameters.side_sd * rng.normal()
        )
    return place


SIDES: Final = ("left", "right")
OUTWARD: Final = {"left": 1.0, "right": -1.0}
UP: Final = np.array([0.0, 0.0, 1.0])
LEFT: Final = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class Sole:
    """One foot's sole.

    Its frame lies on the floor under the ankle of a flat foot: x along the foot, y left, z up.

    Attributes
    ----------
    segment
        Name of the foot's segment.
    rotation, origin
        The foot segment's frame in the sole's, (3, 3) and (3,) [m].
    toe_out
        Angle of the foot to the left in standing [rad].
    standing
        Where the sole's frame is in standing, (3,) [m].
    heel, ball, toe
        Places along x: heel, heads of the metatarsals, tip of the toes [m].
    outline
        The sole's polygon, (5, 2) [m].
    """

    segment: str
    rotation: Array
    origin: Array
    toe_out: float
    standing: Array
    heel: float
    ball: float
    toe: float
    outline: Array

    def foot_pose(self, rotation: Array, position: Array) -> tuple[Array, Array]:
        """Give the foot segment's pose from the sole's, both (T, 3, 3) and (T, 3) [m]."""
        return rotation @ self.rotation, position + rotation @ self.origin

    def from_foot(self, rotation: Array, position: Array) -> tuple[Array, Array]:
        """Give the sole's pose from the foot segment's, both (T, 3, 3) and (T, 3) [m]."""
        of_sole = rotation @ self.rotation.T
        return of_sole, position - of_sole @ self.origin


def sole_of(landmarks: Mapping[str, Array], rotation: Array, ankle: Array, side: str) -> Sole:
    """Find the sole of a person who stands with flat feet on the floor z = 0.

    Parameters
    ----------
    landmarks
        Where heel and metatarsal heads or toe are, by the names of the Human Body Model, (3,) [m].
    rotation, ankle
        Frame of the foot's segment, (3, 3) and (3,) [m].
    side
        "left" or "right".

    Returns
    -------
    Sole
        The foot's sole.
    """
    R, letter = rotation, side[0].upper()
    heel, outer = landmarks[letter + "HEE"], landmarks[letter + "MT5"]
    has_metatarsal = letter + "MT2" in landmarks
    inner = landmarks[letter + "MT2" if has_metatarsal else letter + "TOE"]
    along = inner - heel
    # the sole's frame: under the ankle on the floor, along the line from heel to metatarsal or toe
    toe_out = float(np.arctan2(along[1], along[0]))
    rotation = rotation_about(UP, toe_out)
    under = np.array([ankle[0], ankle[1], 0.0])
    h, i, o = ((p - under) @ rotation for p in (heel, inner, outer))
    toe = h[0] + (FOOT.toe_tip if has_metatarsal else 1.0) * (i[0] - h[0])
    # between the heads of second and fifth metatarsal; the second's place by that of the tip
    ball = (h[0] + (toe - h[0]) / FOOT.toe_tip + o[0]) / 2
    # heel left and right, toe tip, head of the fifth metatarsal, and the inside of the ball
    m, medial = FOOT.sole_margin, -OUTWARD[side]
    half_width = FOOT.half_width * abs(i[1] - o[1])
    outline = np.array(
        [
            [h[0] - m, h[1] + half_width + m],
            [toe + m, i[1] + medial * half_width],
            [h[0] - m, h[1] - half_width - m],
            [o[0] + m, o[1] - medial * m],
            [ball, i[1] + medial * (half_width + 2 * m)],
        ]
    )
    away = outline - outline.mean(axis=0)  # corners counter-clockwise
    return Sole(
        f"{side}_foot",
        rotation.T @ R,
        rotation.T @ (ankle - under),
        toe_out,
        under,
        float(h[0]),
        float(ball),
        float(toe),
        outline[np.argsort(np.arctan2(away[:, 1], away[:, 0]))],
    )


def orientation(pitch: Array, heading: Array) -> Array:
    """Give the orientation of soles that point down by a pitch and to the left by a heading.

    Both angles are (T,) [rad], the orientation is (T, 3, 3).
    """
    return rotation_about(UP, heading) @ rotation_about(LEFT, pitch)


def rolled(sole: Sole, pitch: Array, heading: Array) -> Array:
    """Give the displacement of the sole's frame while the foot rolls over the floor without slip.

    Parameters
    ----------
    sole
        The sole.
    pitch
        How far the foot points down, (T,) [rad]: on the heel where negative, flat at zero, on the
        ball and then the toes where positive.
    heading
        How far it points to the left, (T,) [rad].

    Returns
    -------
    Array
        The frame's origin from where it is when the foot is flat, (T, 3) [m].

    Notes
    -----
    A convex sole whose radius of curvature is concentrated where the foot is flat (heel to ball)
    and where the toes bend: rolling by the angle θ moves the contact by ``∫ρ dθ`` over the floor
    and to ``∫ρ (cos θ, sin θ) dθ`` on the sole.
    """
    # radius of curvature by pitch [m], every 0.1°: bells whose areas are the lengths rolled over
    angles = np.radians(np.linspace(-90.0, 110.0, 2001))
    center, width = np.radians(FOOT.flat)
    radius = (sole.ball - sole.heel) * _bell((angles - center) / width) / width
    center, width = np.radians(FOOT.toes)
    radius += FOOT.toe_roll * (sole.toe - sole.ball) * _bell((angles - center) / width) / width
    # arc on the floor, and contact on the sole forward and up, as integrals over the pitch
    step = angles[1] - angles[0]
    path = np.cumsum(radius[:, None] * np.stack([np.ones_like(angles), np.cos(angles)], 1), 0)
    rise = np.cumsum(radius * np.sin(angles))
    path = sole.heel + step * np.column_stack([path, rise])
    # counted from the flat foot, whose contact is as far along the floor as along the sole
    flat = [np.interp(0.0, angles, column) for column in path.T]
    offset = flat[1] - flat[0]
    on_floor, x, z = (np.interp(pitch, angles, column) for column in path.T)
    on_sole = np.stack([x - offset, 0 * x, z - flat[2]], -1)
    # the frame is where the contact on the floor is, less where that is on the turned sole
    ahead = on_floor[:, None] * np.array([1.0, 0.0, 0.0])
    contact = (rotation_about(UP, heading) @ ahead[..., None])[..., 0]
    return np.asarray(contact - (orientation(pitch, heading) @ on_sole[..., None])[..., 0])


def _bell(x: Array) -> Array:
    """Give the density of the standard normal distribution."""
    return np.asarray(np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi))


@dataclass(frozen=True, slots=True)
class FootPlacement:
    """A person's foot placement in a trial, in the platform's frame.

    Attributes
    ----------
    soles
        Side -> sole.
    steps
        Times of the steps.
    place
        Where the sole's frame would come down if the foot landed flat, (S, 2) [m].
    belt
        What carries the foot backwards from there.
    step_m
        Length of the person's steps at 1.3 m/s [m].
    step_s
        Mean duration of a step [s].
    standing_pressure_m
        How far ahead of the ankles the centre of pressure is in standing [m].
    pressure_shift
        How much further forward under the feet the centre of pressure is than in `roll_over` [m].
    """

    soles: Mapping[str, Sole]
    steps: Steps
    place: Array
    belt: BeltRamp
    step_m: float
    step_s: float
    standing_pressure_m: float
    pressure_shift: float = 0.0

    def phase(self, side: str, time: Array) -> Array:
        """Give the phase of a side's gait cycle, (T,)."""
        return phase_of(self.steps, time) + (0.5 if side == "left" else 0.0)

    def extent(self, time: Array) -> Array:
        """Give the length of steps at the belt's speed relative to `step_m`, (T,)."""
        return self.belt.speed(time) * self.step_s / self.step_m

    def heading(self, side: str, time: Array) -> Array:
        """Give the angle of a foot to the left, (T,) [rad]."""
        walking = np.minimum(self.extent(time), 1.0)
        _, inward = foot_angles(self.phase(side, time))
        return np.asarray(
            (1 - walking) * self.soles[side].toe_out - walking * OUTWARD[side] * inward
        )

    def step(self, side: str, time: Array) -> Array:
        """Give the number of a side's last step; -1 before its first, (T,)."""
        last = np.searchsorted(self.steps.contact, time, side="right") - 1
        first = 0 if side == "left" else 1  # left steps are even
        number = last - (last - first) % 2
        return np.where(number < first, -1, number)

    def anchor(self, side: str, number: Array, time: Array) -> Array:
        """Give the place of a step's flat foot at times before, during or after it, (T, 2) [m]."""
        # until its first step a foot is where it stood; then the belt carries it back
        first = np.array(self.soles[side].standing[:2])
        standing = number < 2 if side == "left" else number < 0
        k = np.maximum(number, 0)
        place = np.where(standing[:, None], first, self.place[k])
        since = np.where(standing, self.steps.contact[0], self.steps.contact[k])
        moved = self.belt.travelled(time) - self.belt.travelled(since)
        return np.asarray(place - moved[:, None] * np.array([1.0, 0.0]))

    def lateral(self, side: str, time: Array) -> Array:
        """Give the sideways place of a side's last step, left positive, (T,) [m]."""
        return self.anchor(side, self.step(side, time), time)[:, 1]

    def release(self, number: int) -> float:
        """Give when the floor begins to release the foot of a step [s]."""
        # before foot off, by phases of 1.3 m/s that are scaled as double support is
        early = (GAIT.stance - GAIT.leaving[0]) * self.steps.overlap / (GAIT.stance - 0.5)
        return float(self.steps.off[number] - early * self.step_s)

    def left_share(self, time: Array) -> Array:
        """Give the share of the weight on the left foot, (T,).

        All on one foot in single support, half on each before walking.
        """
        # from the contact of a foot to foot off of the other the weight moves onto it
        contact, off = self.steps.contact, self.steps.off
        last = np.searchsorted(contact, time, side="right") - 1
        k = np.clip(last, 1, len(contact) - 1)
        taken = smooth_step((time - contact[k]) / (off[k - 1] - contact[k]))
        walking = np.where(k % 2 == 0, taken, 1 - taken)
        # walking begins on the left foot
        overlap = self.steps.overlap * self.step_s
        starting = 0.5 + 0.5 * smooth_step((time - contact[0]) / overlap)
        return np.where(last < 1, starting, walking)

    def pressure(self, side: str, time: Array) -> Array:
        """Give the intended centre of pressure under a foot that carries weight, (T, 2) [m]."""
        sole, walking = self.soles[side], np.minimum(self.extent(time), 1.0)
        # along the foot, from its place in standing to that of the roll-over
        place = roll_over(self.phase(side, time))
        rolled = sole.heel + (sole.toe - sole.heel) * place + self.pressure_shift
        along = self.standing_pressure_m + walking * (rolled - self.standing_pressure_m)
        heading = self.heading(side, time)
        ahead = along[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        return np.asarray(self.anchor(side, self.step(side, time), time) + ahead)

    def total_pressure(self, time: Array) -> Array:
        """Give the intended centre of pressure of both feet together, (T, 2) [m]."""
        on_left = self.left_share(time)[:, None]
        left, right = (self.pressure(side, time) for side in SIDES)
        return on_left * left + (1 - on_left) * right
