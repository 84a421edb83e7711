"""The verdict of experiment 1: whether each plate is accurate enough, and what to correct."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import stats

from compensation import Delay, PlateCalibration, agreed_delay
from compensation.hammer import AgreedDelay
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS
from hbm.spelling import written
from pipeline.config.plate_study import AccuracyLimits, BeltSide, PlatesFile
from pipeline.plate_accuracy.accuracy import PlateAccuracy
from pipeline.plate_accuracy.response import (
    EXCITED,
    LIMITS,
    MY,
    QUANTITIES,
    FaultEstimate,
    PlateResponse,
    quantities_of,
    stance_loads,
    standard_error,
    total_errors,
)
from pipeline.plate_accuracy.trials import WeightTrial
from pipeline.report.blocks import Check, Table

Answer = Literal["fit", "fit after correction", "not fit", "cannot be determined"]
Status = Literal["within", "beyond", "unclear", "not examined"]
TOTAL: Final = "total error"
GAIN: Final = "gain of "
"""With which names begin: of total errors, and of what misstated masses cause alike."""
DELAYS: Final = {"motion": "delay in motion", "hammer": "delay"}
"""Method -> the fault that it estimates."""


@dataclass(frozen=True, slots=True)
class Judged:
    """The size of an error with its 95 % confidence interval, beside its limit.

    Attributes
    ----------
    name
        "total error of Fz", "gain of Fz", "total error of Fz after correction", ….
    size, low, high
        Absolute value of the estimate, and its interval; NaN where there is none.
    limit
        Up to which it is accepted.
    unit
        Of all four.
    correctable
        Whether the plate's calibration takes it away.
    examined
        False if it also depends on the response to a component that nothing excited.
    """

    name: str
    size: float
    low: float
    high: float
    limit: float
    unit: str
    correctable: bool
    examined: bool = True

    @property
    def status(self) -> Status:
        """Within its limit, beyond it, unclear where the interval holds it, or not examined."""
        if self.low > self.limit:
            return "beyond"
        if not self.examined:
            return "not examined"
        return "within" if self.high <= self.limit else "unclear"

    @property
    def texts(self) -> tuple[str, str, str]:
        """Size, interval and limit, in the unit in which people read them."""
        read_in = {"m": (1000.0, "mm"), "s": (1000.0, "ms"), "1": (100.0, "%")}
        scale, unit = read_in.get(self.unit, (1.0, self.unit))
        width = scale * (self.high - self.low) / 2
        limit = f"{scale * self.limit:g} {unit}"
        if math.isnan(self.size):
            return "–", "–", limit
        size, low, high = (rounded(scale * x, width) for x in (self.size, self.low, self.high))
        return f"{size} {unit}", f"{low} to {high}", limit

    @property
    def rated(self) -> Check:
        """The size, rated by the status."""
        ratings = {"within": "pass", "beyond": "fail", "unclear": "check"}
        return ratings.get(self.status, "none"), self.texts[0], ""

    @property
    def sentence(self) -> str:
        """The estimate, its interval and its limit."""
        size, interval, limit = self.texts
        return f"{self.name} {size} ({interval}; limit {limit})"


@dataclass(frozen=True, slots=True)
class PlateVerdict:
    """Whether a plate is fit for inverse dynamics; nothing is fit that was not examined.

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
    contradiction
        Of the delays by two methods, a sentence, if there is one.
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
    contradiction: tuple[str, ...]
    calibration: PlateCalibration | None
    with_supports: bool
    largest_n: float
    constant: tuple[str, ...]
    unexamined: tuple[str, ...]
    shared: float

    @property
    def answer(self) -> Answer:
        """By what is beyond its limit first, then by what is not known."""
        statuses = {one.status for one in self.judged}
        if self.constant:
            return "not fit"
        if "beyond" in statuses:
            is_enough = {one.status for one in self._left} <= {"within", "not examined"}
            can_correct = self.calibration is not None and not self.to_record
            return "fit after correction" if is_enough and can_correct else "not fit"
        unknown = self.to_record or self.shared or "unclear" in statuses
        return "cannot be determined" if unknown else "fit"

    @property
    def _left(self) -> tuple[Judged, ...]:
        """What a correction leaves."""
        return (*(one for one in self.judged if not one.correctable), *self.corrected)

    @property
    def reasons(self) -> tuple[Judged, ...]:
        """What the verdict is for: single faults, then total errors, the largest first."""
        status = "unclear" if self.answer == "cannot be determined" else "beyond"
        reasons = [one for one in self.judged if one.status == status]
        remaining = [one for one in self._left if one.status == "beyond"]
        # what a calibration cannot take away decides; without one, all that is beyond does
        if self.answer == "not fit" and remaining:
            both = list(dict.fromkeys([*reasons, *remaining]))
            reasons = remaining if self.calibration is not None else both
        return tuple(
            sorted(reasons, key=lambda one: (one.name.startswith(TOTAL), -one.size / one.limit))
        )

    @property
    def corrections(self) -> tuple[str, ...]:
        """What to do about what can be corrected; nothing makes a plate fit that is not."""
        if self.calibration is None or self.answer == "not fit":
            return ()
        apply = (
            "apply plate_calibration.json: plates.calibration in study.toml, --plate-calibration"
        )
        if not self.calibration.offset.any():
            return (apply,)
        zero = "zero the plate before every recording: the calibration subtracts the zero that"
        return apply, f"{zero} these recordings had"

    @property
    def table(self) -> Table:
        """The verdict: for what, why, what to do, and from which load on it is extrapolated."""
        used = ", with supports" if self.with_supports else ""
        rating, text = {"not fit": "fail"}.get(self.answer, "check"), str(self.answer)
        examined = [name for name in QUANTITIES if name not in self.unexamined]
        if self.answer.startswith("fit") and self.unexamined:
            text = f"{', '.join(examined)}: {self.answer}; others: not known"
        elif self.answer == "fit":
            rating = "pass"
        dead = [
            f"{name} in the plate's own axes never changed under any weight: it is not connected "
            "or was not recorded"
            for name in self.constant
        ]
        not_shown = " (a dead channel of these would not show)" * bool(self.unexamined)
        rows: list[tuple[str, str | list[Check]]] = [
            ("Fit for inverse dynamics", [(rating, text, "")]),
            ("Examined", ", ".join(examined) or "–"),
            ("Not examined", f"{', '.join(self.unexamined) or '–'}{not_shown}"),
            (
                "Undecided" if self.answer == "cannot be determined" else "Found",
                # the five largest; the table of errors lists all
                "; ".join([*dead, *(one.sentence for one in self.reasons[:5])]) or "–",
            ),
            ("Extrapolated", f"above {self.largest_n:.0f} N, the largest recorded load"),
            *(("Contradiction", text) for text in self.contradiction),
            ("Next", "; ".join(self._to_do()) or "–"),
        ]
        return Table(f"{self.belt.title()} plate{used}", ("Question", "Answer"), rows, "answers")

    def _to_do(self) -> tuple[str, ...]:
        """Say what to correct, to record or to weigh; nothing where that would not help."""
        if self.answer == "fit after correction":
            return self.corrections
        beyond = self.constant or any(one.status == "beyond" for one in self._left)
        incurable = self.calibration is None and not self.to_record and not self.shared
        if self.answer == "fit" or (self.answer == "not fit" and (beyond or incurable)):
            return ()
        if self.shared:
            size = f"{100 * abs(self.shared):.2g} %"
            heavier, high = ("heavier", "high") if self.shared > 0 else ("lighter", "low")
            return (
                *self.to_record,
                "weigh the masses with a second balance, and correct mass_kg or set "
                "mass_uncertainty_percent: all gains of every plate are "
                f"{size} too {high}, or all masses as much {heavier} than given",
            )
        unclear = [one for one in (*self.judged, *self.corrected) if one.status == "unclear"]
        unclear.sort(key=lambda one: abs(one.size / one.limit - 1))
        more = [f"record more weights on this plate: {one.name} is unclear" for one in unclear[:1]]
        return (*self.to_record, *more)


def judge(accuracy: PlateAccuracy) -> tuple[PlateVerdict, ...]:
    """Judge whether plates are fit for inverse dynamics, by the study's limits.

    Parameters
    ----------
    accuracy
        The results.

    Returns
    -------
    tuple[PlateVerdict, ...]
        One per plate. Total errors are those at loads of a person of the stated mass: gains and
        their rise with the load are extrapolated from the weights, with their uncertainty; what
        neither describes at larger loads is not known.
    """
    belts = dict.fromkeys(trial.weight.belt for trial in accuracy.trials)
    return tuple(_judge_plate(accuracy, belt) for belt in belts)


@dataclass(frozen=True, slots=True)
class _Plate:
    """One plate of a study: its recordings, all and those in use; its response and its faults."""

    found: PlateAccuracy
    belt: BeltSide
    trials: list[WeightTrial]
    in_use: list[WeightTrial]
    response: PlateResponse | None
    faults: list[FaultEstimate]

    @property
    def file(self) -> PlatesFile:
        """What is stated of the study."""
        return self.found.study.file

    @property
    def not_excited(self) -> list[int]:
        """Components whose response the recordings do not show."""
        examined = self.response.examined if self.response is not None else ()
        return [c for c in range(len(WRENCH_COMPONENTS)) if c not in examined]

    @property
    def unexamined(self) -> tuple[str, ...]:
        """Quantities that depend on a response that the recordings do not show."""
        height = [] if self.file.height_stated else [MY]
        return quantities_of([*self.not_excited, *height])

    @property
    def agreed_delay(self) -> AgreedDelay | None:
        """The delay by a hammer or in motion, whichever is taken."""
        motion, response = None, self.response
        if response is not None:
            size = float(response.delay_s[0]), float(standard_error(response.delay_s))
            motion = Delay(*size, degrees_of_freedom=response.degrees_of_freedom)
        return agreed_delay(self.found.delays.get(self.belt), motion)

    def if_masses_were_heavier(self, share: float) -> "_Plate":
        """Give the plate as if all masses were heavier by a share than stated."""
        real, response = 1 + share, self.response
        # a larger true load makes gains smaller by as much, their rise by its square
        if response is not None:
            matrix = response.matrix.copy()
            matrix[:, :, response.examined] /= real
            response = replace(response, matrix=matrix, rise=response.rise / real**2)
        faults = [
            replace(one, value=(1 + one.value) / real - 1) if one.fault.startswith(GAIN) else one
            for one in self.faults
        ]
        return replace(self, response=response, faults=faults)


def _judge_plate(accuracy: PlateAccuracy, belt: BeltSide) -> PlateVerdict:
    plate = _Plate(
        accuracy,
        belt,
        [trial for trial in accuracy.trials if trial.weight.belt == belt],
        [trial for trial in accuracy.trials_in_use if trial.weight.belt == belt],
        accuracy.responses.get(belt),
        [fault for fault in accuracy.faults if fault.belt == belt],
    )
    # gains that all plates share may be an error of the masses: what holds either way is judged
    shared = _shared_gain(plate)
    heavier = plate.if_masses_were_heavier(shared)
    as_weighed, otherwise = _judged(plate), _judged(heavier)
    judged, corrected, calibration = _either(as_weighed, otherwise), list[Judged](), None
    if all(one.status == other.status for one, other in zip(as_weighed, otherwise, strict=True)):
        shared = 0.0
        if any(o.correctable and o.status in ("beyond", "unclear") for o in judged):
            corrected, calibration = _correction(plate, heavier)
    constant = np.all([trial.constant for trial in plate.trials], axis=0)
    return PlateVerdict(
        belt,
        tuple(judged),
        tuple(corrected),
        _to_record(plate),
        _contradiction(plate),
        calibration,
        with_supports=len({trial.weight.supports for trial in plate.trials}) > 1,
        largest_n=GRAVITY_MPS2 * max(trial.weight.mass_kg for trial in plate.in_use),
        constant=tuple(name for name, one in zip(WRENCH_COMPONENTS, constant, strict=True) if one),
        unexamined=plate.unexamined,
        shared=shared,
    )


def _shared_gain(plate: _Plate) -> float:
    """Find the part of all gains that one misstatement of all masses would explain.

    Of all plates on which the same masses were recorded: the mean gain less 1, weighted by
    precision, but not beyond the 95 % interval of any gain: where a plate or a component is right,
    or gains differ in sign, next to nothing is shared.
    """
    masses: dict[BeltSide, set[float]] = {}
    for trial in plate.found.trials_in_use:
        masses.setdefault(trial.weight.belt, set()).add(trial.weight.mass_kg)
    alike = [fault for fault in plate.found.faults if masses[fault.belt] & masses[plate.belt]]
    gains = [(one.value, one.uncertainty) for one in alike if one.fault.startswith(GAIN)]
    if not gains:
        return 0.0
    percent = plate.file.mass_uncertainty_percent
    most = np.inf if percent is None else percent / 100
    value, half = np.array(gains).T
    half = np.maximum(half, np.finfo(float).eps)
    # in the direction of the mean, no further than the end of any interval, and not below zero
    mean = float(np.average(value, weights=half**-2))
    side = np.sign(mean)
    return float(side * max(min(side * mean, np.min(side * value + half), most), 0.0))


def _judged(plate: _Plate) -> list[Judged]:
    """Judge total errors, single faults, linearity and noise of a plate, and list its gaps."""
    limits, full_scale_n, late = plate.file.limits, plate.file.full_scale_n, plate.agreed_delay
    supported = any(trial.weight.supports for trial in plate.trials)
    used = None if late is None else DELAYS[late.method]
    judged = _totals(plate)
    for fault in plate.faults:
        name = fault.fault
        vibration = name.startswith("vibration")
        if name in DELAYS.values() and name != used:
            continue
        if vibration and name.endswith("with supports") != supported:
            continue
        limit = _limit(fault, limits, full_scale_n)
        correctable = not vibration and name not in ("drift", "curvature")
        judged.append(_judge(name, fault.value, fault.uncertainty, limit, fault.unit, correctable))
    limit, unknown = limits.gain_percent / 100, (np.nan, np.nan, np.nan)
    for c in plate.not_excited:
        name = f"{GAIN}{WRENCH_COMPONENTS[c]}"
        judged.append(Judged(name, *unknown, limit, "1", correctable=False, examined=False))
    if plate.belt in plate.found.linearities:
        line, chance = plate.found.linearities[plate.belt], np.array([0.025, 0.975])
        # a standard deviation's interval, by the chi-square distribution of its square
        freedom = line.degrees_of_freedom
        low, high = line.nonlinearity * np.sqrt(freedom / stats.chi2.isf(chance, freedom))
        limit = limits.nonlinearity_percent / 100 * full_scale_n
        size = (line.nonlinearity, float(low), float(high))
        judged.append(Judged("non-linearity", *size, limit, "N", correctable=False))
    response = plate.response
    if response is not None:
        for name, unit, limit, chosen in (
            ("forces", "N", limits.noise_n, slice(0, 3)),
            ("moments", "N·m", limits.noise_nm, slice(3, 6)),
        ):
            sizes = np.sqrt(np.maximum(response.scatter[:, 0, chosen].mean(axis=1), 0))
            half = response.quantile * float(standard_error(sizes))
            judged.append(_judge(f"noise of {name}", sizes[0], half, limit, unit, False))
    return judged


def _judge(
    name: str, value: float, half: float, limit: float, unit: str, correctable: bool
) -> Judged:
    """Place the absolute value of an estimate ± half of its interval beside its limit."""
    size = abs(float(value))
    half = half if np.isfinite(half) else np.inf
    return Judged(name, size, max(size - half, 0.0), size + half, limit, unit, correctable)


def _limit(fault: FaultEstimate, limits: AccuracyLimits, full_scale_n: float) -> float:
    by_beginning = {
        "angle": limits.angle_deg,
        "offset": limits.offset_m,
        "delay": limits.delay_s,
        "gain": limits.gain_percent / 100,
        "zero": limits.zero_nm if fault.unit == "N·m" else limits.zero_n,
        "drift": limits.drift_n_per_s,
        "curvature": limits.curvature_percent / 100 * full_scale_n,
        "vibration": limits.vibration_m,
    }
    return by_beginning.get(fault.fault.split()[0], limits.cross_talk_percent / 100)


def _totals(plate: _Plate, calibration: PlateCalibration | None = None) -> list[Judged]:
    """Judge the total errors of a plate, if its recordings show all that they depend on."""
    response, limits = plate.response, plate.file.limits
    if response is None or not response.complete:
        return []
    units = {"F": ("N", limits.force_n), "C": ("m", limits.cop_m), "M": ("N·m", limits.moment_nm)}
    loads = stance_loads(plate.file.body_mass_kg)
    # each quantity with its size and both ends of the interval
    sizes = np.transpose(total_errors(response, loads, calibration)).tolist()
    suffix = "" if calibration is None else " after correction"
    judged = []
    for quantity, (size, low, high) in zip(QUANTITIES, sizes, strict=True):
        unit, limit = units[quantity[0]]
        name, examined = f"{TOTAL} of {quantity}{suffix}", quantity not in plate.unexamined
        judged.append(Judged(name, size, low, high, limit, unit, calibration is None, examined))
    return judged


def _either(as_weighed: Sequence[Judged], otherwise: Sequence[Judged]) -> list[Judged]:
    """Widen the intervals of errors to those that they would have otherwise."""
    return [
        replace(one, low=min(one.low, other.low), high=max(one.high, other.high))
        for one, other in zip(as_weighed, otherwise, strict=True)
    ]


def _correction(plate: _Plate, heavier: _Plate) -> tuple[list[Judged], PlateCalibration | None]:
    """Give what a calibration leaves, and the calibration where it makes nothing worse.

    The part of all gains that heavier masses would explain is not corrected.
    """
    totals = _totals(plate)
    calibration = _calibration(heavier) if totals else None
    if calibration is None:
        return [], None
    corrected = _either(*(_totals(one, calibration) for one in (plate, heavier)))
    # within its limit an error may grow
    worse = any(
        after.size > max(after.limit, before.size)
        for before, after in zip(totals, corrected, strict=True)
    )
    return corrected, None if worse else calibration


def _calibration(plate: _Plate) -> PlateCalibration | None:
    """Give the correction of a plate: the inverse of its response, with the jackknife's error.

    A zero or a delay is corrected where it differs significantly from none. A lateral force, which
    no weight exerts, is only turned and shifted with the plate. What grows with the squared load,
    time or at random is left. None where no calibration turns what the plate reports into the true
    wrench: a channel is dead, or the axes are wrong.
    """
    response, late, delay_s = plate.response, plate.agreed_delay, 0.0
    if response is None:
        return None
    # a zero or a delay that is not significant would only add its own error
    significant = {fault.fault for fault in plate.faults if fault.significant}
    corrected = [f"zero of {name}" in significant for name in WRENCH_COMPONENTS]
    if late is not None and DELAYS[late.method] in significant:
        delay_s = late.delay.seconds
    try:
        inverse = np.asarray(np.linalg.inv(response.matrix), float)
        return PlateCalibration(
            plate.file.plate_numbers[plate.belt],
            inverse[0],
            np.where(corrected, response.zero[0], 0.0),
            standard_error(inverse),
            plate.trials[0].center,
            tuple(WRENCH_COMPONENTS[c] for c in response.examined),
            delay_s,
        )
    except ValueError:  # singular, or nothing that a plate can be
        return None


def _contradiction(plate: _Plate) -> tuple[str, ...]:
    """Say that the delays of a plate by a hammer and in motion contradict each other, if so."""
    late = plate.agreed_delay
    if late is None or not late.disagree:
        return ()
    sizes = {
        one.fault: f"{written(1000 * one.value, '.1f')} ± {1000 * one.uncertainty:.1f} ms"
        for one in plate.faults
    }
    return (
        f"delay by the hammer {sizes['delay']}, in motion {sizes['delay in motion']}; used: "
        f"{late.method}. Check that hits were short and hard, and the hammer's marker fixed",
    )


def _to_record(plate: _Plate) -> tuple[str, ...]:
    """Give what has to be recorded before anything can be said of a person's load."""
    weights = [trial.weight for trial in plate.in_use]
    masses = len({weight.mass_kg for weight in weights})
    # of a plate's response: its components, a constant, time, the delay and the curvature
    coefficients, fewest = len(EXCITED) + 4, LIMITS.fewest_masses
    needed = (
        (masses >= fewest, f"record {fewest} different weights or more, not {masses}"),
        (
            len({weight.position_m for weight in weights}) > 1,
            "record weights at two distances from the belt's middle or more",
        ),
        (
            len(weights) > coefficients,
            f"record {coefficients + 1} times or more, there are {len(weights)} recordings",
        ),
        (
            any(weight.profile != "constant" for weight in weights),
            "record changing belt speeds (sine, square): only they exert a force along it",
        ),
        (
            plate.file.height_stated,
            "give center_height_m: without it, the moment that a force along the belt causes "
            "cannot be examined",
        ),
    )
    return tuple(text for is_enough, text in needed if not is_enough)


def rounded(value: float, uncertainty: float) -> str:
    """Write a number with two digits of its uncertainty, at most six decimals."""
    if not 0 < uncertainty < np.inf:
        return written(value, ".3g")
    decimals = min(max(1 - math.floor(math.log10(uncertainty)), 0), 6)
    return written(value, f".{decimals}f")
