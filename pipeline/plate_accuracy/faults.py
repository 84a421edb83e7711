"""Single faults of a plate, each with its uncertainty: to correct, or to know of."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
from scipy import stats
from scipy.signal import czt

from compensation import Delay, PlateAlignment, center_of_pressure
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.plate_study import BeltSide
from pipeline.plate_accuracy.response import (
    FX,
    FZ,
    MX,
    MY,
    PlateResponse,
    cameras_matrix,
    standard_error,
)
from pipeline.plate_accuracy.trials import LOADED_SHARE, WeightTrial

MIN_HZ: Final = 0.5
MAX_HZ: Final = 15.0
"""Below, the motion of the weight; above, the low-pass at 20 Hz."""
STEP_HZ: Final = 0.05
"""Of the spectrum: a fifth of the width of a line in 4 s."""
NEIGHBOURS: Final = 40
"""Frequencies on either side, 2 Hz, whose median is the noise at a frequency."""
NEAR_HZ: Final = 0.2
"""Distance from the common peak at which a recording's own is sought."""
FINE_STEP_HZ: Final = 0.002
"""Of that search: below any uncertainty of a frequency."""
MAX_SPREAD_HZ: Final = NEAR_HZ / 4
"""Standard deviation of the recordings' frequencies; noise spreads over all of ± `NEAR_HZ`."""
LINE_ALPHA: Final = 0.01
"""Chance that noise alone shows a line, over all frequencies."""
EDGE_S: Final = 0.5
"""At either end of a recording, where filters are inaccurate."""


def find_vibration(trials: Sequence[WeightTrial]) -> tuple[float, float, float] | None:
    """Find the strongest line in the centre of pressure along the belt, if there is one.

    Of recordings on one plate, equal in their supports: its amplitude [m], the standard error of
    that over recordings, and the frequency [Hz]. None where no line from 0.5 to 15 Hz exceeds its
    surroundings significantly (1 % over all frequencies), with fewer than two recordings, or where
    a true load is at times so small that it has no centre of pressure (the marker's noise exceeds
    a weight's acceleration).

    The regression on the marker's position, speed and acceleration is subtracted first: gains and
    delays are no vibration. The spectra of all recordings are averaged; the median of the
    frequencies around is the noise. The line must be at one frequency in all recordings.
    """
    if len(trials) < 2:
        return None
    paths = [_beyond_motion(trial) for trial in trials]
    hz = np.arange(MIN_HZ, MAX_HZ, STEP_HZ)
    power = np.mean([_power(time, value, hz) for time, value, _ in paths], axis=0)
    if not np.isfinite(power).all():
        return None
    floor = np.array(
        [np.median(power[max(k - NEIGHBOURS, 0) : k + NEIGHBOURS + 1]) for k in range(len(hz))]
    )
    freedom = 2 * len(trials)
    chance = stats.chi2.isf(LINE_ALPHA / len(hz), freedom) / stats.chi2.median(freedom)
    peak = int(np.argmax(power / floor))
    near = np.arange(hz[peak] - NEAR_HZ, hz[peak] + NEAR_HZ, FINE_STEP_HZ)
    own = np.array([near[np.argmax(_power(time, value, near))] for time, value, _ in paths])
    if power[peak] < chance * floor[peak] or own.std(ddof=1) > MAX_SPREAD_HZ:
        return None
    middle = float(np.mean(own))
    amplitudes = []
    for time, value, motion in paths:
        angle = 2 * np.pi * middle * time
        waves = np.column_stack([np.cos(angle), np.sin(angle), motion])
        amplitudes.append(np.hypot(*np.linalg.lstsq(waves, value)[0][:2]))
    error = np.std(amplitudes, ddof=1) / np.sqrt(len(trials))
    return float(np.mean(amplitudes)), float(error), middle


def _beyond_motion(trial: WeightTrial) -> tuple[Array, Array, Array]:
    """Give times, the centre of pressure minus its regression on the motion, and the motion."""
    inside = (trial.time > trial.time[0] + EDGE_S) & (trial.time < trial.time[-1] - EDGE_S)
    load = LOADED_SHARE * float(np.median(trial.truth[:, 2]))
    measured, true = (center_of_pressure(w, load)[:, 0] for w in (trial.measured, trial.truth))
    x = trial.slow_marker[:, 0]  # noise of a faster marker would bias the regression
    v = np.gradient(x, trial.time)
    motion = np.column_stack([np.ones(len(x)), trial.time, x, v, np.gradient(v, trial.time)])
    motion = motion[inside]
    value = (measured - true)[inside]
    return trial.time[inside], value - motion @ np.linalg.lstsq(motion, value)[0], motion


def _power(time: Array, signal: Array, hz: Array) -> Array:
    """Squared amplitude of the sine of every frequency, equally spaced, in a signal."""
    turn = 2j * np.pi * (time[1] - time[0])
    spectrum = czt(signal, len(hz), np.exp(-turn * (hz[1] - hz[0])), np.exp(turn * hz[0]))
    return np.asarray(np.abs(2 / len(signal) * spectrum) ** 2)


LEFT_OUT: Final = {(MX, FZ), (MY, FZ), (MX, MY), (MY, MX)}
"""Cross-talk that a rotated or shifted plate causes too: it counts as that, and in total errors."""
OF_HEIGHT: Final = (MY, FX)
"""Cross-talk that a misstated height of the weights causes too."""
ALPHA: Final = 0.05
"""Level of significance of all faults of all plates together."""
ALIGNMENT_STEP: Final = 1e-6
"""Of angle [rad] and offset [m], for the derivative of what they do to a wrench."""


@dataclass(frozen=True, slots=True)
class FaultEstimate:
    """One property of a plate that should be zero.

    Attributes
    ----------
    belt
        The plate.
    fault
        "angle", "offset along", "delay", "gain of Fz", "Fz in Fx", "zero of Fz", "curvature",
        "drift", "vibration with supports", ….
    value, standard_error
        Estimate and its standard error.
    unit
        Of both.
    degrees_of_freedom
        Of the standard error.
    significant
        True if it differs from zero at 5 %, all faults of all plates tested together (Bonferroni).
    frequency_hz
        Of a vibration; else NaN.
    """

    belt: BeltSide
    fault: str
    value: float
    standard_error: float
    unit: str
    degrees_of_freedom: float
    significant: bool = False
    frequency_hz: float = np.nan

    @property
    def uncertainty(self) -> float:
        """Half of the 95 % confidence interval, by Student's t."""
        return float(stats.t.isf(0.025, self.degrees_of_freedom) * self.standard_error)


def estimate_faults(
    trials: Sequence[WeightTrial],
    responses: Mapping[BeltSide, PlateResponse],
    alignments: Mapping[BeltSide, PlateAlignment],
    delays: Mapping[BeltSide, Delay],
    *,
    height_stated: bool,
) -> tuple[FaultEstimate, ...]:
    """Estimate all faults of all plates, tested together at 5 % (Bonferroni).

    A vibration is listed only where there is one, and the moment about the lateral axis that the
    force along the belt causes only where the height of the weights is known.
    """
    singles: list[FaultEstimate] = []
    for belt, alignment in alignments.items():
        errors = alignment.standard_error
        singles += [
            FaultEstimate(belt, name, float(value), float(error), unit, np.inf)
            for name, value, error, unit in (
                ("angle", np.degrees(alignment.angle), np.degrees(errors[0]), "°"),
                ("offset along", alignment.offset[0], errors[1], "m"),
                ("offset across", alignment.offset[1], errors[2], "m"),
            )
        ]
    for belt, delay in delays.items():
        known = (delay.seconds, delay.standard_error, "s", delay.degrees_of_freedom)
        singles.append(FaultEstimate(belt, "delay", *known))
    centers = {trial.weight.belt: trial.center for trial in trials}
    left_out = LEFT_OUT if height_stated else LEFT_OUT | {OF_HEIGHT}
    for belt, response in responses.items():
        unsure = np.zeros((6, 6))
        if belt in alignments:
            unsure = _errors_of_alignment(response, alignments[belt], centers[belt])
        singles += _response_faults(belt, response, unsure, left_out)
    found = []
    for fault in singles:
        critical = stats.t.isf(ALPHA / 2 / len(singles), fault.degrees_of_freedom)
        beyond = abs(fault.value) > critical * fault.standard_error
        found.append(replace(fault, significant=bool(beyond)))
    for belt, (supports, words) in product(centers, ((True, "with"), (False, "without"))):
        alike = [t for t in trials if (t.weight.belt, t.weight.supports) == (belt, supports)]
        line = find_vibration(alike)
        if line is not None:
            name, freedom = f"vibration {words} supports", len(alike) - 1
            found.append(FaultEstimate(belt, name, *line[:2], "m", freedom, True, line[2]))
    return tuple(found)


def _errors_of_alignment(
    response: PlateResponse, alignment: PlateAlignment, center: Array
) -> Array:
    """Give what the uncertainty of the static calibration adds to that of the matrix, (6, 6)."""
    changes = []
    for step in ALIGNMENT_STEP * np.eye(3):
        turned = replace(alignment, angle=alignment.angle + step[0])
        moved = replace(turned, offset=alignment.offset + step[1:])
        change = cameras_matrix(moved, center) - cameras_matrix(alignment, center)
        changes.append(change / ALIGNMENT_STEP @ response.matrix[0])
    variance = np.einsum("aij,ab,bij->ij", changes, alignment.covariance, changes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _response_faults(
    belt: BeltSide, response: PlateResponse, unsure: Array, left_out: Set[tuple[int, int]]
) -> list[FaultEstimate]:
    value = response.aligned[0] - np.eye(6)
    error = np.hypot(standard_error(response.aligned), unsure)
    faults = [
        (_gain_or_crosstalk(c, true), value[c, true], error[c, true], _unit(c, true))
        for c in range(len(WRENCH_COMPONENTS))
        for true in response.examined
        if (c, true) not in left_out
    ]
    replicates = [
        (f"zero of {name}", response.zero[:, c], "N·m" if c > FZ else "N")
        for c, name in enumerate(WRENCH_COMPONENTS)
    ]
    replicates.append(("drift", response.drift[:, FZ], "N/s"))
    if np.isfinite(response.curvature[0, FZ]):
        replicates.append(("curvature", response.curvature[:, FZ], "N"))
    replicates.append(("delay in motion", response.delay_s, "s"))
    faults += [(name, each[0], standard_error(each), unit) for name, each, unit in replicates]
    freedom = response.degrees_of_freedom
    return [
        FaultEstimate(belt, name, float(value), float(error), unit, freedom)
        for name, value, error, unit in faults
    ]


def _gain_or_crosstalk(measured: int, true: int) -> str:
    component = WRENCH_COMPONENTS[measured]
    return (
        f"gain of {component}" if measured == true else f"{WRENCH_COMPONENTS[true]} in {component}"
    )


def _unit(measured: int, true: int) -> str:
    moment, force = measured > FZ, true < MX
    return "N·m/N" if moment and force else "1/m" if not moment and not force else "1"
