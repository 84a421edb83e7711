"""The verdict of experiment 1: whether each plate is accurate enough, and what to correct."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from compensation import PlateCalibration
from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS
from pipeline.config.plate_study import BeltSide
from pipeline.plate_accuracy.accuracy import PlateAccuracy
from pipeline.plate_accuracy.faults import FaultEstimate
from pipeline.plate_accuracy.judgement import (
    DISPLAY_UNITS,
    TOTAL,
    Judged,
    delay_notes,
    either,
    judge_faults,
    judge_linearity,
    judge_noise,
    judge_totals,
    judge_unexamined,
    plate_calibration,
    rounded,
)
from pipeline.plate_accuracy.response import (
    EXCITED,
    MIN_MASSES,
    MY,
    QUANTITIES,
    quantities_of,
    stance_loads,
)

GAIN: Final = "gain of "
"""With which the names begin of faults that a common misstatement of all masses causes alike."""


def shared_gain(faults: Sequence[FaultEstimate], most: float) -> float:
    """Find the part of all gains that one misstatement of all masses would explain.

    Parameters
    ----------
    faults
        Of all plates on which the same masses were recorded.
    most
        By which share all masses may be misstated at most.

    Returns
    -------
    float
        The mean gain less 1, weighted by precision, but not beyond the 95 % interval of any gain:
        where a plate or a component is right, or gains differ in sign, next to nothing is shared.
    """
    gains = [fault for fault in faults if fault.fault.startswith(GAIN)]
    if not gains:
        return 0.0
    value, half = np.array([(one.value, one.uncertainty) for one in gains]).T
    half = np.maximum(half, np.finfo(float).eps)
    mean = float(np.average(value, weights=half**-2))
    side = np.sign(mean)
    return float(side * max(min(side * mean, np.min(side * value + half), most), 0.0))


def with_heavier_masses(found: PlateAccuracy, share: float) -> PlateAccuracy:
    """Give the gains, responses and linearities as if all masses were heavier by a share."""
    real = 1 + share
    responses = {}
    for belt, response in found.responses.items():
        matrix = response.matrix.copy()
        matrix[:, :, response.examined] /= real
        responses[belt] = replace(response, matrix=matrix, curvature=response.curvature / real**2)
    return replace(
        found,
        responses=responses,
        linearities={b: replace(x, slope=x.slope / real) for b, x in found.linearities.items()},
        faults=tuple(
            replace(one, value=(1 + one.value) / real - 1) if one.fault.startswith(GAIN) else one
            for one in found.faults
        ),
    )


Answer = Literal["fit", "fit after correction", "not fit", "cannot be told"]
MAX_FAULTS: Final = 3
MAX_TOTALS: Final = 2
"""In the sentence of a verdict; verdict.md lists all."""
COEFFICIENTS: Final = len(EXCITED) + 4
"""Of a plate's response: with a constant, time, the delay and the curvature."""
AXES: Final = {"x": "forward", "y": "lateral", "z": "vertical"}
PARTS: Final = {"F": "{} force", "COP": "{} centre of pressure", "M": "moment about the {} axis"}
"""First letters of a quantity -> the words for it along or about its axes."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a plate is fit, and for what: nothing is fit that was not examined.

    Attributes
    ----------
    answer
        Of what was examined.
    unexamined
        Quantities, of `stance.QUANTITIES`, that depend on what no recording examined.
    """

    answer: Answer
    unexamined: tuple[str, ...]

    def __str__(self) -> str:
        scope = "inverse dynamics"
        if self.unexamined:
            scope = _in_words(tuple(q for q in QUANTITIES if q not in self.unexamined)) or scope
        words = {
            "fit": f"fit for {scope}",
            "fit after correction": (
                f"not fit for inverse dynamics as it is; fit after correction for {scope}"
            ),
            "not fit": "not fit for inverse dynamics",
            "cannot be told": f"whether it is fit for {scope} cannot be told",
        }[self.answer]
        return f"{words}; not examined: {_in_words(self.unexamined)}" if self.unexamined else words


def _in_words(quantities: tuple[str, ...]) -> str:
    parts = []
    for letters, words in PARTS.items():
        axes = [AXES[name[-1]] for name in quantities if name[:-1] == letters]
        if axes:
            parts.append(words.format(" and ".join(axes).replace(" and ", ", ", len(axes) - 2)))
    return ", ".join(parts)


@dataclass(frozen=True, slots=True)
class PlateVerdict:
    """Whether a plate is fit for inverse dynamics.

    Attributes
    ----------
    belt
        The plate.
    judged
        Every estimate and total error beside its limit.
    corrected
        Total errors after correction; empty where nothing is to be corrected.
    to_record
        What is missing for a verdict.
    remarks
        What else was not examined.
    notes
        Contradictions between methods.
    calibration
        The correction of the plate; None where nothing is to be corrected, and where none is
        known that leaves no total error both beyond its limit and larger than without it.
    with_supports
        True where there are recordings with and without supports: the verdict is for use with them.
    largest_n
        Heaviest of these weights [N].
    constant
        Components, in the plate's own axes, that never changed in any recording.
    unexamined
        Quantities that depend on what no recording examined.
    shared
        Part of all gains that masses heavier by this share would explain as well; 0 where that
        makes no difference to any status.
    """

    belt: BeltSide
    judged: tuple[Judged, ...]
    corrected: tuple[Judged, ...]
    to_record: tuple[str, ...]
    remarks: tuple[str, ...]
    notes: tuple[Note, ...]
    calibration: PlateCalibration | None
    with_supports: bool
    largest_n: float
    constant: tuple[str, ...]
    unexamined: tuple[str, ...]
    shared: float

    @property
    def verdict(self) -> Verdict:
        """The verdict: by what is beyond its limit first, then by what is not known."""
        return Verdict(self._answer, self.unexamined)

    @property
    def _answer(self) -> Answer:
        statuses = {one.status for one in self.judged}
        if self.constant:
            return "not fit"
        if "beyond" in statuses:
            enough = {one.status for one in self._left} <= {"within", "not examined"}
            known = self.calibration is not None and not self.to_record
            return "fit after correction" if enough and known else "not fit"
        unknown = self.to_record or self.shared or "unclear" in statuses
        return "cannot be told" if unknown else "fit"

    @property
    def _left(self) -> tuple[Judged, ...]:
        """What a correction leaves."""
        return (*(one for one in self.judged if one.remedy == "none"), *self.corrected)

    @property
    def reasons(self) -> tuple[Judged, ...]:
        """What the verdict is for: single faults, then total errors, the largest first."""
        if self._answer == "cannot be told":
            found = [one for one in self.judged if one.status == "unclear"]
        else:
            found = [one for one in self.judged if one.status == "beyond"]
        left = [one for one in self._left if one.status == "beyond"]
        if self._answer == "not fit" and left:
            by_themselves = self.calibration is not None or any(one in left for one in found)
            found = left if by_themselves else [*found, *left]
        return tuple(
            sorted(found, key=lambda one: (one.name.startswith(TOTAL), -one.size / one.limit))
        )

    @property
    def corrections(self) -> tuple[str, ...]:
        """What to do about what can be corrected; nothing makes a plate fit that is not."""
        lines = []
        if self.calibration is not None and self._answer != "not fit":
            lines.append("apply the plate's calibration (plate_calibration.json)")
            if self.calibration.offset.any():
                lines.append(
                    "zero the plate before every recording: the calibration subtracts the zero "
                    "that these recordings had"
                )
        return tuple(lines)

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        used = " with supports" if self.with_supports else ""
        start, reasons = f"{self.belt} plate{used}: {self.verdict}.", self._listed_reasons()
        unknown = f"Loads above the largest recorded one ({self.largest_n:.0f} N) are extrapolated."
        if self._answer == "fit":
            return f"{start} {unknown}"
        missing = "; ".join([*self.to_record, *self._advice()])
        if self._answer == "fit after correction":
            needed = "; ".join(self.corrections)
            return f"{start} To correct: {needed}. Found: {reasons}. {unknown}"
        if self._answer == "not fit":
            rest = (
                "" if self._final else f" Whether a correction is enough cannot be told: {missing}."
            )
            return f"{start} Found: {reasons}.{rest}"
        known = f" Undecided: {reasons}." if reasons else ""
        return f"{start} To do: {missing}.{known}"

    @property
    def _final(self) -> bool:
        """True if no recording can show that a correction of the plate is enough."""
        beyond = any(one.status == "beyond" for one in self._left)
        examined = any(one.name.startswith(TOTAL) for one in self.judged)
        by_calibration = self.corrected or self.shared
        return bool(self.constant) or beyond or (examined and not by_calibration)

    def _listed_reasons(self) -> str:
        """List the largest of the single faults and of the total errors."""
        totals = [one for one in self.reasons if one.name.startswith(TOTAL)]
        singles = [one for one in self.reasons if one not in totals]
        listed = [
            f"{name} in the plate's own axes never changed under any weight: it is not connected "
            "or was not recorded"
            for name in self.constant
        ]
        listed += [one.sentence for one in (*singles[:MAX_FAULTS], *totals[:MAX_TOTALS])]
        if more := len(singles[MAX_FAULTS:]) + len(totals[MAX_TOTALS:]):
            listed.append(f"and {more} more")
        return "; ".join(listed)

    def _advice(self) -> list[str]:
        """Say what to do about the masses, or about what is unclear."""
        if self.shared:
            size = f"{100 * abs(self.shared):.2g} %"
            heavier, high = ("heavier", "high") if self.shared > 0 else ("lighter", "low")
            return [
                "weigh the masses with a second balance, and correct mass_kg or state "
                "mass_uncertainty_percent: all gains of every plate are "
                f"{size} too {high}, or all masses as much {heavier} than stated"
            ]
        unclear = [one for one in (*self.judged, *self.corrected) if one.status == "unclear"]
        near = min(unclear, key=lambda one: abs(one.size / one.limit - 1), default=None)
        return (
            [] if near is None else [f"record more weights on this plate: {near.name} is unclear"]
        )


def judge(found: PlateAccuracy) -> tuple[PlateVerdict, ...]:
    """Judge whether plates are fit for inverse dynamics, by the study's limits.

    Parameters
    ----------
    found
        The results.

    Returns
    -------
    tuple[PlateVerdict, ...]
        One per plate. Total errors are those at loads of a person of the stated mass: the linear
        response and its curvature are extrapolated from the weights, with their uncertainty; what
        neither describes at larger loads is not known.
    """
    belts = dict.fromkeys(trial.weight.belt for trial in found.trials)
    return tuple(_judge_plate(found, belt) for belt in belts)


def _judge_plate(found: PlateAccuracy, belt: BeltSide) -> PlateVerdict:
    own = [trial for trial in found.trials if trial.weight.belt == belt]
    in_use = [trial for trial in found.trials_in_use if trial.weight.belt == belt]
    shared = _shared_gain(found, belt)
    heavier = with_heavier_masses(found, shared)
    stated, otherwise = _judged(found, belt), _judged(heavier, belt)
    judged = either(stated, otherwise)
    if any(one.status != other.status for one, other in zip(stated, otherwise, strict=True)):
        corrected, calibration = list[Judged](), None
    else:
        shared = 0.0
        corrected, calibration = _correction(found, heavier, belt, judged)
    constant = np.all([trial.constant for trial in own], axis=0)
    return PlateVerdict(
        belt,
        tuple(judged),
        tuple(corrected),
        _to_record(found, belt),
        _remarks(found, belt),
        delay_notes(_faults(found, belt)),
        calibration,
        with_supports=len({trial.weight.supports for trial in own}) > 1,
        largest_n=GRAVITY_MPS2 * max(trial.weight.mass_kg for trial in in_use),
        constant=tuple(name for name, one in zip(WRENCH_COMPONENTS, constant, strict=True) if one),
        unexamined=_unexamined(found, belt),
        shared=shared,
    )


def _faults(found: PlateAccuracy, belt: BeltSide) -> list[FaultEstimate]:
    return [fault for fault in found.faults if fault.belt == belt]


def _shared_gain(found: PlateAccuracy, belt: BeltSide) -> float:
    """Give the part that all gains share of the plates on which a plate's masses were recorded."""
    masses: dict[BeltSide, set[float]] = {}
    for trial in found.trials_in_use:
        masses.setdefault(trial.weight.belt, set()).add(trial.weight.mass_kg)
    faults = [fault for fault in found.faults if masses[fault.belt] & masses[belt]]
    uncertainty = found.study.file.mass_uncertainty_percent
    return shared_gain(faults, np.inf if uncertainty is None else uncertainty / 100)


def _not_excited(found: PlateAccuracy, belt: BeltSide) -> list[int]:
    response = found.responses.get(belt)
    examined = response.examined if response is not None else ()
    return [c for c in range(len(WRENCH_COMPONENTS)) if c not in examined]


def _unexamined(found: PlateAccuracy, belt: BeltSide) -> tuple[str, ...]:
    """Give the quantities that depend on a response that the recordings do not show."""
    height = [] if found.study.file.height_stated else [MY]
    return quantities_of([*_not_excited(found, belt), *height])


def _judged(found: PlateAccuracy, belt: BeltSide) -> list[Judged]:
    """Judge total errors, single faults, linearity and noise of a plate, and list its gaps."""
    file = found.study.file
    supported = any(t.weight.supports for t in found.trials if t.weight.belt == belt)
    judged = judge_faults(_faults(found, belt), file.limits, file.full_scale_n, supported)
    judged += judge_unexamined(_not_excited(found, belt), file.limits)
    if belt in found.linearities:
        judged += judge_linearity(found.linearities[belt], file.limits, file.full_scale_n)
    if belt in found.responses:
        judged += judge_noise(found.responses[belt], file.limits)
    return [*_totals(found, belt), *judged]


def _totals(
    found: PlateAccuracy, belt: BeltSide, calibration: PlateCalibration | None = None
) -> list[Judged]:
    """Judge the total errors of a plate, if its recordings show all that they depend on."""
    file, response = found.study.file, found.responses.get(belt)
    if response is None or not response.complete:
        return []
    loads = stance_loads(file.body_mass_kg)
    return judge_totals(response, loads, file.limits, _unexamined(found, belt), calibration)


def _correction(
    found: PlateAccuracy, heavier: PlateAccuracy, belt: BeltSide, judged: Sequence[Judged]
) -> tuple[list[Judged], PlateCalibration | None]:
    """Give what a calibration leaves, and the calibration where it makes nothing worse.

    The part of all gains that heavier masses would explain is not corrected.
    """
    needed = any(o.remedy == "calibration" and o.status in ("beyond", "unclear") for o in judged)
    totals = _totals(found, belt)
    if not needed or not totals:
        return [], None
    center = next(trial.center for trial in found.trials if trial.weight.belt == belt)
    number, response = found.study.file.plate_numbers[belt], heavier.responses[belt]
    calibration = plate_calibration(number, center, response, _faults(found, belt))
    if calibration is None:
        return [], None
    corrected = either(*(_totals(one, belt, calibration) for one in (found, heavier)))
    worse = any(
        after.size > max(after.limit, before.size)
        for before, after in zip(totals, corrected, strict=True)
    )
    return corrected, None if worse else calibration


def _to_record(found: PlateAccuracy, belt: BeltSide) -> tuple[str, ...]:
    """Give what has to be recorded before anything can be said of a person's load."""
    trials = [trial for trial in found.trials_in_use if trial.weight.belt == belt]
    lines = []
    masses = len({trial.weight.mass_kg for trial in trials})
    if masses < MIN_MASSES:
        lines.append(f"record {MIN_MASSES} different weights or more, there are {masses}")
    if len({trial.weight.position_m for trial in trials}) < 2:
        lines.append("record weights at two distances from the belt's middle or more")
    if len(trials) <= COEFFICIENTS:
        lines.append(f"record {COEFFICIENTS + 1} times or more, there are {len(trials)} recordings")
    if all(trial.weight.profile == "constant" for trial in trials):
        lines.append("record changing belt speeds (sine, square): only they exert a force along it")
    if not found.study.file.height_stated:
        lines.append(
            "state center_height_m: without it, the moment that a force along the belt causes "
            "cannot be examined"
        )
    return tuple(lines)


def _remarks(found: PlateAccuracy, belt: BeltSide) -> tuple[str, ...]:
    lines = [f"{_in_words(_unexamined(found, belt))}: no weight on a belt exerts a lateral force"]
    if belt not in found.alignments:
        lines.append(
            "rotation and offset alone: no static recordings (they are in the total errors)"
        )
    if belt not in found.delays:
        lines.append("delay by a hammer: no recordings of impacts")
    return tuple(lines)


def describe(fault: FaultEstimate) -> str:
    """State an estimate with its 95 % uncertainty."""
    scale, unit = DISPLAY_UNITS.get(fault.unit, (1.0, fault.unit))
    error = scale * fault.uncertainty
    value = scale * fault.value
    if np.isfinite(error):
        text = (
            f"{fault.belt}: {fault.fault} {rounded(value, error)} ± {rounded(error, error)} {unit}"
        )
    else:
        text = f"{fault.belt}: {fault.fault} {value:.3f} {unit}, of unknown uncertainty"
    if np.isfinite(fault.frequency_hz):
        text += f" at {fault.frequency_hz:.2f} Hz in the centre of pressure along the belt"
    return text
