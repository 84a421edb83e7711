"""Faults of single plates: what no foot can do, and what the motion and the feet contradict.

Every plate is judged in its own axes by three witnesses. Its raw samples
(`pipeline.trial.findings.raw`). The motion: the total wrench that the body's momentum needs, from
the markers alone. The feet: pressure lies under the foot that stands on the plate, and moves from
its heel to its ball.

The errors of the witnesses are systematic, as markers move on the skin and bodies differ from
tables: more frames do not make them smaller. Their sizes are standard deviations over healthy
recordings of six laboratories and over virtual ones (`tests.campaign.plate_doubts`). Segments that
no marker shows add the forces of their motion to what the body's momentum needs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from hbm.body import BALL_ABOVE_SOLE, Body
from hbm.coordinates import UP
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.unseen import unseen_covariance
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import delayed
from hbm.signals.samples import stretches
from hbm.spatial import (
    GRAVITY_MPS2,
    WRENCH_COMPONENTS,
    Array,
    Mask,
    rotate_wrench,
    shift_wrench,
)
from pipeline.config.schema import Settings
from pipeline.io.mended_plates import of_channels, reversing, turning
from pipeline.io.recording import Plate
from pipeline.io.stated import correction
from pipeline.trial.checks import rest_level
from pipeline.trial.findings.raw import RawFault
from pipeline.trial.gait.carried import places_of
from pipeline.trial.gait.contact import FEET
from pipeline.trial.subject import differing_masses

MIN_STANCE_S: Final = 0.25
MAX_STANCE_S: Final = 1.5
"""Of a foot that walks or runs over a plate; a longer one stands."""
LOADED: Final = 0.1
"""Of body weight, either way: a plate that carries a foot."""
ALONE: Final = 0.03
"""Of body weight on all other plates: the foot on this one is all that carries."""
MIN_FRAMES_S: Final = 0.15
"""For which a plate has to carry before it is judged by the motion."""
CORRELATED_S: Final = 0.15
"""Errors of the motion's forces are about independent after it."""
MAX_STANCE_MPS: Final = 0.3
"""Sum over axes of the standard deviation of the velocity of the ball of a foot that stands: 0.02
to 0.09; of one that swings 0.8 and more."""


@dataclass(frozen=True, slots=True, eq=False)
class Witnesses:
    """What motion and feet say about the load of the plates, at T frames.

    Attributes
    ----------
    time
        (T,) [s].
    wrenches
        Of each plate, lab axes about the lab origin, unfiltered, (P, T, 6) [N, N·m].
    filtered
        The same through the filter of the motion.
    need
        What the motion needs in all, in the same form, (T, 6).
    carried
        Frames in which the plates carry the subject and motion and forces are known, (T,).
    ankle, ball
        Of the left and the right foot, (T, 2, 3) [m].
    foot_m
        Length of the left and the right foot, (2,).
    weight_n
        Body weight.
    pelvis
        (T, 3) [m].
    unseen
        Covariance of what unseen segments add to the need, lab axes about the pelvis, (6, 6) [N,
        N·m].
    """

    time: Array
    wrenches: Array
    filtered: Array
    need: Array
    carried: Mask
    ankle: Array
    ball: Array
    foot_m: Array
    weight_n: float
    pelvis: Array
    unseen: Array

    @classmethod
    def of(
        cls,
        body: Body,
        motion: Motion,
        solved: Motion,
        wrenches: Sequence[Array],
        residual: Array,
        carried: Mask,
        settings: Settings,
    ) -> "Witnesses":
        """Collect them from the stages of a trial: the motion is filtered, the solved one not."""
        time, pelvis, every = motion.time, motion.q[:, :3], np.stack([*wrenches])
        cutoff_hz, method = settings.cutoff_hz, settings.filter
        filtered = np.stack([low_pass(wrench, time, cutoff_hz, method) for wrench in every])
        # the residual, about the pelvis, is what the motion needs beyond the plates
        need = filtered.sum(axis=0) + shift_wrench(residual, -pelvis)
        known = carried & np.isfinite(need).all(axis=1)
        places = places_of(body, solved.q)
        foot_m = np.array([body.lengths[foot] for foot in FEET])
        feet = places[:, 1:3], places[:, 3:], foot_m
        person = body.mass * GRAVITY_MPS2, pelvis, unseen_covariance(body, motion, carried)
        return cls(time, every, filtered, need, known, *feet, *person)

    @property
    def step_s(self) -> float:
        """From frame to frame."""
        return float(np.median(np.diff(self.time)))

    def alone(self, number: int) -> Mask:
        """Frames in which a plate alone carries the subject, (T,)."""
        load = np.abs(self.filtered[..., 2]) / self.weight_n
        others = np.delete(load, number, axis=0).sum(axis=0)
        return np.asarray(self.carried & (load[number] > LOADED) & (others < ALONE))

    def doubt(self, frames: Mask, axes: Array, place: Array) -> Array:
        """Give the SD of what unseen segments need, (6,), in axes, (3, 3), about a place, (3,)."""
        # each row is what a unit wrench about the pelvis is about the place
        units = shift_wrench(np.eye(6), place - self.pelvis[frames].mean(axis=0))
        change = rotate_wrench(units, axes.T)
        return np.asarray(np.sqrt(np.diag(change.T @ self.unseen @ change)))


class Stance(NamedTuple):
    """A foot on a plate.

    Attributes
    ----------
    plate
        Index of the plate.
    foot
        0 left, 1 right.
    frames
        The middle half of the contact.
    along, left
        Of the foot in the lab, horizontally, (F, 3).
    expected
        Where its pressure usually is, (F, 3) [m].
    """

    plate: int
    foot: int
    frames: slice
    along: Array
    left: Array
    expected: Array


PRESSURE_ALONG: Final = 0.40
"""Where pressure lies under a foot in the middle half of a stance, on the line from ankle to ball:
from the ankle, by the length of the foot."""


def find_stances(witnesses: Witnesses) -> Iterator[Stance]:
    """Find single feet on plates; which foot stands, its motion says, not the pressure."""
    time, load = witnesses.time, np.abs(witnesses.wrenches[..., 2])
    velocity = np.gradient(witnesses.ball, time, axis=0)
    for plate, own in enumerate(load):
        for start, stop in stretches(own > LOADED * witnesses.weight_n):
            lasts_s = time[stop - 1] - time[start]
            if start == 0 or stop == len(time) or not MIN_STANCE_S < lasts_s < MAX_STANCE_S:
                continue
            quarter = (stop - start) // 4
            frames = slice(start + quarter, stop - quarter)
            spread = velocity[frames].std(axis=0).sum(axis=-1)
            foot = int(np.argmin(spread))
            if not (spread[foot] < MAX_STANCE_MPS < spread[1 - foot]):
                continue
            ankle, ball = witnesses.ankle[frames, foot], witnesses.ball[frames, foot]
            along = (ball - ankle) * [1.0, 1.0, 0.0]
            along /= np.linalg.norm(along, axis=1)[:, None]
            left = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
            length = witnesses.foot_m[foot]
            expected = ankle + PRESSURE_ALONG * length * along
            expected[:, 2] = ball[:, 2] - BALL_ABOVE_SOLE * length
            yield Stance(plate, foot, frames, along, left, expected)


# Plates that are turned, exchanged, or have a channel of the wrong sign

ERRORS: Final = np.array([0.03, 0.03, 0.05, 0.008])
"""Standard deviation of what the motion needs, by body weight, body weight × 1 m for the moment
about the vertical: forward, sideways, upward, and that moment."""
PLACE_ERROR_M: Final = 0.03
"""Of the pressure, by motion or foot."""
LEAST_GAIN: Final = 15.0
"""By which another state of a plate has to be more likely (its logarithm, twice). Healthy plates
reach 4."""
MAX_LEFT: Final = 0.45
"""Of the misfit, that the other state may leave: it has to explain what is wrong."""


STATES: Final[dict[str, Array]] = {
    "": np.eye(6),
    **{f"turn {degrees}": turning(degrees) for degrees in (90, 180, 270)},
    **{f"reverse {what}": reversing(what) for what in (*WRENCH_COMPONENTS, "all")},
}
"""What may have to be done to the channels of a plate, as `pipeline.io.mended_plates` does it."""


def misfit(
    wrench: Array,
    plate: Plate,
    witnesses: Witnesses,
    alone: Mask,
    stances: Sequence[Stance],
    *,
    moved: bool = False,
) -> Array:
    """Give how unlikely what a plate says is, by the motion where it is alone and by the feet.

    ``wrench`` is in the plate's axes about its centre, (T, 6), filtered like the motion. Gives the
    sum of squares of independent differences by their standard deviations, and their number, (2,).
    Of a plate that is moved, the mean difference of its pressure does not count.
    """
    weight_n, total = witnesses.weight_n, np.zeros(2)
    load = np.where(np.abs(wrench[:, 2]) < 1.0, np.nan, wrench[:, 2])
    # the centre of pressure in the plane of the plate: moments by the load
    pressure = np.column_stack([-wrench[:, 4], wrench[:, 3]]) / load[:, None]
    away, error_m = list[Array](), list[Array]()
    if alone.any():
        need = _in_plate(witnesses.need, plate)[alone]
        doubt = witnesses.doubt(alone, plate.rotation, plate.center)
        errors = np.hypot(ERRORS * weight_n, doubt[[0, 1, 2, 5]])
        off = (need - wrench[alone])[:, [0, 1, 2, 5]] / errors
        total += np.square(off).sum(), off.size
        wanted = np.column_stack([-need[:, 4], need[:, 3]]) / need[:, 2:3]
        away.append(wanted - pressure[alone])
        error_m.append(np.hypot(PLACE_ERROR_M, doubt[[4, 3]] / need[:, 2:3]))
    for stance in stances:
        down = np.minimum(plate.rotation[2, 2] * wrench[stance.frames, 2] / weight_n, 0.0)
        total += np.square(down / ERRORS[2]).sum(), 0
        expected = ((stance.expected - plate.center) @ plate.rotation)[:, :2]
        away.append(expected - pressure[stance.frames])
        error_m.append(np.full(away[-1].shape, PLACE_ERROR_M))
    if away:
        every = np.concatenate(away)
        every = every - np.nanmean(every, axis=0) if moved else every
        total += np.nansum(np.square(every / np.concatenate(error_m))), every.size
    # the two numbers of another place reduce the sum by one each even if the plate is in place
    fitted = 2.0 if moved else 0.0
    return np.asarray(total * witnesses.step_s / CORRELATED_S + [fitted, 0.0])


def _in_plate(wrench: Array, plate: Plate) -> Array:
    return rotate_wrench(shift_wrench(wrench, plate.center), plate.rotation.T)


def find_states(
    plates: Sequence[Plate], witnesses: Witnesses, stances: Sequence[Stance]
) -> tuple[dict[int, str], list[tuple[int, int]]]:
    """Find plates whose channels are turned or reversed, and pairs that are exchanged.

    Returns
    -------
    dict and list
        Index of a plate -> the state that undoes what happened; pairs of indices.
    """
    feet = {k: [s for s in stances if s.plate == k] for k in range(len(plates))}
    frames = {k: witnesses.alone(k) for k in feet}
    enough = MIN_FRAMES_S / witnesses.step_s
    judged = [
        k
        for k, plate in enumerate(plates)
        if np.isfinite(plate.corners).all() and (feet[k] or frames[k].sum() > enough)
    ]

    def cost(source: int, place: int, state: Array, *, moved: bool = False) -> Array:
        wrench = of_channels(
            plates[source], state, _in_plate(witnesses.filtered[source], plates[source])
        )
        witness = witnesses, frames[source], feet[source]
        return misfit(wrench, plates[place], *witness, moved=moved)

    plain = {k: cost(k, k, STATES[""]) for k in judged}
    pairs = []
    for one, other in combinations(judged, 2):
        before = plain[one] + plain[other]
        after = cost(one, other, STATES[""]) + cost(other, one, STATES[""])
        if _better(before, after):
            pairs.append((one, other))
    states = {}
    for k in {*judged}.difference(*pairs):
        costs = {name: cost(k, k, state) for name, state in STATES.items()}
        best = min(costs, key=lambda name: float(costs[name][0]))
        elsewhere = cost(k, k, STATES[""], moved=True)
        if _better(plain[k], costs[best]) and costs[best][0] < elsewhere[0]:
            states[k] = best
    return states, pairs


def _better(before: Array, after: Array) -> bool:
    """Whether another state is much more likely, and explains the misfit or leaves a usual one."""
    explains = after[0] < MAX_LEFT * before[0] or after[0] < after[1]
    return bool(before[0] - after[0] > LEAST_GAIN and explains)


# Gains of single channels

FORCE_ERROR: Final = 0.012
"""Standard deviation of what a plate's force differs by from the motion's, by body weight, in the
direction of the force itself."""
MIN_SHEAR: Final = 0.05
"""RMS by body weight of a horizontal force that a plate is judged by."""
SURE: Final = 2.7
"""Standard deviations: with a dozen channels in a trial, one healthy trial of a hundred."""
SURE_ALONE: Final = 4.0
"""The same where no other plate of the trial carried long enough to compare it with."""
BESIDE: Final = 0.8
"""Of these, the difference from the other plates, which know less than the motion does."""
OF_STANCE: Final = 0.4
"""Of the SD of what unseen segments need, in a mean over stances: they oscillate. In 17 stances of
real walks 0.2 to 0.6, of places and of forces in the direction of a plate's own."""
ALIKE: Final = 0.5
"""Of the mean error of all plates' vertical force, by which each may differ from it."""
MIN_OFF: Final = np.array([0.25, 0.25, 0.05])
"""Smallest error of a gain that is named."""


class Gain(NamedTuple):
    """What share of a force a plate measures, with the 95 % interval."""

    plate: int
    axis: int
    share: float
    low: float
    high: float


def find_gains(plates: Sequence[Plate], witnesses: Witnesses, left_out: set[int]) -> list[Gain]:
    """Find plates that measure too much or too little of one force beside the others.

    What the motion needs is the sum of the plates' forces by their gains, so that all are found
    together. One is wrong if it differs from 1 and from those of the others.
    """
    filtered, weight_n = witnesses.filtered, witnesses.weight_n
    mass_kg, use = weight_n / GRAVITY_MPS2, witnesses.carried
    count = (use & (np.abs(filtered[..., 2]) > LOADED * weight_n)).sum(axis=1)
    used = np.flatnonzero(count * witnesses.step_s > MIN_FRAMES_S).tolist()
    if not used or left_out & {*used}:
        return []
    found = []
    for axes in ((0, 1), (2,)):
        columns, names = [], []
        for k in used:
            in_plate = filtered[k, use, :3] @ plates[k].rotation
            for axis in axes:
                part = in_plate[:, axis, None] * plates[k].rotation[:, axis]
                columns.append(part[:, list(axes)].ravel())
                names.append((k, axis))
        design = np.column_stack(columns)
        target = witnesses.need[use][:, list(axes)].ravel()
        if axes != (2,):  # a wrong mass is no fault of the plates' shear
            target = target * (weight_of_steps(witnesses) or mass_kg) / mass_kg
        normal = design.T @ design
        if np.linalg.cond(normal) > 1e6:
            continue
        inverse = np.linalg.inv(normal)
        factor = inverse @ design.T @ target
        loaded = np.array([count[k] for k, _ in names])
        if axes == (2,) and _alike(factor):
            continue
        doubts = [witnesses.doubt(use, plates[k].rotation, plates[k].center)[a] for k, a in names]
        # what the motion says is as unsure in all frames: their number makes no gain surer
        unsure_n = np.hypot(FORCE_ERROR * weight_n, OF_STANCE * np.array(doubts))
        sd = unsure_n * np.sqrt(np.diag(inverse) * loaded)
        for number, (k, axis) in enumerate(names):
            same = [n for n, (other, a) in enumerate(names) if a == axis and other != k]
            strength = np.sqrt(np.diag(normal)[number] / loaded[number]) / weight_n
            beside = np.median(factor[same]) if same else 1.0
            off = factor[number] - 1
            differs = factor[number] - beside
            if axis != 2 and strength * abs(factor[number]) < MIN_SHEAR:
                continue
            if axis == 2 and not same:
                continue
            sure = SURE if same else SURE_ALONE
            certain = abs(off) > sure * sd[number] and abs(differs) > BESIDE * sure * sd[number]
            share = 1 / factor[number]
            if certain and abs(share - 1) > MIN_OFF[axis]:
                bounds = 1 / (factor[number] + np.array([1.96, -1.96]) * sd[number])
                found.append((abs(off) / sd[number], Gain(k, axis, share, *sorted(bounds))))
    return [gain for _, gain in sorted(found, reverse=True, key=lambda each: each[0])]


LATE_S: Final = 0.005 * np.array([*range(-8, 0), *range(1, 9)])
"""Delays of one plate beside the others that are tried [s]."""
LATE_LEFT: Final = 0.7
"""Of the misfit that gains leave, which a delay has to leave at most to be named in their place."""


def find_late(
    plates: Sequence[Plate], witnesses: Witnesses, gains: Sequence[Gain]
) -> tuple[int, float] | None:
    """Find the one plate that is later than the others where that explains more than gains do."""
    if not gains:
        return None
    time, forces = witnesses.time, witnesses.filtered[..., :3]
    use, need = witnesses.carried, witnesses.need[witnesses.carried, :3]

    def left(measured: Array) -> float:
        return float(np.nansum(np.square(need - measured[:, use].sum(axis=0))))

    corrected = forces.copy()
    for gain in gains:
        axis = plates[gain.plate].rotation[:, gain.axis]
        along = corrected[gain.plate] @ axis
        corrected[gain.plate] += np.outer((1 / gain.share - 1) * along, axis)
    misfits = {}
    for k in range(len(plates)):
        for delay_s in LATE_S:
            moved = forces.copy()
            moved[k] = delayed(time, forces[k], -delay_s)
            misfits[k, float(delay_s)] = left(moved)
    best = min(misfits, key=lambda key: misfits[key])
    return best if misfits[best] < LATE_LEFT * left(corrected) else None


def _alike(factor: Array) -> bool:
    """Whether all plates, (P,), measure too much or too little alike: the body mass is wrong."""
    off = factor - 1
    common = float(np.mean(off))
    return bool(len(off) > 1 and np.abs(off - common).max() < ALIKE * abs(common))


# Places of plates

OWN: Final = {"motion": (0.010, 0.006, 9.0), "feet": (0.020, 0.009, 9.0)}
COMMON: Final = {"motion": (0.018, 0.011, 5.0), "feet": (0.025, 0.022, 9.0)}
"""Standard deviations of the pressure that motion and feet show beside that of a plate: along and
across the foot [m], and of the direction of the shear, or of the path of the pressure [°]; of each
plate, and common to all of a trial."""
MIN_PLACE: Final = (0.02, 0.02, 8.0)
SURE_PLACE: Final = (2.9, 2.9, 3.3)
"""Standard deviations."""
MIN_MOVE_M: Final = 0.01
"""Shorter corrections of a place are not worth setting."""
MIN_PATH_M: Final = 0.06
"""A shorter path of the pressure has no direction."""


class Place(NamedTuple):
    """Where the pressure of a plate is beside where it should be: [m] or [°], with 1.96 SD."""

    plate: int
    axis: int
    off: float
    interval: float


def find_places(witnesses: Witnesses, stances: Sequence[Stance], left_out: set[int]) -> list[Place]:
    """Find plates that are not where they are said to be, along, across, or in direction."""
    rows = list(_place_rows(witnesses, stances))
    found, askew = list[Place](), set[int]()
    for axis in (2, 0, 1):
        askew |= {place.plate for place in found if place.axis == 2}
        mine = [row for row in rows if np.isfinite(row[3][axis])]
        mine = [row for row in mine if row[1] not in left_out | askew]
        while mine:
            kinds, of, side, differs, unsure = map(np.array, zip(*mine, strict=True))
            spread = np.hypot([OWN[kind][axis] for kind in kinds], unsure[:, axis])
            covariance = np.diag(spread**2)
            for kind, common in COMMON.items():
                # across and in direction, errors of left and right feet have opposite signs
                sign = side if kind == "feet" and axis else 1.0
                together = np.where(kinds == kind, sign, 0.0)
                covariance += common[axis] ** 2 * np.outer(together, together)
            inverse = np.linalg.inv(covariance)
            certain = []
            for plate in {*of}:
                here = (of == plate).astype(float)
                information = here @ inverse @ here
                off, sd = here @ inverse @ differs[:, axis] / information, information**-0.5
                if abs(off) > max(SURE_PLACE[axis] * sd, MIN_PLACE[axis]):
                    place = Place(int(plate), axis, float(off), float(1.96 * sd))
                    certain.append((abs(off) / sd, place))
            if not certain:
                break
            _, best = max(certain)
            found.append(best)
            mine = [row for row in mine if row[1] != best.plate]
    return found


def _place_rows(
    witnesses: Witnesses, stances: Sequence[Stance]
) -> Iterator[tuple[str, int, float, Array, Array]]:
    """Give witness, plate, side (1 where left is medial), and how far off pressure is, (3,).

    That is along and left of the foot [m], and direction [°]; last their SD by unseen segments.
    """
    for k in range(len(witnesses.wrenches)):
        on_plate = [stance for stance in stances if stance.plate == k]
        if not on_plate:
            continue
        ahead, across = _walked(on_plate, k)
        off = []
        for stance in on_plate:
            frames = stance.frames
            pressure = _pressure(witnesses.wrenches[k, frames], stance.expected[:, 2])
            away = pressure - stance.expected
            path = pressure[-1] - pressure[0]
            relative = path - (stance.expected[-1] - stance.expected[0])
            along, left = stance.along.mean(axis=0), stance.left.mean(axis=0)
            turned = np.degrees(np.arctan2(relative @ left, relative @ along))
            if np.hypot(relative @ left, relative @ along) < MIN_PATH_M:
                turned = np.nan
            side = 1.0 if stance.foot == 1 else -1.0
            means = [
                np.mean((away * stance.along).sum(axis=1)),
                np.mean((away * stance.left).sum(axis=1)),
                turned - side * 10.0,
            ]
            off.append((side, means))
        for side in (1.0, -1.0):
            if same := [means for its, means in off if its == side]:
                yield "feet", k, side, np.median(same, axis=0), np.zeros(3)
        alone = witnesses.alone(k)
        if alone.sum() * witnesses.step_s > MIN_FRAMES_S:
            level = np.full(int(alone.sum()), np.mean([s.expected[:, 2].mean() for s in on_plate]))
            need = witnesses.need[alone]
            away = _pressure(witnesses.filtered[k, alone], level) - _pressure(need, level)
            mean = np.average(away, axis=0, weights=need[:, 2])
            one, other = need[:, :2], witnesses.filtered[k, alone, :2]
            turned = np.degrees(
                np.arctan2(
                    np.sum(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]),
                    np.sum(one * other),
                )
            )
            foot = np.column_stack([ahead, across, UP])
            place = np.array([*witnesses.ball[alone].mean(axis=(0, 1))[:2], level[0]])
            doubt = witnesses.doubt(alone, foot, place)
            # a moment moves the pressure by its share of the load, a force to the left turns shear
            along_m, across_m = OF_STANCE * doubt[[4, 3]] / np.abs(need[:, 2]).mean()
            shear = np.linalg.norm(one, axis=1).mean()
            unsure = np.array([along_m, across_m, np.degrees(doubt[1] / shear)])
            yield "motion", k, 1.0, np.array([mean @ ahead, mean @ across, turned]), unsure


def _pressure(wrench: Array, level: Array) -> Array:
    """Give the centre of pressure at a height, (F,) [m], of wrenches in the lab, (F, 3) [m]."""
    fx, fy, fz, mx, my, _ = wrench.T
    return np.column_stack([(level * fx - my) / fz, (level * fy + mx) / fz, level])


# Weight

MIN_WEIGHING_S: Final = 0.35
"""Of a stretch that the plates carry: over it, the change of the vertical velocity divided by the
time is known to 0.03 m/s², a third of a percent of gravity."""

MAX_APART: Final = 0.12
"""RMS difference of the load from what the motion needs, by their mean: healthy walks differ by 2
to 7 %; where they differ by more, something else than the mass is wrong."""


def weight_of_steps(witnesses: Witnesses) -> float | None:
    """Give the body mass by the steps that the plates carry [kg]; None without any.

    What plates read without load does not count.

    The mean vertical force is m (g + Δv/Δt) of the centre of mass over any stretch, Δv from the
    markers; over whole gait cycles Δv is zero.
    """
    at_rest = sum(
        rest_level(wrench[:, 2], witnesses.time, witnesses.weight_n) or 0.0
        for wrench in witnesses.wrenches
    )
    load, need = witnesses.filtered[..., 2].sum(axis=0) - at_rest, witnesses.need[:, 2]
    weighing = np.zeros(len(load), bool)
    for start, stop in stretches(witnesses.carried):
        weighing[start:stop] = witnesses.time[stop - 1] - witnesses.time[start] >= MIN_WEIGHING_S
    if not weighing.any():
        return None
    load, need = load[weighing], need[weighing]
    factor = float(load.sum() / need.sum())
    apart = float(np.sqrt(np.mean(np.square(load - factor * need))) / load.mean())
    return None if apart > MAX_APART else factor * witnesses.weight_n / GRAVITY_MPS2


# All of them

AXES: Final = ("forward", "sideways", "vertical")
DIRECTIONS: Final = ("ahead", "left")


def plate_faults(
    plates: Sequence[Plate], witnesses: Witnesses, raw: Sequence[RawFault], *, by_motion: bool
) -> list[Note]:
    """Name what is wrong with single plates.

    Parameters
    ----------
    plates
        As recorded.
    witnesses
        What motion and feet say of them.
    raw
        What their raw samples show (`pipeline.trial.findings.raw`).
    by_motion
        Whether the ground stands still and labels are right; else raw samples alone are judged.

    Returns
    -------
    list of Note
        ``plate_dead``, ``plate_wraps``, ``plate_clipped``, ``plate_jumps``, ``plates_exchanged``,
        ``plate_turned``, ``plate_late``, ``plate_reversed``, ``plate_elsewhere``, ``plate_askew``
        and ``plate_gain``. A plate that one of them explains is not judged by those after it.
    """
    notes, explained = list[Note](), set[int]()
    for k, plate in enumerate(plates):
        if faults := [fault for fault in raw if fault.plate == plate.number]:
            notes += _raw_notes(plate.number, faults, witnesses.time)
            explained.add(k)
    if not by_motion:
        return notes
    stances = [stance for stance in find_stances(witnesses) if stance.plate not in explained]
    states, pairs = find_states(plates, witnesses, stances)
    for one, other in pairs:
        first, second = plates[one].number, plates[other].number
        remedy = correction(f"{first}: exchange {second}")
        notes.append(Note.of("plates_exchanged", first=first, second=second, remedy=remedy))
        explained |= {one, other}
    for k, state in states.items():
        if k not in explained:
            kind, what = state.split()
            code = "plate_turned" if kind == "turn" else "plate_reversed"
            remedy = correction(f"{plates[k].number}: {state}")
            notes.append(Note.of(code, plate=plates[k].number, what=what, remedy=remedy))
            explained.add(k)
    gains = find_gains(plates, witnesses, explained)
    if late := find_late(plates, witnesses, gains):
        notes.append(Note.of("plate_late", plate=plates[late[0]].number, delay_s=late[1]))
        explained.add(late[0])
        gains = []
    for gain in gains:
        explained.add(gain.plate)
        plate, what = plates[gain.plate], WRENCH_COMPONENTS[gain.axis]
        if gain.share < 0:
            remedy = correction(f"{plate.number}: reverse {what}")
            notes.append(Note.of("plate_reversed", plate=plate.number, what=what, remedy=remedy))
            continue
        direction = AXES[int(np.argmax(np.abs(plate.rotation[:, gain.axis])))]
        of = {"component": what, "direction": direction}
        size = {"share": gain.share, "low": gain.low, "high": gain.high}
        remedy = correction(f"{plate.number}: gain {what} {1 / gain.share:.3f}")
        notes.append(Note.of("plate_gain", plate=plate.number, **of, **size, remedy=remedy))
    found = find_places(witnesses, stances, explained)
    for k in dict.fromkeys(place.plate for place in found):
        off = {place.axis: place for place in found if place.plate == k}
        number = plates[k].number
        if 2 in off:
            turn = {"turn_deg": off[2].off, "interval_deg": off[2].interval}
            notes.append(Note.of("plate_askew", plate=number, **turn))
        else:
            notes.append(_elsewhere(plates[k], list(off.values()), _walked(stances, k)))
    return notes


def _walked(stances: Sequence[Stance], plate: int) -> Array:
    """Give the directions ahead and to the left of the feet on a plate, (2, 3)."""
    own = [stance.along.mean(axis=0) for stance in stances if stance.plate == plate]
    ahead = np.mean(own, axis=0) / np.linalg.norm(np.mean(own, axis=0))
    return np.array([ahead, [-ahead[1], ahead[0], 0.0]])


def _elsewhere(plate: Plate, off: Sequence[Place], directions: Array) -> Note:
    """Say how far from the feet the pressure on a plate is, and how to move the plate there."""
    moved = -sum(place.off * directions[place.axis] for place in off) @ plate.rotation
    moves = [
        f"{plate.number}: move {axis} {metres:.3f}"
        for axis, metres in zip("xy", moved[:2], strict=True)
        if abs(metres) >= MIN_MOVE_M
    ]
    return Note.of(
        "plate_elsewhere",
        plate=plate.number,
        off_m={DIRECTIONS[place.axis]: place.off for place in off},
        interval_m=max(place.interval for place in off),
        remedy=correction(*moves),
    )


EXPLAINED: Final = {"pressure_far_from_feet", "carried_in_part"}
"""Notes that say less than those of single plates."""
TIME_WRONG: Final = {
    *("plate_dead", "plate_wraps", "plate_clipped"),
    *("plates_exchanged", "plate_turned", "plate_reversed", "plate_late"),
}
"""Faults of single plates with which all plates together seem to be late."""
LABELS_WRONG: Final = {"sides_exchanged", "labels_exchanged"}
"""Faults of markers with which the motion is no witness."""
RAW: Final = {"plate_dead", "plate_wraps", "plate_clipped", "plate_jumps", "plate_reversed"}


def without_explained(
    notes: Sequence[Note], faults: Sequence[Note], known_kg: Mapping[str, float]
) -> tuple[list[Note], list[Note]]:
    """Leave out of notes what faults of plates explain, and of faults what notes explain.

    A gain is explained by a delay of all plates, by plates that are not zeroed and, of a vertical
    force, by sources of the body mass that differ.
    """
    explained = EXPLAINED if faults else set[str]()
    if any(fault.code in TIME_WRONG for fault in faults):
        explained = explained | {"plates_late"}
    left = [note for note in notes if note.code not in explained]
    if any(note.code in ("plates_late", "plates_not_zeroed") for note in left):
        return left, [fault for fault in faults if fault.code != "plate_gain"]
    if differing_masses(known_kg, None):
        return left, [fault for fault in faults if fault.values.get("component") != "Fz"]
    return left, list(faults)


def misweigh(faults: Sequence[Note]) -> bool:
    """Whether plates have faults with which steps do not weigh the body."""
    return any(note.code in RAW or note.values.get("component") == "Fz" for note in faults)


def _raw_notes(plate: int, faults: Sequence[RawFault], time: Array) -> Iterator[Note]:
    """Name the channels of a plate by what their raw samples show."""
    for kind in dict.fromkeys(fault.kind for fault in faults):
        same = [fault for fault in faults if fault.kind == kind]
        sizes = {fault.channel: abs(fault.size) for fault in same}
        first_s, count = min(f.first_s for f in same), sum(f.count for f in same)
        if kind == "dead":
            yield Note.of("plate_dead", plate=plate, channels=[*sizes])
        elif kind == "clipped":
            spans = np.array([span for fault in same for span in fault.spans_s])
            inside = (spans[:, :1] <= time) & (time <= spans[:, 1:])
            frames = int(np.count_nonzero(inside.any(axis=0)))
            at = {"frames": frames, "first_s": first_s}
            yield Note.of("plate_clipped", plate=plate, limits=sizes, **at)
        elif kind == "wraps":
            remedy = correction(*(f"{plate}: unwrap {name}" for name in sizes))
            at = {"jumps": count, "first_s": first_s}
            yield Note.of("plate_wraps", plate=plate, sizes=sizes, **at, remedy=remedy)
        else:
            at = {"jumps": count, "first_s": first_s}
            yield Note.of("plate_jumps", plate=plate, sizes=sizes, **at)
