"""Single faults of a plate, each with its uncertainty: to correct, or to know of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import stats
from scipy.interpolate import CubicSpline

from compensation import Delay, PlateAlignment
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.plate_study import BeltSide
from pipeline.plate_accuracy.trials import WeightTrial
from pipeline.plate_accuracy.vibration import find_vibration

FX, FZ, MX, MY, MZ = 0, 2, 3, 4, 5
EXCITED: Final = (FX, FZ, MX, MY, MZ)
"""Components that a weight on a belt excites; no lateral force acts on it."""
EXCITED_BY_POSITION: Final = (MX, MZ)
"""Of these, those that only weights at different distances from the belt's middle excite."""
CONFOUNDED: Final = {(MX, FZ), (MY, FZ), (MX, MY), (MY, MX), (MY, FX)}
"""Cross-talk that a rotated or shifted plate, or a misstated height of the weight, causes too."""
ALPHA: Final = 0.05
"""Level of significance of all faults of all plates together."""
MIN_MASSES: Final = 3
"""Of different size, to separate a curvature from a gain."""
EDGE_S: Final = 1.0
"""At either end of a recording, where filters at 2.4 Hz are inaccurate."""


@dataclass(frozen=True, slots=True)
class FaultEstimate:
    """One property of a plate that should be zero.

    Attributes
    ----------
    belt
        The plate.
    fault
        "angle", "offset along", "delay", "curvature", "drift", "Fz in Fx", "vibration", ….
    value, standard_error
        Estimate and its standard error.
    unit
        Of both.
    degrees_of_freedom
        Of the standard error.
    significant
        True if it differs from zero at 5 %, all faults of all plates tested together (Bonferroni).
    frequency_hz, frequency_error_hz
        Of a vibration, and its standard error; else NaN.
    """

    belt: BeltSide
    fault: str
    value: float
    standard_error: float
    unit: str
    degrees_of_freedom: float
    significant: bool = False
    frequency_hz: float = np.nan
    frequency_error_hz: float = np.nan

    @property
    def uncertainty(self) -> float:
        """Half of the 95 % confidence interval, by Student's t."""
        return float(stats.t.isf(0.025, self.degrees_of_freedom) * self.standard_error)


def estimate_faults(
    trials: Sequence[WeightTrial],
    alignments: Mapping[BeltSide, PlateAlignment],
    delays: Mapping[BeltSide, Delay],
    full_scale_n: float,
) -> tuple[FaultEstimate, ...]:
    """Estimate all faults of all plates.

    Parameters
    ----------
    trials
        Recordings of known weights.
    alignments, delays
        Belt -> result.
    full_scale_n
        Load at which the curvature is stated [N].

    Returns
    -------
    tuple[FaultEstimate, ...]
        Tested together at 5 % (Bonferroni); a vibration is listed only where there is one.
    """
    singles: list[FaultEstimate] = []
    for belt, alignment in alignments.items():
        singles += _alignment_faults(belt, alignment)
    for belt, delay in delays.items():
        freedom = len(delay.differences) - 1
        singles.append(
            FaultEstimate(belt, "delay", delay.seconds, delay.standard_error, "s", freedom)
        )
    belts = tuple(dict.fromkeys(trial.weight.belt for trial in trials))
    for belt in belts:
        chosen = [trial for trial in trials if trial.weight.belt == belt]
        singles += _regression_faults(belt, chosen, full_scale_n)
    vibrations = [
        estimate
        for belt in belts
        for supports in (True, False)
        if (estimate := _vibration_fault(belt, trials, supports)) is not None
    ]
    return (*(_tested(estimate, len(singles)) for estimate in singles), *vibrations)


def _alignment_faults(belt: BeltSide, alignment: PlateAlignment) -> list[FaultEstimate]:
    values = (np.degrees(alignment.angle), *alignment.offset)
    errors = alignment.standard_error * [np.degrees(1.0), 1.0, 1.0]
    names = (("angle", "°"), ("offset along", "m"), ("offset across", "m"))
    return [
        FaultEstimate(belt, name, float(value), float(error), unit, np.inf)
        for (name, unit), value, error in zip(names, values, errors, strict=True)
    ]


def _vibration_fault(
    belt: BeltSide, trials: Sequence[WeightTrial], supports: bool
) -> FaultEstimate | None:
    alike = [t for t in trials if (t.weight.belt, t.weight.supports) == (belt, supports)]
    vibration = find_vibration(alike)
    if vibration is None:
        return None
    return FaultEstimate(
        belt,
        f"vibration {'with' if supports else 'without'} supports",
        vibration.amplitude_m,
        vibration.amplitude_error_m,
        "m",
        len(alike) - 1,
        significant=True,
        frequency_hz=vibration.frequency_hz,
        frequency_error_hz=vibration.frequency_error_hz,
    )


def _tested(estimate: FaultEstimate, tests: int) -> FaultEstimate:
    critical = stats.t.isf(ALPHA / 2 / tests, estimate.degrees_of_freedom)
    return replace(
        estimate, significant=bool(abs(estimate.value) > critical * estimate.standard_error)
    )


def _regression_faults(
    belt: BeltSide, trials: Sequence[WeightTrial], full_scale_n: float
) -> list[FaultEstimate]:
    """Estimate cross-talk, gain, delay, curvature and drift by least squares over all recordings.

    The plate's error is regressed on the true wrench, its rate of change (a delay), the squared
    load (a curvature) and time (a drift), all at once; then once more after correcting the delay,
    so that it biases no gain. Standard errors come from leaving out each recording in turn
    (jackknife); their degrees of freedom are the recordings less the coefficients.
    """
    positions = len({trial.weight.position_m for trial in trials}) > 1
    excited = [c for c in EXCITED if positions or c not in EXCITED_BY_POSITION]
    curved = len({trial.weight.mass_kg for trial in trials}) >= MIN_MASSES
    scale = full_scale_n if curved else None
    rate = len(excited) + 2  # column of the rate of change
    freedom = len(trials) - (rate + 1 + curved)
    if freedom < 1:
        return []
    delay = _regress(trials, MY, excited, scale, 0.0)[0][rate]
    result = []
    for c in range(len(WRENCH_COMPONENTS)):
        value, error = _regress(trials, c, excited, scale, delay)
        entries = [
            (_gain_or_crosstalk(c, true), at, _unit(c, true), 0.0)
            for at, true in enumerate(excited, start=2)
            if (c, true) not in CONFOUNDED
        ]
        if c == FZ:
            entries.append(("drift", 1, "N/s", 0.0))
        if c == FZ and curved:
            entries.append(("curvature", -1, "N", 0.0))
        if c == MY:
            entries.append(("delay in motion", rate, "s", delay))
        result += [
            FaultEstimate(belt, fault, float(value[at] + known), float(error[at]), unit, freedom)
            for fault, at, unit, known in entries
        ]
    return result


def _regress(
    trials: Sequence[WeightTrial],
    component: int,
    excited: Sequence[int],
    full_scale_n: float | None,
    delay_s: float,
) -> tuple[Array, Array]:
    """Coefficients and errors: constant, time, true wrench, its rate, the squared load."""
    rows = []
    for trial in trials:
        spline = CubicSpline(trial.time, trial.slow_measured[:, component])
        inside = (trial.time > trial.time[0] + EDGE_S) & (trial.time < trial.time[-1] - EDGE_S)
        truth, time = trial.slow_truth, trial.time
        columns = [np.ones(len(time)), time - time[0], *truth[:, excited].T]
        columns.append(-np.gradient(truth[:, component], time))
        if full_scale_n is not None:
            columns.append((truth[:, FZ] / full_scale_n) ** 2)
        error = spline(trial.time + delay_s) - truth[:, component]
        rows.append((np.column_stack(columns)[inside], error[inside]))
    return _clustered(rows)


def _gain_or_crosstalk(measured: int, true: int) -> str:
    component = WRENCH_COMPONENTS[measured]
    return (
        f"gain of {component}" if measured == true else f"{WRENCH_COMPONENTS[true]} in {component}"
    )


def _unit(measured: int, true: int) -> str:
    moment, force = measured > FZ, true < MX
    return "N·m/N" if moment and force else "1/m" if not moment and not force else "1"


def _clustered(rows: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Least squares; standard errors from leaving out each cluster in turn (jackknife)."""
    scale = np.sqrt(np.mean(np.vstack([x for x, _ in rows]) ** 2, axis=0))
    scale[scale == 0] = 1
    gram = np.array([(x / scale).T @ (x / scale) for x, _ in rows])
    cross = np.array([(x / scale).T @ y for x, y in rows])
    whole, total = gram.sum(axis=0), cross.sum(axis=0)
    value = np.linalg.pinv(whole, hermitian=True) @ total
    without = np.array(
        [
            np.linalg.pinv(whole - g, hermitian=True) @ (total - c)
            for g, c in zip(gram, cross, strict=True)
        ]
    )
    count = len(rows)
    error = np.sqrt((count - 1) / count * np.sum((without - value) ** 2, axis=0))
    return value / scale, error / scale
