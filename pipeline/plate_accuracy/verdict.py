"""The verdict of experiment 1: whether each plate is accurate enough, and what to correct."""

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from compensation import PlateCalibration
from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS
from pipeline.config.plate_study import BeltSide
from pipeline.plate_accuracy.accuracy import PlateAccuracy
from pipeline.plate_accuracy.correction import delay_notes, plate_calibration
from pipeline.plate_accuracy.faults import FaultEstimate
from pipeline.plate_accuracy.judgement import (
    DISPLAY_UNITS,
    TOTAL,
    Judged,
    judge_faults,
    judge_linearity,
    judge_noise,
    judge_totals,
    rounded,
)
from pipeline.plate_accuracy.response import EXCITED, MIN_MASSES
from pipeline.plate_accuracy.second_causes import second_causes
from pipeline.plate_accuracy.stance import stance_loads

Verdict = Literal["fit", "fit after correction", "not fit", "cannot be told"]
MAX_FAULTS: Final = 3
MAX_TOTALS: Final = 2
"""In the sentence of a verdict; verdict.md lists all."""
MAX_MORE: Final = 10
"""Times as many recordings are worth advising; where more are needed, the error is its limit."""
COEFFICIENTS: Final = len(EXCITED) + 4
"""Of a plate's response: with a constant, time, the delay and the curvature."""


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
    recordings
        Of weights, on this plate.
    with_supports
        True where there are recordings with and without supports: the verdict is for use with them.
    largest_n
        Heaviest of these weights [N].
    constant
        Components, in the plate's own axes, that never changed in any recording.
    """

    belt: BeltSide
    judged: tuple[Judged, ...]
    corrected: tuple[Judged, ...]
    to_record: tuple[str, ...]
    remarks: tuple[str, ...]
    notes: tuple[Note, ...]
    calibration: PlateCalibration | None
    recordings: int
    with_supports: bool
    largest_n: float
    constant: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """The verdict: by what is beyond its limit first, then by what is not known."""
        statuses = {one.status for one in self.judged}
        if self.constant:
            return "not fit"
        if "beyond" in statuses:
            enough = {one.status for one in self._left} == {"within"}
            known = self.calibration is not None and not self.to_record
            return "fit after correction" if enough and known else "not fit"
        return "cannot be told" if self.to_record or "unclear" in statuses else "fit"

    @property
    def _left(self) -> tuple[Judged, ...]:
        """What a correction leaves."""
        return (*(one for one in self.judged if one.remedy == "none"), *self.corrected)

    @property
    def reasons(self) -> tuple[Judged, ...]:
        """What the verdict is for: single faults, then total errors, the largest first."""
        if self.verdict == "cannot be told":
            found = [one for one in self.judged if one.status == "unclear"]
        else:
            found = [one for one in self.judged if one.status == "beyond"]
        left = [one for one in self._left if one.status == "beyond"]
        if self.verdict == "not fit" and left:
            by_themselves = self.calibration is not None or any(one in left for one in found)
            found = left if by_themselves else [*found, *left]
        return tuple(
            sorted(found, key=lambda one: (one.name.startswith(TOTAL), -one.size / one.limit))
        )

    @property
    def corrections(self) -> tuple[str, ...]:
        """What to do about what can be corrected; nothing makes a plate fit that is not."""
        lines = []
        if self.calibration is not None and self.verdict != "not fit":
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
        start, reasons = f"{self.belt} plate{used}: ", self._listed_reasons()
        unknown = (
            "lateral force was not examined, and loads above the largest recorded one "
            f"({self.largest_n:.0f} N) are extrapolated"
        )
        if self.verdict == "fit":
            return f"{start}fit for inverse dynamics; {unknown}."
        missing = "; ".join([*self.to_record, *self._advice()])
        if self.verdict == "fit after correction":
            needed = "; ".join(self.corrections)
            return (
                f"{start}not fit for inverse dynamics as it is, fit after correction: {needed}. "
                f"Found: {reasons}. {unknown[0].upper()}{unknown[1:]}."
            )
        if self.verdict == "not fit":
            rest = (
                "" if self._final else f" Whether a correction is enough cannot be told: {missing}."
            )
            return f"{start}not fit for inverse dynamics: {reasons}.{rest}"
        known = f" Near a limit: {reasons}." if reasons else ""
        return f"{start}whether it is fit for inverse dynamics cannot be told: {missing}.{known}"

    @property
    def _final(self) -> bool:
        """True if no recording can show that a correction of the plate is enough."""
        beyond = any(one.status == "beyond" for one in self._left)
        examined = any(one.name.startswith(TOTAL) for one in self.judged)
        return bool(self.constant) or beyond or (examined and not self.corrected)

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
        """Say how many recordings would decide what is unclear."""
        everything = (*self.judged, *self.corrected)
        unclear = [one for one in everything if one.status == "unclear"]
        if not unclear:
            return []
        with np.errstate(divide="ignore"):
            more = {
                one.name: np.square((one.high - one.size) / np.abs(one.size - one.limit)) - 1
                for one in unclear
            }
        name = max(more, key=lambda each: more[each])
        if not more[name] < MAX_MORE:
            return [f"{name} is so close to its limit that more recordings would hardly tell"]
        number = max(math.ceil(more[name] * self.recordings), 1)
        return [f"record about {number} more weights on this plate"]


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
    file = found.study.file
    faults = [fault for fault in found.faults if fault.belt == belt]
    used = {trial.weight.supports for trial in found.trials if trial.weight.belt == belt}
    judged = judge_faults(faults, file.limits, file.full_scale_n, any(used))
    if belt in found.linearities:
        judged += judge_linearity(found.linearities[belt], file.limits, file.full_scale_n)
    response, corrected, calibration = found.responses.get(belt), [], None
    if response is not None:
        judged += judge_noise(response, file.limits)
    if response is not None and response.complete:
        loads = stance_loads(file.body_mass_kg)
        totals = judge_totals(response, loads, file.limits)
        judged = [*totals, *judged]
        if any(one.remedy == "calibration" and one.status != "within" for one in judged):
            center = next(t.center for t in found.trials if t.weight.belt == belt)
            number = file.plate_numbers[belt]
            calibration = plate_calibration(number, center, response, faults)
            if calibration is not None:
                corrected = judge_totals(response, loads, file.limits, calibration)
            if any(
                after.size > max(after.limit, before.size)
                for before, after in zip(totals, corrected, strict=False)
            ):
                calibration = None
    own = [trial for trial in found.trials if trial.weight.belt == belt]
    in_use = [trial for trial in found.trials_in_use if trial.weight.belt == belt]
    alike = second_causes(faults, in_use, file.full_scale_n)
    constant = np.all([trial.constant for trial in own], axis=0)
    return PlateVerdict(
        belt,
        tuple(replace(one, alike=alike.get(one.name, "")) for one in judged),
        tuple(corrected),
        _to_record(found, belt),
        _remarks(found, belt),
        delay_notes(faults),
        calibration,
        len(in_use),
        with_supports=len(used) > 1,
        largest_n=GRAVITY_MPS2 * max(trial.weight.mass_kg for trial in in_use),
        constant=tuple(name for name, one in zip(WRENCH_COMPONENTS, constant, strict=True) if one),
    )


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
    lines = ["lateral force: no weight on a belt exerts one"]
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
