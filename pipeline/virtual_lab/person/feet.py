"""The feet: their soles, which roll over the belt, where they are, and how they share weight."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, rotation_about
from pipeline.virtual_lab.machine.platform import BeltRamp, smooth_step
from pipeline.virtual_lab.person.gait import (
    LEAVING,
    STANCE,
    Steps,
    foot_angles,
    phase_of,
    roll_over,
)

SIDES: Final = ("left", "right")
OUTWARD: Final = {"left": 1.0, "right": -1.0}
UP: Final = np.array([0.0, 0.0, 1.0])
LEFT: Final = np.array([0.0, 1.0, 0.0])

TOE_TIP: Final = 1.25
"""Place of the toe tip from the heel, by the distance from heel to second metatarsal head; typical
of the foot."""
SOLE_MARGIN_M: Final = 0.012
"""How far the sole reaches beyond the centres of the markers: about a marker's radius and the
shoe's edge."""
HALF_WIDTH: Final = 0.35
"""Half the width of heel and toes, by the sideways distance between the second and the fifth
metatarsal head; assumed."""
FLAT_DEG: Final = 1.0, 3.0
"""Pitch at which a rolling foot passes from heel to ball, and the width of that passage; chosen, so
that the sole does not sink into the belt by more than a shoe deforms."""
TOES_DEG: Final = 50.0, 12.0
"""The same for the passage from ball to toes; chosen."""
TOE_ROLL: Final = 0.5
"""Share of the toes' length over which the foot rolls before it leaves the floor; chosen."""
_PITCH: Final = np.radians(np.linspace(-90.0, 110.0, 2001))
"""Pitch angles at which the rolling motion is tabulated: every 0.1° of what a foot can reach."""


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
        own = rotation @ self.rotation.T
        return own, position - own @ self.origin


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
    toe_out = float(np.arctan2(along[1], along[0]))
    rotation = rotation_about(UP, toe_out)
    under = np.array([ankle[0], ankle[1], 0.0])
    h, i, o = ((p - under) @ rotation for p in (heel, inner, outer))
    toe = h[0] + (TOE_TIP if has_metatarsal else 1.0) * (i[0] - h[0])
    ball = (h[0] + (toe - h[0]) / TOE_TIP + o[0]) / 2
    m, medial = SOLE_MARGIN_M, -OUTWARD[side]
    half_width = HALF_WIDTH * abs(i[1] - o[1])
    outline = np.array(
        [
            [h[0] - m, h[1] + half_width + m],
            [toe + m, i[1] + medial * half_width],
            [h[0] - m, h[1] - half_width - m],
            [o[0] + m, o[1] - medial * m],
            [ball, i[1] + medial * (half_width + 2 * m)],
        ]
    )
    return Sole(
        f"{side}_foot",
        rotation.T @ R,
        rotation.T @ (ankle - under),
        toe_out,
        under,
        float(h[0]),
        float(ball),
        float(toe),
        _ordered(outline),
    )


def _ordered(points: Array) -> Array:
    """Order a convex polygon's corners counter-clockwise."""
    away = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(away[:, 1], away[:, 0]))]


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
    center, width = np.radians(FLAT_DEG)
    radius = (sole.ball - sole.heel) * _bell((_PITCH - center) / width) / width
    center, width = np.radians(TOES_DEG)
    radius += TOE_ROLL * (sole.toe - sole.ball) * _bell((_PITCH - center) / width) / width
    step = _PITCH[1] - _PITCH[0]
    path = np.cumsum(radius[:, None] * np.stack([np.ones_like(_PITCH), np.cos(_PITCH)], 1), 0)
    rise = np.cumsum(radius * np.sin(_PITCH))
    path = sole.heel + step * np.column_stack([path, rise])
    flat = [np.interp(0.0, _PITCH, column) for column in path.T]
    offset = flat[1] - flat[0]
    on_floor, x, z = (np.interp(pitch, _PITCH, column) for column in path.T)
    on_sole = np.stack([x - offset, 0 * x, z - flat[2]], -1)
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
        own = 0 if side == "left" else 1
        number = last - (last - own) % 2
        return np.where(number < own, -1, number)

    def anchor(self, side: str, number: Array, time: Array) -> Array:
        """Give the place of a step's flat foot at times before, during or after it, (T, 2) [m]."""
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
        early = (STANCE - LEAVING[0]) * self.steps.overlap / (STANCE - 0.5)
        return float(self.steps.off[number]) - early * self.step_s

    def left_share(self, time: Array) -> Array:
        """Give the share of the weight on the left foot, (T,).

        All on one foot in single support, half on each before walking.
        """
        contact, off = self.steps.contact, self.steps.off
        last = np.searchsorted(contact, time, side="right") - 1
        k = np.clip(last, 1, len(contact) - 1)
        taken = smooth_step((time - contact[k]) / (off[k - 1] - contact[k]))
        walking = np.where(k % 2 == 0, taken, 1 - taken)
        overlap = self.steps.overlap * self.step_s
        starting = 0.5 + 0.5 * smooth_step((time - contact[0]) / overlap)
        return np.where(last < 1, starting, walking)

    def pressure(self, side: str, time: Array) -> Array:
        """Give the intended centre of pressure under a foot that carries weight, (T, 2) [m]."""
        sole, walking = self.soles[side], np.minimum(self.extent(time), 1.0)
        share = roll_over(self.phase(side, time))
        rolled = sole.heel + (sole.toe - sole.heel) * share + self.pressure_shift
        along = self.standing_pressure_m + walking * (rolled - self.standing_pressure_m)
        heading = self.heading(side, time)
        ahead = along[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        return np.asarray(self.anchor(side, self.step(side, time), time) + ahead)

    def total_pressure(self, time: Array) -> Array:
        """Give the intended centre of pressure of both feet together, (T, 2) [m]."""
        share = self.left_share(time)[:, None]
        left, right = (self.pressure(side, time) for side in SIDES)
        return share * left + (1 - share) * right
