"""One judge of plates: everything that may be wrong with them, weighed by what it leaves.

The score is the residual of the whole body, whitened by what healthy bodies and segments without
markers leave, and how far the pressure on each plate is from the foot that stands there. Body mass
is uncertain in every comparison. A fault is named if correcting it lowers the score by more than
healthy recordings ever show; faults that lower it almost alike are named together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from compensation.inertia.sensors import QUANTILE_95
from hbm.coordinates import UP
from hbm.numbers import read_numbers
from hbm.spatial import (
    WRENCH_COMPONENTS,
    Array,
    Indices,
    Mask,
    rotate_wrench,
    rotation_about,
    shift_wrench,
)
from pipeline.io.mended_plates import reversing, turning
from pipeline.trial.findings.evidence import Evidence, Stance, find_stances, pressure
from pipeline.trial.findings.finding import JudgedKind

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "judge")


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
    def weighs(self) -> bool:
        """Whether it is a wrong body weight on one plate."""
        return self.kind == "gain" and self.what == "Fz"

    @property
    def sd(self) -> Array:
        """Usual size of its numbers."""
        return np.array(LIMITS.usual_size.get(self.kind, ()))


class Stances(NamedTuple):
    """The stances on one plate, N frames of S of them after each other.

    Attributes
    ----------
    rows
        Numbers of the frames, (N,).
    starts, feet
        Where each stance begins in them, and whether it is of the left or the right foot, (S,).
    along, left, expected
        As of `Stance`, (N, 3).
    """

    rows: Indices
    starts: Indices
    feet: Indices
    along: Array
    left: Array
    expected: Array

    @classmethod
    def joined(cls, stances: Sequence[Stance], frames: Indices) -> "Stances":
        """Join stances whose frames are among those of a view."""
        rows = [np.zeros(0, int), *(stance.rows for stance in stances)]
        lengths = [len(stance.rows) for stance in stances]
        axes = (
            np.concatenate([np.zeros((0, 3)), *(getattr(stance, name) for stance in stances)])
            for name in ("along", "left", "expected")
        )
        starts = np.cumsum([0, *lengths])[: len(stances)]
        feet = np.array([stance.foot for stance in stances], int)
        return cls(np.searchsorted(frames, np.concatenate(rows)), starts, feet, *axes)

    def sums(self, values: Array) -> Array:
        """Give the sums of values, (..., N), over each stance, (..., S)."""
        return np.asarray(np.add.reduceat(values, self.starts, axis=-1))


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
    signals
        Of each plate at all times, in its own axes about the centre of its surface, (T, 6).
    wrenches
        The same at the frames, (U, 6).
    to_lab
        Of each plate: matrix by which these are multiplied, for lab axes about the lab origin.
    to_residual
        Of each plate, and each of the F frames, (F, 6, 6): for residuals in standard deviations.
    to_channels, from_channels
        Of each plate: about its transducer, where channels are, and back.
    whiten
        By which a residual (6,) about the pelvis has unit variance, (6, 6).
    mass_sd
        Of the body mass.
    independent
        Values of the motion that are about independent.
    """

    evidence: Evidence
    frames: Indices
    of_motion: Indices
    stances: tuple[Stances, ...]
    signals: tuple[Array, ...]
    wrenches: tuple[Array, ...]
    to_lab: tuple[Array, ...]
    to_residual: tuple[Array, ...]
    to_channels: tuple[Array, ...]
    from_channels: tuple[Array, ...]
    whiten: Array
    mass_sd: float
    independent: float

    @classmethod
    def of(cls, evidence: Evidence, *, mass_is_stated: bool, frames: Mask | None = None) -> "View":
        """Choose the frames, all that carry or some of them, (T,)."""
        frames = np.ones(len(evidence.time), bool) if frames is None else frames
        # who stands has the same error in all frames: only frames of walking count
        use = evidence.carried & evidence.walking & frames
        measured: Mask = np.isfinite(evidence.wrenches).all(axis=(0, 2)) & frames
        stances = [*_spread_over([s for s in find_stances(evidence) if measured[s.rows].all()])]
        # more frames than these cost time and tell the same as their neighbours
        carried = _thinned(np.flatnonzero(use), 150)
        rows = np.unique(np.concatenate([carried, *(s.rows for s in stances)]).astype(int))
        # samples that are about independent: one in each stretch of correlated errors
        independent = min(
            use.sum() * evidence.step_s / LIMITS.independent_after, LIMITS.most_independent
        )
        # residual @ whiten has unit variance: whiten whiten^T is the inverse covariance
        whiten = np.linalg.cholesky(np.linalg.inv(evidence.covariance))
        of_plates = [
            Stances.joined([stance for stance in stances if stance.plate == k], rows)
            for k in range(len(evidence.plates))
        ]
        # all frames together weigh as much as the independent samples among them
        whiten *= np.sqrt(independent / max(len(carried), 1))
        places, pelvis = evidence.plates, evidence.pelvis[carried]
        # wrenches are rows, so that what is done to those of unit size is the matrix of it
        units = [rotate_wrench(np.eye(6), place.rotation) for place in places]
        # residuals are about the pelvis, which moves from frame to frame
        to_pelvis = [
            shift_wrench(unit, (pelvis - place.center)[:, None])
            for unit, place in zip(units, places, strict=True)
        ]
        view = cls(
            evidence=evidence,
            frames=rows,
            of_motion=np.searchsorted(rows, carried),
            stances=tuple(of_plates),
            signals=tuple(
                rotate_wrench(shift_wrench(np.nan_to_num(w), p.center), p.rotation.T)
                for w, p in zip(evidence.wrenches, places, strict=True)
            ),
            wrenches=(),
            to_lab=tuple(shift_wrench(u, -p.center) for u, p in zip(units, places, strict=True)),
            to_residual=tuple(shifted @ whiten for shifted in to_pelvis),
            to_channels=tuple(shift_wrench(np.eye(6), place.transducer) for place in places),
            from_channels=tuple(shift_wrench(np.eye(6), -place.transducer) for place in places),
            whiten=whiten,
            mass_sd=LIMITS.stated_mass_spread if mass_is_stated else LIMITS.weighed_mass_spread,
            independent=6 * independent,
        )
        return replace(view, wrenches=tuple(view.at(k, np.zeros(1))[0] for k in range(len(places))))

    def at(self, plate: int, later_s: Array) -> Array:
        """Give what a plate that is later by N times measures at the frames, (N, U, 6)."""
        time, wrench = self.evidence.time, self.signals[plate]
        # a late plate sends later what it carried at a frame, and the body seems early
        times = (time[self.frames] + (LIMITS.body_lag + later_s[:, None])).clip(time[0], time[-1])
        # on straight lines, at once for all channels
        after = time.searchsorted(times).clip(1)
        fraction = (times - time[after - 1]) / (time[after] - time[after - 1])
        before = wrench[after - 1]
        return np.asarray(before + fraction[..., None] * (wrench[after] - before))

    def measured(self, plate: int, wrench: Array) -> Array:
        """Give what a plate adds to the residual, in standard deviations, (H, 6 F).

        Of wrenches in its own axes, (H, U, 6).
        """
        # frame by frame, so that all wrenches of a frame are one product
        of_frames = np.swapaxes(wrench[:, self.of_motion], 0, 1) @ self.to_residual[plate]
        return np.swapaxes(of_frames, 0, 1).reshape(len(wrench), -1)

    def feet(self, plate: int, wrench: Array, signal: int) -> Array:
        """Give how far the pressure on a plate is from the feet, in standard deviations, (H, N).

        Of wrenches in its own axes, (H, U, 6). Along, across and up, of the median stance of each
        foot. The stances are those at which the plate is loaded, or another one whose signal it
        has.
        """
        stances = self.stances[signal]
        if not len(stances.feet):
            return np.zeros((len(wrench), 0))
        # centre of pressure at the height of the sole, and how far it is from its usual place [m]
        in_lab = wrench[:, stances.rows] @ self.to_lab[plate]
        apart = pressure(in_lab, stances.expected[:, 2]) - stances.expected
        # light loads have their pressure anywhere
        load = np.maximum(in_lab[..., 2], 1.0)
        sums = [
            stances.sums(load * np.vecdot(apart, axis)) for axis in (stances.along, stances.left)
        ]
        # means of a stance, weighted by load, in standard deviations of healthy people
        away = np.stack(sums, axis=1) / (stances.sums(load)[:, None] * LIMITS.foot_spread[:, None])
        # mean downward pull of a stance, which no foot exerts
        down = (
            stances.sums(np.minimum(in_lab[..., 2] / self.evidence.weight_n, 0.0))
            / LIMITS.pull_spread
        )
        count = np.diff(stances.starts, append=len(stances.rows))
        away = np.concatenate([away, (down / count)[:, None]], axis=1)
        # a median over stances, since a foot may land half beside a plate
        of_foot = (away[..., stances.feet == k] for k in np.unique(stances.feet))
        medians = [np.median(stances_of_foot, axis=-1) for stances_of_foot in of_foot]
        deviations = np.nan_to_num(np.concatenate(medians, axis=1))
        return np.asarray(np.clip(deviations, -LIMITS.most_deviations, LIMITS.most_deviations))


class Fitted(NamedTuple):
    """A hypothesis with the numbers that fit best, and their covariance.

    Its evidence is twice the logarithm of its odds against no fault.
    """

    hypothesis: Hypothesis
    size: Array
    covariance: Array
    evidence: float

    @property
    def interval(self) -> Array:
        """Half of the 95 % interval of its numbers."""
        return np.asarray(QUANTILE_95 * np.sqrt(np.diag(self.covariance)))

    @property
    def matters(self) -> bool:
        """Whether it is as large as what is named."""
        most = LIMITS.longest_move if self.hypothesis.kind == "moved" else np.inf
        least = LIMITS.least_size.get(self.hypothesis.kind, 0.0)
        return bool(least <= float(np.linalg.norm(self.size)) <= most)


def _thinned(rows: Indices, most: int) -> Indices:
    """Give some of many rows, spread evenly."""
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(int)]


def _spread_over(stances: Sequence[Stance]) -> Iterator[Stance]:
    """Give some stances of each foot on each plate, with some of their frames."""
    for key in sorted({(s.plate, s.foot) for s in stances}):
        same = [stance for stance in stances if (stance.plate, stance.foot) == key]
        # ten stances of twelve frames each tell what all would
        for k in _thinned(np.arange(len(same)), 10):
            at = _thinned(np.arange(len(same[k].rows)), 12)
            yield same[k].some(at)


def judge_plates(evidence: Evidence, *, mass_is_stated: bool) -> tuple[Fitted, ...]:
    """Name what is most likely wrong with the plates of a trial, first, and what it may also be.

    Nothing where no fault is likely.
    """
    view = View.of(evidence, mass_is_stated=mass_is_stated)
    likely = _likely(view)
    if likely and likely[0].hypothesis.kind == "mass":
        # it is said where masses are compared; plates are judged whatever it is
        likely = _likely(replace(view, mass_sd=LIMITS.wrong_mass_spread))
    return likely


def instead_of_mass(evidence: Evidence, *, mass_is_stated: bool) -> tuple[Fitted, ...]:
    """Give faults of plates that a body mass that steps contradict may be instead.

    Gains of vertical forces that explain almost as much, and whatever explains far more.
    """
    plain = _Comparison.of(View.of(evidence, mass_is_stated=mass_is_stated))
    # how well another body mass alone explains the same
    one_mass = plain.fit([Hypothesis("mass", ())])[0].evidence
    fitted = plain.fit([fault for fault in hypotheses(plain.view) if fault.plates])
    return tuple(
        fault
        for fault in fitted
        if fault.matters
        and fault.evidence
        > (one_mass - LIMITS.tied if fault.hypothesis.weighs else max(one_mass + LIMITS.tied, 0.0))
    )


def _likely(view: View) -> tuple[Fitted, ...]:
    """Give the most likely fault, and those that are almost as likely."""
    # nothing to judge by: no frame under load, and no single foot on a plate
    if not (len(view.of_motion) or any(len(stances.feet) for stances in view.stances)):
        return ()
    plain = _Comparison.of(view)
    fitted = [fault for fault in plain.fit([*hypotheses(view)]) if fault.matters]
    fitted.sort(key=lambda fault: -fault.evidence)
    best = fitted[0].evidence if fitted else 0.0
    return tuple(
        fault
        for fault in fitted
        if best > LIMITS.least_evidence and fault.evidence > best - LIMITS.tied
    )


def hypotheses(view: View) -> Iterator[Hypothesis]:
    """Give what may be wrong with plates that carry."""
    numbers = range(len(view.evidence.plates))
    # once the mass is taken as wrong it is fitted in every comparison
    if view.mass_sd < LIMITS.wrong_mass_spread:
        yield Hypothesis("mass", ())
    # plates on which somebody was for long enough, or a single foot
    loaded = (k for k in numbers if view.evidence.loaded_s(k) > LIMITS.independent_after)
    judged = sorted({*loaded, *(k for k in numbers if len(view.stances[k].feet))})
    for k in judged:
        yield from (Hypothesis("gain", (k,), name) for name in WRENCH_COMPONENTS)
        yield from (Hypothesis("reversed", (k,), name) for name in (*WRENCH_COMPONENTS, "all"))
        yield from (Hypothesis("turned", (k,), degrees) for degrees in ("90", "180", "270"))
        yield Hypothesis("moved", (k,))
        yield Hypothesis("askew", (k,))
        # a single plate that is late is the same as all plates that are late
        if len(judged) > 1:
            yield Hypothesis("late", (k,))
    yield from (Hypothesis("exchanged", pair) for pair in combinations(judged, 2))
    yield Hypothesis("all_late", tuple(numbers))


def corrected(view: View, hypothesis: Hypothesis, sizes: Array) -> dict[tuple[int, int], Array]:
    """Give what plates would measure without a fault of N sizes, (N, S), in their axes, (N, U, 6).

    By the plate, and the one whose signal it is.
    """
    match hypothesis.kind:
        case "mass":
            return {}
        case "exchanged":
            i, j = hypothesis.plates
            return {(i, j): view.wrenches[j][None], (j, i): view.wrenches[i][None]}
        case "late" | "all_late":
            return {(k, k): view.at(k, sizes[:, 0]) for k in hypothesis.plates}
    (k,) = hypothesis.plates
    return {(k, k): view.wrenches[k] @ correcting(view, hypothesis, sizes)}


def correcting(view: View, hypothesis: Hypothesis, sizes: Array) -> Array:
    """Give the matrices by which the wrenches of a plate lose a fault of N sizes, (N, 6, 6)."""
    (k,), what = hypothesis.plates, hypothesis.what
    match hypothesis.kind:
        case "moved":
            # the same wrench acts at another place: its moment about the old one
            return shift_wrench(np.eye(6), -(sizes @ np.eye(2, 3))[:, None])
        case "askew":
            # about the vertical, as the plate's axes see it
            upright = view.evidence.plates[k].rotation.T @ UP
            return rotate_wrench(np.eye(6), rotation_about(upright, sizes))
        case "gain":
            # (1 + size) × one channel, the others as they are
            alone = np.diag(np.eye(6)[WRENCH_COMPONENTS.index(what)])
            channels = np.eye(6) + sizes[..., None] * alone
        case "reversed":
            channels = reversing(what)[None]
        case _:
            channels = turning(what)[None]
    # rows: about the transducer, where channels are, then corrected, then back to the centre
    return np.asarray(view.to_channels[k] @ channels.mT @ view.from_channels[k])


def fit(view: View, hypothesis: Hypothesis) -> Fitted:
    """Fit one hypothesis to other frames."""
    return _Comparison.of(view).fit([hypothesis])[0]


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """What plates leave without a fault: what each adds to that, and its score and spread.

    A row is R numbers: the residual, then the feet on each plate, whose place in it is ``feet``.
    """

    view: View
    plain: Array
    heavier: Array
    measured: tuple[Array, ...]
    feet: tuple[slice, ...]
    score: float = 0.0
    spread: float = 0.0

    @classmethod
    def of(cls, view: View) -> "_Comparison":
        """Compare plates as they are."""
        # what the motion needs, in standard deviations, and what plates add
        needed = (view.evidence.needed[view.frames[view.of_motion]] @ view.whiten).ravel()
        wrenches = [*enumerate(view.wrenches)]
        measured = tuple(view.measured(k, wrench[None])[0] for k, wrench in wrenches)
        feet = [view.feet(k, wrench[None], k)[0] for k, wrench in wrenches]
        ends = np.cumsum([len(needed), *map(len, feet)]).tolist()
        # a body that is heavier by a share needs as much more; the feet stay
        heavier = np.pad(needed, (0, ends[-1] - len(needed)))
        # residual: what the motion needs less what all plates measure
        row = np.concatenate([needed - np.sum(measured, axis=0), *feet])
        plain = cls(view, row, heavier, measured, tuple(map(slice, ends[:-1], ends[1:])))
        # even without a fault, the body mass is fitted
        _, _, (score,), (spread,) = plain._least([Hypothesis("mass", ())], [view.mass_sd])
        return replace(plain, score=score, spread=spread)

    def fit(self, hypotheses: Sequence[Hypothesis]) -> list[Fitted]:
        """Fit hypotheses, and compare what they leave; those with as many sizes at once."""
        fitted, alike = dict[Hypothesis, Fitted](), dict[int, list[Hypothesis]]()
        for hypothesis in hypotheses:
            alike.setdefault(len(hypothesis.sd), []).append(hypothesis)
        for group in alike.values():
            # only where the mass is the fault may it be far off
            mass_sd = [
                self.view.mass_sd if fault.plates else LIMITS.wrong_mass_spread for fault in group
            ]
            size, covariance, score, spread = self._least(group, mass_sd)
            # twice the logarithm of the odds: fit, less freedom to fit, less rarity
            fall = self._unlikely(self.score) - self._unlikely(score)
            gained = fall - (spread - self.spread) - [LIMITS.rarity[fault.kind] for fault in group]
            fitted |= zip(group, map(Fitted, group, size, covariance, gained.tolist()), strict=True)
        return [fitted[hypothesis] for hypothesis in hypotheses]

    def _unlikely(self, score: Array | float) -> Array:
        """Give how unlikely a sum of squares is that has a scale of its own, after Student."""
        # number of values: of the motion and of the feet
        values = self.view.independent + len(self.plain) - self.feet[0].start
        return np.asarray((values + LIMITS.freedom) * np.log1p(score / LIMITS.freedom))

    def _left(self, alike: Sequence[Hypothesis], sizes: Array) -> Array:
        """Give residual and feet, (H, N, R), without each of H faults of N sizes, (H, N, S)."""
        # hypotheses that change the same plate are computed together
        of_plates = dict[tuple[int, int], dict[int, Array]]()
        for row, fault in enumerate(zip(alike, sizes, strict=True)):
            for places, wrench in corrected(self.view, *fault).items():
                of_plates.setdefault(places, {})[row] = wrench
        rows = np.tile(self.plain, (*sizes.shape[:2], 1))
        for (k, signal), of_rows in of_plates.items():
            faults, wrenches = [*of_rows], np.concatenate([*of_rows.values()])
            # residual without the fault: what the plate added, less what it should add
            change = self.measured[k] - self.view.measured(k, wrenches)
            feet = self.view.feet(k, wrenches, signal)
            of_sizes = len(faults), rows.shape[1]
            rows[faults, :, : change.shape[1]] += change.reshape(*of_sizes, change.shape[1])
            rows[faults, :, self.feet[signal]] = feet.reshape(*of_sizes, feet.shape[1])
        return rows

    def _least(
        self, alike: Sequence[Hypothesis], mass_sd: Sequence[float]
    ) -> tuple[Array, Array, Array, Array]:
        """Give size and covariance of each fault that leave least, the scores and their spreads.

        Of H faults with as many sizes, S: (H, S), (H, S, S), (H,) and (H,).
        """
        # prior of body mass and sizes; a size starts from none
        sd = np.array([[mass, *fault.sd] for mass, fault in zip(mass_sd, alike, strict=True)])
        x, small = np.zeros(sd.shape), 1e-3 * sd[:, 1:]
        # a fault as it is, and larger along each of its sizes
        larger = np.eye(small.shape[1] + 1)[:, 1:] * small[:, None]
        heavier = np.broadcast_to(self.heavier, (len(sd), 1, len(self.heavier)))
        # nearly all faults are linear in their sizes: three steps are enough
        for _ in range(3 if small.size else 1):
            at_once = self._left(alike, x[:, None, 1:] + larger)
            # derivatives of residual and feet by each size, by differences
            plain, changed = at_once[:, 0], at_once[:, 1:] - at_once[:, :1]
            rows = np.concatenate([heavier, changed / small[..., None]], axis=1)
            here = plain + x[:, :1] * self.heavier
            # Gauss and Newton, with what is usual before anything is seen
            information = rows @ rows.mT + np.eye(sd.shape[1]) / sd[:, None] ** 2
            step = np.linalg.solve(
                information, (np.vecdot(rows, here[:, None]) + x / sd**2)[..., None]
            )
            # no step beyond three standard deviations, where a fault is no longer linear
            x = x - np.clip(step[..., 0], -3 * sd, 3 * sd)
        plain = self._left(alike, x[:, None, 1:])[:, 0] if small.size else plain
        rest = plain + x[:, :1] * self.heavier
        # sum of squares of what is left, and of sizes by their prior
        score = np.vecdot(rest, rest) + np.sum((x / sd) ** 2, axis=1)
        # a fault that may have many sizes is less likely to have this one
        spread = np.linalg.slogdet(information * sd[:, None] * sd[:, :, None])[1]
        return x[:, 1:], np.linalg.inv(information)[:, 1:, 1:], score, spread
