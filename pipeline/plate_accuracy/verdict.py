"""The verdict of experiment 1: whether the plates are accurate enough, and what to correct."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pipeline.plate_accuracy.accuracy import PlateAccuracy
from pipeline.plate_accuracy.faults import FaultEstimate

DISPLAY_UNITS: Final = {"m": (1000.0, "mm"), "s": (1000.0, "ms"), "1": (100.0, "%")}
"""Unit of an estimate -> factor and unit in which people read it."""


@dataclass(frozen=True, slots=True)
class PlateVerdict:
    """Whether plates are fit for inverse dynamics.

    Attributes
    ----------
    against
        Errors beyond their limit that cannot be corrected, as sentences.
    corrections
        Errors beyond their limit that can be corrected, and how.
    unexamined
        What could not be examined on every plate, for lack of recordings.
    """

    against: tuple[str, ...]
    corrections: tuple[str, ...]
    unexamined: tuple[str, ...]

    @property
    def fit(self) -> bool:
        """True if every error beyond its limit can be corrected."""
        return not self.against

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        if not self.fit:
            return f"Not fit for inverse dynamics: {'; '.join(self.against)}."
        limited = ""
        if self.unexamined:
            limited = f", as far as was examined (not: {'; '.join(self.unexamined)})"
        if self.corrections:
            needed = "; ".join(self.corrections)
            return f"Fit for inverse dynamics{limited} once corrected: {needed}."
        return f"Fit for inverse dynamics{limited}."


def judge(found: PlateAccuracy) -> PlateVerdict:
    """Judge whether the plates are fit for inverse dynamics, by the study's limits."""
    against, corrections = _judge_faults(found)
    return PlateVerdict(
        (*against, *_nonlinear(found), *_inaccurate(found)), corrections, _unexamined(found)
    )


def _judge_faults(found: PlateAccuracy) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Give the faults beyond their limits: those that disqualify, and those to correct."""
    limits = found.study.file.limits
    against, corrections = [], []
    supported = any(t.weight.supports for t in found.trials)
    in_use = f"vibration {'with' if supported else 'without'} supports"
    for fault in found.faults:
        if not fault.significant:
            continue
        size, name = abs(fault.value), fault.fault
        if (name == "angle" and size > limits.angle_deg) or (
            name.startswith("offset") and size > limits.offset_m
        ):
            corrections.append(f"{describe(fault)}: align the {fault.belt} plate with the cameras")
        elif name == "delay" and size > limits.delay_s:
            corrections.append(
                f"{describe(fault)}: state plate_delay_s = {fault.value:.4f} in study.toml"
            )
        elif name == in_use and size > limits.cop_m:
            against.append(f"{describe(fault)}, more than {1000 * limits.cop_m:g} mm")
        elif name.startswith("vibration") and size > limits.cop_m:
            corrections.append(f"{describe(fault)}: measure with the supports")
    return tuple(against), tuple(corrections)


def _nonlinear(found: PlateAccuracy) -> list[str]:
    limit = found.study.file.limits.nonlinearity_percent
    return [
        f"{belt}: non-linearity {linearity.nonlinearity:.1f} N, "
        f"{linearity.percent_of_full_scale:.1f} % of full scale, more than {limit:g} %"
        for belt, linearity in found.linearities.items()
        if linearity.percent_of_full_scale > limit
    ]


def _inaccurate(found: PlateAccuracy) -> list[str]:
    """Name forces and centres of pressure whose error, without the marker's noise, is too large."""
    limits, against = found.study.file.limits, []
    errors = found.reported_errors
    means = errors[errors["zone"] == "all"].groupby(["belt", "quantity"])["orthogonal"].mean()
    noise = marker_noise(found)
    for belt, quantity, value in means.reset_index().itertuples(index=False):
        pressure = quantity.startswith("COP")
        limit = limits.cop_m if pressure else limits.force_n
        error = float(np.sqrt(max(value**2 - noise.get((belt, quantity), 0.0) ** 2, 0.0)))
        if quantity[0] != "M" and error > limit:
            shown = f"{1000 * error:.1f} mm" if pressure else f"{error:.1f} N"
            allowed = f"{1000 * limit:g} mm" if pressure else f"{limit:g} N"
            against.append(f"{belt}: {quantity} has an error of {shown} RMS, more than {allowed}")
    return against


def marker_noise(found: PlateAccuracy) -> dict[tuple[str, str], float]:
    """Give the part of each orthogonal error that noise of the marker causes, per belt.

    The weight does not leave the belt, so the vertical acceleration of its marker is noise; along
    the belt the noise is taken as equal.
    """
    noise: dict[tuple[str, str], float] = {}
    for belt in {t.weight.belt for t in found.trials}:
        trials = [t for t in found.trials if t.weight.belt == belt]
        force = float(np.mean([np.std(t.truth[t.used, 2]) for t in trials]))
        lever = found.study.file.center_height_m
        load = float(np.mean([np.mean(t.truth[t.used, 2]) for t in trials]))
        noise[belt, "Fx"] = noise[belt, "Fz"] = noise[belt, "Fy"] = force
        noise[belt, "COPx"] = noise[belt, "COPy"] = lever * force / load
    return noise


def describe(fault: FaultEstimate) -> str:
    """State an estimate with its 95 % uncertainty."""
    scale, unit = DISPLAY_UNITS.get(fault.unit, (1.0, fault.unit))
    error = scale * fault.uncertainty
    digits = max(1 - math.floor(math.log10(error)), 0) if error > 0 else 3
    value = f"{scale * fault.value:.{digits}f}"
    if np.isfinite(error):
        text = f"{fault.belt}: {fault.fault} {value} ± {error:.{digits}f} {unit}"
    else:
        text = f"{fault.belt}: {fault.fault} {value} {unit}, of unknown uncertainty"
    if np.isfinite(fault.frequency_hz):
        text += f" at {fault.frequency_hz:.2f} Hz in the centre of pressure along the belt"
    return text


def _unexamined(found: PlateAccuracy) -> tuple[str, ...]:
    belts = {t.weight.belt for t in found.trials}
    missing = {
        "alignment (static recordings)": belts - set(found.alignments),
        "delay (hammer impacts)": belts - set(found.delays),
        "linearity (three weights)": belts - set(found.linearities),
        "cross-talk and drift (more recordings of weights)": belts
        - {fault.belt for fault in found.faults if fault.fault == "drift"},
    }
    return tuple(
        f"{examination} {' and '.join(sorted(without))}"
        for examination, without in missing.items()
        if without
    )
