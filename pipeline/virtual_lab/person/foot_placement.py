"""Foot placement: where the feet are on the platform, and how they share the weight."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbm.spatial import Array
from pipeline.virtual_lab.machine.treadmill import BeltRamp
from pipeline.virtual_lab.person.gait_pattern import foot_angles
from pipeline.virtual_lab.person.sole import OUTWARD, SIDES, Sole
from pipeline.virtual_lab.person.stance import LEAVING, STANCE, roll_over
from pipeline.virtual_lab.person.steps import Steps, phase_of
from pipeline.virtual_lab.trajectories import smooth_step


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
