"""Errors beside their limits: within, beyond, or neither can be told; and the calibration."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import stats

from compensation import Delay, Linearity, PlateCalibration, agreed_delay
from compensation.hammer import AgreedDelay
from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.plate_study import AccuracyLimits
from pipeline.plate_accuracy.faults import FaultEstimate
from pipeline.plate_accuracy.response import QUANTITIES, PlateResponse, standard_error, total_errors

DELAY_FAULTS: Final = {"motion": "delay in motion", "hammer": "delay"}
DELAY_METHODS: Final = {"motion": "in motion", "hammer": "by the hammer"}


def plate_calibration(
    number: int, center: Array, response: PlateResponse, faults: Sequence[FaultEstimate]
) -> PlateCalibration | None:
    """Give the correction of a plate: the inverse of its response, with the jackknife's error.

    Parameters
    ----------
    number
        Of the plate in its files.
    center
        Of its surface in the lab, (3,) [m].
    response
        What the plate reports.
    faults
        Of the plate: a zero or a delay is corrected where it differs significantly from none.

    Returns
    -------
    PlateCalibration or None
        A lateral force, which no weight exerts, is only turned and shifted with the plate. What
        grows with the squared load, time or at random is left. None where no calibration turns
        what the plate reports into the true wrench: a channel is dead, or the axes are wrong.
    """
    found = {fault.fault for fault in faults if fault.significant}
    zero = np.where(
        [f"zero of {name}" in found for name in WRENCH_COMPONENTS], response.zero[0], 0.0
    )
    late = chosen_delay(faults)
    corrected = late is not None and DELAY_FAULTS[late.method] in found
    try:
        inverse: Array = np.asarray(np.linalg.inv(response.matrix), float)
        return PlateCalibration(
            number,
            inverse[0],
            zero,
            standard_error(inverse),
            center,
            tuple(WRENCH_COMPONENTS[c] for c in response.examined),
            late.delay.seconds if late is not None and corrected else 0.0,
        )
    except ValueError:  # singular, or nothing that a plate can be
        return None


def chosen_delay(faults: Sequence[FaultEstimate]) -> AgreedDelay | None:
    """Choose between the delays of a plate by a hammer and in motion."""
    delays = {
        fault.fault: Delay(
            fault.value, fault.standard_error, degrees_of_freedom=fault.degrees_of_freedom
        )
        for fault in faults
        if fault.fault in DELAY_FAULTS.values()
    }
    return agreed_delay(delays.get("delay"), delays.get("delay in motion"))


def delay_notes(faults: Sequence[FaultEstimate]) -> tuple[Note, ...]:
    """Warn where the delays of a plate by a hammer and in motion contradict each other."""
    late, named = chosen_delay(faults), {fault.fault: fault for fault in faults}
    if late is None or not late.disagree:
        return ()
    hammer, motion = named["delay"], named["delay in motion"]
    note = Note.of(
        "plate_delays_disagree",
        belt=hammer.belt,
        hammer_s=hammer.value,
        hammer_uncertainty_s=hammer.uncertainty,
        motion_s=motion.value,
        motion_uncertainty_s=motion.uncertainty,
        method=DELAY_METHODS[late.method],
    )
    return (note,)


DISPLAY_UNITS: Final = {"m": (1000.0, "mm"), "s": (1000.0, "ms"), "1": (100.0, "%")}
"""Unit of an estimate -> factor and unit in which people read it."""
TOTAL: Final = "total error"
"""With which the names of total errors begin."""
MAX_DECIMALS: Final = 6
Remedy = Literal["calibration", "none"]
Status = Literal["within", "beyond", "unclear", "not examined"]


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
    remedy
        What takes it away: the plate's calibration, or nothing.
    examined
        False if it also depends on the response to a component that nothing excited.
    """

    name: str
    size: float
    low: float
    high: float
    limit: float
    unit: str
    remedy: Remedy
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
    def sentence(self) -> str:
        """The estimate, its interval and its limit."""
        scale, unit = DISPLAY_UNITS.get(self.unit, (1.0, self.unit))
        width = scale * (self.high - self.low) / 2
        size, low, high = (rounded(scale * x, width) for x in (self.size, self.low, self.high))
        limit = f"{scale * self.limit:g} {unit}"
        return f"{self.name} {size} {unit} ({low} to {high}; limit {limit})"


def judge_faults(
    faults: Sequence[FaultEstimate], limits: AccuracyLimits, full_scale_n: float, supported: bool
) -> list[Judged]:
    """Judge the faults of a plate as it is used; of two delays, the one to correct by.

    Parameters
    ----------
    faults
        Of the plate.
    limits
        As stated.
    full_scale_n
        Load at which the curvature is stated [N].
    supported
        Whether the plate is used with supports.

    Returns
    -------
    list[Judged]
        In their order.
    """
    late = chosen_delay(faults)
    used = None if late is None else DELAY_FAULTS[late.method]
    judged = []
    for fault in faults:
        if fault.fault in DELAY_FAULTS.values() and fault.fault != used:
            continue
        vibration = fault.fault.startswith("vibration")
        if vibration and fault.fault.endswith("with supports") != supported:
            continue
        lasting = vibration or fault.fault in ("drift", "curvature")
        remedy: Remedy = "none" if lasting else "calibration"
        limit = _limit(fault, limits, full_scale_n)
        judged.append(
            _judged(fault.fault, fault.value, fault.uncertainty, limit, fault.unit, remedy)
        )
    return judged


def judge_linearity(
    linearity: Linearity, limits: AccuracyLimits, full_scale_n: float
) -> list[Judged]:
    """Judge the slope of measured over known load as a gain, and the scatter about it."""
    freedom = linearity.degrees_of_freedom
    chance = np.array([0.025, 0.975])
    low, high = linearity.nonlinearity * np.sqrt(freedom / stats.chi2.isf(chance, freedom))
    limit = limits.nonlinearity_percent / 100 * full_scale_n
    return [
        _judged(
            "slope of measured over known load less 1",
            linearity.slope - 1,
            linearity.slope_uncertainty,
            limits.gain_percent / 100,
            "1",
            "calibration",
        ),
        Judged(
            "non-linearity", linearity.nonlinearity, float(low), float(high), limit, "N", "none"
        ),
    ]


def judge_noise(response: PlateResponse, limits: AccuracyLimits) -> list[Judged]:
    """Judge what is left at random of forces and moments at any load."""
    parts = (
        ("forces", "N", limits.noise_n, slice(0, 3)),
        ("moments", "N·m", limits.noise_nm, slice(3, 6)),
    )
    judged = []
    for name, unit, limit, chosen in parts:
        sizes = np.sqrt(np.maximum(response.scatter[:, 0, chosen].mean(axis=1), 0))
        half = response.quantile * float(standard_error(sizes))
        judged.append(_judged(f"noise of {name}", sizes[0], half, limit, unit, "none"))
    return judged


def judge_unexamined(components: Collection[int], limits: AccuracyLimits) -> list[Judged]:
    """List the gains of components that nothing excited: their size is not known."""
    nothing, limit = (np.nan, np.nan, np.nan), limits.gain_percent / 100
    names = [f"gain of {WRENCH_COMPONENTS[c]}" for c in components]
    return [Judged(name, *nothing, limit, "1", "none", examined=False) for name in names]


def judge_totals(
    response: PlateResponse,
    loads: Array,
    limits: AccuracyLimits,
    unexamined: Collection[str],
    calibration: PlateCalibration | None = None,
) -> list[Judged]:
    """Judge the total errors over loads, as reported or after correction.

    Quantities that depend on what was not examined cannot be within their limits.
    """
    suffix = "" if calibration is None else " after correction"
    remedy: Remedy = "calibration" if calibration is None else "none"
    units = {"F": ("N", limits.force_n), "C": ("m", limits.cop_m), "M": ("N·m", limits.moment_nm)}
    found = np.transpose(total_errors(response, loads, calibration)).tolist()
    judged = []
    for name, (size, low, high) in zip(QUANTITIES, found, strict=True):
        unit, limit = units[name[0]]
        examined = name not in unexamined
        judged.append(
            Judged(f"{TOTAL} of {name}{suffix}", size, low, high, limit, unit, remedy, examined)
        )
    return judged


def either(stated: Sequence[Judged], otherwise: Sequence[Judged]) -> list[Judged]:
    """Widen the intervals of errors to those that they would have otherwise."""
    return [
        replace(one, low=min(one.low, other.low), high=max(one.high, other.high))
        for one, other in zip(stated, otherwise, strict=True)
    ]


def rounded(value: float, uncertainty: float) -> str:
    """Write a number with two digits of its uncertainty, at most six decimals."""
    if not 0 < uncertainty < np.inf:
        return f"{value:.3g}"
    return f"{value:.{min(max(1 - math.floor(math.log10(uncertainty)), 0), MAX_DECIMALS)}f}"


def _judged(
    name: str, value: float, half: float, limit: float, unit: str, remedy: Remedy
) -> Judged:
    """Place the absolute value of an estimate ± half of its interval beside its limit."""
    size = abs(float(value))
    half = half if np.isfinite(half) else np.inf
    return Judged(name, size, max(size - half, 0.0), size + half, limit, unit, remedy)


def _limit(fault: FaultEstimate, limits: AccuracyLimits, full_scale_n: float) -> float:
    name = fault.fault
    single = {
        "angle": limits.angle_deg,
        "drift": limits.drift_n_per_s,
        "curvature": limits.curvature_percent / 100 * full_scale_n,
    }
    if name in single:
        return single[name]
    by_beginning = {
        "offset": limits.offset_m,
        "delay": limits.delay_s,
        "gain": limits.gain_percent / 100,
        "zero": limits.zero_nm if fault.unit == "N·m" else limits.zero_n,
        "vibration": limits.vibration_m,
    }
    return by_beginning.get(name.split()[0], limits.cross_talk_percent / 100)
