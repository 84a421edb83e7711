"""One judge of plates: everything that may be wrong with them, weighed by what it leaves.

The score is the residual of the whole body, whitened by what healthy bodies and segments without
markers leave, and how far the pressure on each plate is from the foot that stands there. Body mass
is uncertain in every comparison. A fault is named if correcting it lowers the score by more than
healthy recordings ever show; faults that lower it almost alike are named together.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from hbm.coordinates import UP
from hbm.spatial import (
    WRENCH_COMPONENTS,
    Array,
    Indices,
    Mask,
    rotate_wrench,
    rotation_about,
    shift_wrench,
)
from pipeline.io.mended_plates import of_channels, reversing, turning
from pipeline.trial.findings.evidence import Evidence, Stance, find_stances, pressure
from pipeline.trial.findings.finding import JudgedKind

LIMIT: Final = 6.0
"""Fall of the score that names a fault (twice a logarithm of odds): of healthy recordings 1 of 60
exceeds it (`tests.campaign.planted_faults`)."""
TIED: Final = 6.0
"""Faults that are so near to the best one cannot be told from it."""
INDEPENDENT_S: Final = 0.15
"""Errors of the motion's forces are about independent after it."""
MOST_INDEPENDENT: Final = 14.0
"""Samples that count at most: bodies differ from tables in all frames alike."""
MOST_FRAMES: Final = 150
"""Frames at which the motion is compared: neighbours tell the same."""
MOST_OF_STANCE: Final = 12
MOST_STANCES: Final = 10
"""Frames of a stance, and stances of a foot on a plate, that are compared."""
FOOT_SD: Final = np.array([0.032, 0.024])
"""Of the pressure from where it usually is, along and across a foot on a plate [m]."""
DOWN_SD: Final = 0.035
"""Of a downward pull on a foot, by body weight: there is none."""
MOST_DEVIATIONS: Final = 30.0
"""Of a foot from its pressure; a plate that reads nothing has its pressure anywhere."""
MASS_SD: Final[Mapping[bool, float]] = {True: 0.03, False: 0.10}
"""Of body mass, by itself: where it is stated, and where the plates weighed it."""
MIN_LOADED_S: Final = 0.15
"""For which a plate has to carry to be judged."""
MOST_FAULTS: Final = 3
SD: Final[Mapping[JudgedKind, tuple[float, ...]]] = {
    "gain": (0.5,),
    "moved": (0.06, 0.06),
    "askew": (0.35,),
    "late": (0.03,),
    "all_late": (0.03,),
}
"""JudgedKind of fault -> usual size where it is there: share, [m], [rad], [s]."""
COST: Final[Mapping[JudgedKind, float]] = {
    "gain": 4.0,
    "reversed": 6.0,
    "turned": 6.0,
    "exchanged": 6.0,
    "moved": 3.0,
    "askew": 5.0,
    "late": 7.0,
    "all_late": 5.0,
}
"""How rare each kind is, on the scale of the score."""
LEAST: Final[Mapping[JudgedKind, float]] = {
    "gain": 0.05,
    "moved": 0.015,
    "askew": np.radians(5.0),
    "late": 0.008,
    "all_late": 0.010,
}
"""Smallest size that is named: share, [m], [rad], [s]."""
STEPS: Final = 3
"""Of Gauss and Newton; nearly all faults are linear."""


class Hypothesis(NamedTuple):
    """Something that may be wrong: its kind, numbers of plates, and the channel or angle."""

    kind: JudgedKind
    plates: tuple[int, ...]
    what: str = ""

    @property
    def misweighs(self) -> bool:
        """Whether steps on these plates do not weigh the subject."""
        return self.what in ("Fz", "all") or self.kind == "exchanged"

    @property
    def sd(self) -> Array:
        """Usual size of its numbers."""
        return np.array(SD.get(self.kind, ()))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The frames by which plates are judged: U of them, in which they carry or a foot stands.

    Attributes
    ----------
    evidence
        Of the trial.
    frames
        Their numbers, (U,).
    of_motion
        Those at which the motion is compared, (F,), numbers within ``frames``.
    stances
        Of each plate, with the numbers of their frames within ``frames``.
    wrenches
        Of each plate in its own axes about the centre of its surface, (U, 6).
    whiten
        By which a residual (6,) about the pelvis has unit variance, (6, 6).
    mass_sd
        Of the body mass.
    """

    evidence: Evidence
    frames: Indices
    of_motion: Indices
    stances: tuple[tuple[tuple[Stance, Indices], ...], ...]
    wrenches: tuple[Array, ...]
    whiten: Array
    mass_sd: float

    @classmethod
    def of(cls, evidence: Evidence, *, mass_is_stated: bool, frames: Mask | None = None) -> "View":
        """Choose the frames, all that carry or some of them, (T,)."""
        use = evidence.carried if frames is None else evidence.carried & frames
        stances = [s for s in find_stances(evidence) if frames is None or frames[s.rows].all()]
        stances = [*_spread_over(stances)]
        carried = _thinned(np.flatnonzero(use), MOST_FRAMES)
        standing = [s.rows for s in stances]
        every = np.unique(np.concatenate([carried, *standing]).astype(int))
        independent = min(use.sum() * evidence.step_s / INDEPENDENT_S, MOST_INDEPENDENT)
        whiten = np.linalg.cholesky(np.linalg.inv(evidence.covariance))
        of_plates = [
            tuple(
                (stance, np.searchsorted(every, rows))
                for stance, rows in zip(stances, standing, strict=True)
                if stance.plate == k
            )
            for k in range(len(evidence.plates))
        ]
        view = cls(
            evidence=evidence,
            frames=every,
            of_motion=np.searchsorted(every, carried),
            stances=tuple(of_plates),
            wrenches=(),
            whiten=whiten * np.sqrt(independent / max(len(carried), 1)),
            mass_sd=MASS_SD[mass_is_stated],
        )
        return replace(view, wrenches=tuple(map(view.at, range(len(of_plates)))))

    def at(self, plate: int, later_s: float = 0.0) -> Array:
        """Give what a plate measures some time after the frames, in its own axes, (U, 6)."""
        evidence, place = self.evidence, self.evidence.plates[plate]
        wrench = evidence.wrenches[plate]
        if later_s:
            times = evidence.time[self.frames] + later_s
            wrench = np.stack([np.interp(times, evidence.time, c) for c in wrench.T], axis=1)
        else:
            wrench = wrench[self.frames]
        return rotate_wrench(shift_wrench(wrench, place.center), place.rotation.T)

    def needed(self) -> Array:
        """Give what the motion needs, in standard deviations, (6 F,)."""
        needed = self.evidence.needed[self.frames[self.of_motion]]
        return np.asarray((needed @ self.whiten).ravel())

    def measured(self, plate: int, wrench: Array) -> Array:
        """Give what a plate adds to that, (6 F,), of its wrench in its own axes, (U, 6)."""
        rows, place = self.of_motion, self.evidence.plates[plate]
        pelvis = self.evidence.pelvis[self.frames[rows]]
        in_lab = rotate_wrench(wrench[rows], place.rotation)
        return np.asarray((shift_wrench(in_lab, pelvis - place.center) @ self.whiten).ravel())

    def feet(self, plate: int, wrench: Array) -> Array:
        """Give how far the pressure on a plate is from the feet, in standard deviations.

        Along, across and up, of the median stance of each foot.
        """
        place, weight_n = self.evidence.plates[plate], self.evidence.weight_n
        away: dict[int, list[Array]] = {}
        for stance, rows in self.stances[plate]:
            in_lab = shift_wrench(rotate_wrench(wrench[rows], place.rotation), -place.center)
            apart = pressure(in_lab, stance.expected[:, 2]) - stance.expected
            # light loads have their pressure anywhere
            load = np.maximum(in_lab[:, 2], 1.0)
            means = [
                (load * (apart * axis).sum(axis=1)).sum() / load.sum()
                for axis in (stance.along, stance.left)
            ]
            down = np.minimum(in_lab[:, 2] / weight_n, 0.0).mean()
            away.setdefault(stance.foot, []).append(np.array([*means / FOOT_SD, down / DOWN_SD]))
        medians = [np.median(stances, axis=0) for stances in away.values()]
        deviations = np.nan_to_num(np.concatenate([np.zeros(0), *medians]))
        return np.asarray(np.clip(deviations, -MOST_DEVIATIONS, MOST_DEVIATIONS))


class Fitted(NamedTuple):
    """A hypothesis with the numbers that fit best, and their covariance.

    Its evidence is twice the logarithm of its odds against no fault.
    """

    hypothesis: Hypothesis
    size: Array
    covariance: Array
    evidence: float

    @property
    def matters(self) -> bool:
        """Whether it is as large as what is named."""
        return bool(np.linalg.norm(self.size) >= LEAST.get(self.hypothesis.kind, 0.0))


def _thinned(rows: Indices, most: int) -> Indices:
    """Give some of many rows, spread evenly."""
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(int)]


def _spread_over(stances: Sequence[Stance]) -> Iterator[Stance]:
    """Give some stances of each foot on each plate, with some of their frames."""
    for key in sorted({(s.plate, s.foot) for s in stances}):
        same = [stance for stance in stances if (stance.plate, stance.foot) == key]
        for k in _thinned(np.arange(len(same)), MOST_STANCES):
            at = _thinned(np.arange(len(same[k].rows)), MOST_OF_STANCE)
            yield same[k].some(at)


def judge_plates(
    evidence: Evidence, *, mass_is_stated: bool, frames: Mask | None = None
) -> tuple[tuple[Fitted, ...], ...]:
    """Name what is wrong with the plates of a trial: each fault, first, with those it may also be.

    Those that are found together are corrected one after the other, and judged again.
    """
    view = View.of(evidence, mass_is_stated=mass_is_stated, frames=frames)
    found: list[tuple[Fitted, ...]] = []
    while len(view.of_motion) and len(found) < MOST_FAULTS:
        likely = [each for each in _fitted_all(view) if each.matters]
        likely.sort(key=lambda each: -each.evidence)
        if not likely or likely[0].evidence < LIMIT:
            break
        best = likely[0]
        found.append(tuple(each for each in likely if each.evidence > best.evidence - TIED))
        if len(found[-1]) > 1:
            break  # what it is has to be known before more can be told
        of_plates = corrected(view, best.hypothesis, best.size)
        wrenches = (of_plates.get(k, wrench) for k, wrench in enumerate(view.wrenches))
        view = replace(view, wrenches=tuple(wrenches))
    return tuple(found)


def hypotheses(view: View) -> Iterator[Hypothesis]:
    """Give what may be wrong with plates that carry."""
    numbers = range(len(view.evidence.plates))
    loaded = (k for k in numbers if view.evidence.loaded_s(k) > MIN_LOADED_S)
    judged = sorted({*loaded, *(k for k in numbers if view.stances[k])})
    for k in judged:
        yield from (Hypothesis("gain", (k,), name) for name in WRENCH_COMPONENTS)
        yield from (Hypothesis("reversed", (k,), name) for name in (*WRENCH_COMPONENTS, "all"))
        yield from (Hypothesis("turned", (k,), degrees) for degrees in ("90", "180", "270"))
        yield Hypothesis("moved", (k,))
        yield Hypothesis("askew", (k,))
        if len(judged) > 1:
            yield Hypothesis("late", (k,))
    yield from (Hypothesis("exchanged", pair) for pair in combinations(judged, 2))
    yield Hypothesis("all_late", tuple(numbers))


def corrected(view: View, hypothesis: Hypothesis, size: Array) -> dict[int, Array]:
    """Give what the plates of a fault would measure without it, in their own axes, (U, 6)."""
    k, what = hypothesis.plates[0], hypothesis.what
    plate, wrench = view.evidence.plates[k], view.wrenches[k]
    match hypothesis.kind:
        case "gain":
            one = np.diag([float(name == what) for name in WRENCH_COMPONENTS])
            return {k: of_channels(plate, np.eye(6) + size[0] * one, wrench)}
        case "reversed":
            return {k: of_channels(plate, reversing(what), wrench)}
        case "turned":
            return {k: of_channels(plate, turning(what), wrench)}
        case "exchanged":
            i, j = hypothesis.plates
            return {i: view.wrenches[j], j: view.wrenches[i]}
        case "moved":
            # the same wrench acts at another place: its moment about the old one
            return {k: shift_wrench(wrench, -np.array([*size, 0.0]))}
        case "askew":
            turn = rotation_about(plate.rotation.T @ UP, float(size[0]))
            return {k: rotate_wrench(wrench, turn)}
    return {k: view.at(k, float(size[0])) for k in hypothesis.plates}


def _fitted_all(view: View) -> Iterator[Fitted]:
    """Fit every hypothesis; each against the same plates without a fault."""
    plain = _Comparison.of(view)
    return (plain.fit(hypothesis) for hypothesis in hypotheses(view))


def fit(view: View, hypothesis: Hypothesis) -> Fitted:
    """Fit one hypothesis to other frames."""
    return _Comparison.of(view).fit(hypothesis)


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """What plates leave without a fault: their parts in it, and its score and spread."""

    view: View
    needed: Array
    measured: tuple[Array, ...]
    feet: tuple[Array, ...]
    score: float
    spread: float

    @classmethod
    def of(cls, view: View) -> "_Comparison":
        """Compare plates as they are."""
        numbers = range(len(view.wrenches))
        measured = tuple(view.measured(k, view.wrenches[k]) for k in numbers)
        feet = tuple(view.feet(k, view.wrenches[k]) for k in numbers)
        plain = cls(view, view.needed(), measured, feet, 0.0, 0.0)
        *_, score, spread = plain._least(None)
        return replace(plain, score=score, spread=spread)

    def fit(self, hypothesis: Hypothesis) -> Fitted:
        """Fit a hypothesis, and compare what it leaves."""
        size, covariance, score, spread = self._least(hypothesis)
        gained = self.score - score - (spread - self.spread) - COST[hypothesis.kind]
        return Fitted(hypothesis, size, covariance, gained)

    def _left(self, hypothesis: Hypothesis | None, x: Array) -> Array:
        """Give residual and feet with a body that is heavier by a share, and a fault of a size."""
        residual = (1 + x[0]) * self.needed - np.sum(self.measured, axis=0)
        if hypothesis is None:
            return np.asarray(residual)
        of_plates, view = corrected(self.view, hypothesis, x[1:]), self.view
        for k in hypothesis.plates:
            residual = residual + self.measured[k] - view.measured(k, of_plates[k])
        return np.concatenate([residual, *(view.feet(k, of_plates[k]) for k in hypothesis.plates)])

    def _least(self, hypothesis: Hypothesis | None) -> tuple[Array, Array, float, float]:
        """Give size and covariance of the fault that leaves least, the score and its spread."""
        changed = () if hypothesis is None else hypothesis.plates
        others = sum(float(f @ f) for k, f in enumerate(self.feet) if k not in changed)
        sd = np.array([self.view.mass_sd, *(() if hypothesis is None else hypothesis.sd)])
        x = np.zeros(len(sd))
        for _ in range(STEPS if len(sd) > 1 else 1):
            here = self._left(hypothesis, x)
            small = np.diag(1e-3 * sd)
            slopes = np.stack(
                [(self._left(hypothesis, x + step) - here) / step.sum() for step in small], axis=1
            )
            # Gauss and Newton, with what is usual before anything is seen
            information = slopes.T @ slopes + np.diag(sd**-2.0)
            step = np.linalg.solve(information, slopes.T @ here + x / sd**2)
            x = x - np.clip(step, -3 * sd, 3 * sd)
        left = self._left(hypothesis, x)
        score = float(left @ left + np.sum((x / sd) ** 2)) + others
        # a fault that may have many sizes is less likely to have this one
        spread = float(np.linalg.slogdet(information * np.outer(sd, sd))[1])
        return x[1:], np.linalg.inv(information)[1:, 1:], score, spread
