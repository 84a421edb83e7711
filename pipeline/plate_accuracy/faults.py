"""Single faults of a plate, each with its uncertainty: what could be mended or must be known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats
from scipy.interpolate import CubicSpline

from compensation import Delay, PlateAlignment, center_of_pressure
from hbm.spatial import Array
from pipeline.config.plate_study import BeltSide
from pipeline.plate_accuracy.trials import WeightTrial

COMPONENTS: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
DRIVEN: Final = (0, 2, 3, 4, 5)
"""Components that a weight on a belt excites; nothing pushes across."""
AMBIGUOUS: Final = {(3, 2), (4, 2), (3, 4), (4, 3), (4, 0)}
"""Cross-talk that a turned or shifted plate, or a misstated height of the weight, makes too."""
SIGNIFICANT: Final = 0.05
BAND_HZ: Final = (0.5, 15.0)
STEP_HZ: Final = 0.05
NEIGHBOURS: Final = 40
NEAR_HZ: Final = 0.2
"""How far from the common peak a recording's own is sought; noise spreads over all of it."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One property of a plate that should be zero.

    Attributes
    ----------
    belt
        Which plate.
    fault
        "angle", "offset along", "delay", "curvature", "drift", "Fz in Fx", "vibration", ….
    value, error
        Estimate and its standard error.
    unit
        Of both.
    freedom
        Degrees of freedom of the error.
    found
        True if it is different from zero beyond chance, all estimates of all plates together.
    hz
        Frequency of a vibration and its standard error.
    """

    belt: BeltSide
    fault: str
    value: float
    error: float
    unit: str
    freedom: float
    found: bool = False
    hz: tuple[float, float] = (np.nan, np.nan)

    @property
    def uncertainty(self) -> float:
        """Half of the 95 % confidence interval, by Student's t."""
        return float(stats.t.isf(0.025, self.freedom) * self.error)


def estimates(
    trials: Sequence[WeightTrial],
    alignments: Mapping[BeltSide, PlateAlignment],
    delays: Mapping[BeltSide, Delay],
    full_scale_n: float,
) -> tuple[Estimate, ...]:
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
    tuple[Estimate, ...]
        Tested together at 5 % (Bonferroni); a vibration is listed only where it is found.
    """
    singles: list[Estimate] = []
    for belt, a in alignments.items():
        angle, along, across = a.standard_error
        singles.append(Estimate(belt, "angle", np.degrees(a.angle), np.degrees(angle), "°", np.inf))
        singles.append(Estimate(belt, "offset along", float(a.offset[0]), along, "m", np.inf))
        singles.append(Estimate(belt, "offset across", float(a.offset[1]), across, "m", np.inf))
    for belt, delay in delays.items():
        hits = len(delay.differences)
        singles.append(Estimate(belt, "delay", delay.seconds, delay.standard_error, "s", hits - 1))
    for belt in dict.fromkeys(t.weight.belt for t in trials):
        chosen = [t for t in trials if t.weight.belt == belt]
        singles += _regressed(belt, chosen, full_scale_n)
    shaking = [
        one
        for belt in dict.fromkeys(t.weight.belt for t in trials)
        for supports in (True, False)
        if (
            one := vibration(
                belt,
                [t for t in trials if (t.weight.belt, t.weight.supports) == (belt, supports)],
                supports,
            )
        )
        is not None
    ]
    return (*(_tested(one, len(singles)) for one in singles), *shaking)


def _tested(one: Estimate, tests: int) -> Estimate:
    critical = stats.t.isf(SIGNIFICANT / 2 / tests, one.freedom)
    return Estimate(
        one.belt,
        one.fault,
        one.value,
        one.error,
        one.unit,
        one.freedom,
        found=bool(abs(one.value) > critical * one.error),
    )


def _regressed(
    belt: BeltSide, trials: Sequence[WeightTrial], full_scale_n: float
) -> list[Estimate]:
    """Cross-talk, gain, delay, curvature and drift by least squares over all recordings.

    What the plate measures too much is explained by the true wrench, its rate of change (a
    delay), the squared load (a curvature) and time (a drift), all at once; then once more without
    the delay found, so that it bends no gain. Standard errors come from leaving out each recording
    in turn; recordings less coefficients are their degrees of freedom.
    """
    several = len({t.weight.position_m for t in trials}) > 1
    driven = [c for c in DRIVEN if several or c not in (3, 5)]
    bent = len({t.weight.mass_kg for t in trials}) > 2
    at = len(driven) + 2
    freedom = len(trials) - (at + 1 + bent)
    if freedom < 1:
        return []
    delay = _fit(trials, 4, driven, full_scale_n if bent else None, 0.0)[0][at]
    result = []
    for c, component in enumerate(COMPONENTS):
        value, error = _fit(trials, c, driven, full_scale_n if bent else None, delay)
        for k, d in enumerate(driven, start=2):
            if (c, d) in AMBIGUOUS:
                continue
            name = f"gain of {component}" if c == d else f"{COMPONENTS[d]} in {component}"
            result.append(Estimate(belt, name, value[k], error[k], _unit(c, d), freedom))
        if c == 2:
            result.append(Estimate(belt, "drift", value[1], error[1], "N/s", freedom))
        if c == 2 and bent:
            result.append(Estimate(belt, "curvature", value[-1], error[-1], "N", freedom))
        if c == 4:
            later = value[at] + delay
            result.append(Estimate(belt, "delay in motion", later, error[at], "s", freedom))
    return result


def _fit(
    trials: Sequence[WeightTrial],
    component: int,
    driven: Sequence[int],
    full_scale_n: float | None,
    delay_s: float,
) -> tuple[Array, Array]:
    """Coefficients and errors: constant, time, true wrench, its rate, the squared load."""
    rows = []
    for trial in trials:
        measured = CubicSpline(trial.time, trial.slow_measured[:, component])(trial.time + delay_s)
        inside = (trial.time > trial.time[0] + 1.0) & (trial.time < trial.time[-1] - 1.0)
        truth, time = trial.slow_truth, trial.time
        columns = [np.ones(len(time)), time - time[0], *truth[:, driven].T]
        columns.append(-np.gradient(truth[:, component], time))
        if full_scale_n is not None:
            columns.append((truth[:, 2] / full_scale_n) ** 2)
        excess = measured - truth[:, component]
        rows.append((np.column_stack(columns)[inside], excess[inside]))
    return _clustered(rows)


def _unit(measured: int, true: int) -> str:
    moment, force = measured > 2, true < 3
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


def vibration(belt: BeltSide, trials: Sequence[WeightTrial], supports: bool) -> Estimate | None:
    """Find the strongest line in the centre of pressure along the belt, if there is one.

    Parameters
    ----------
    belt
        Which plate.
    trials
        Recordings on it, alike in their supports.
    supports
        Whether with them.

    Returns
    -------
    Estimate or None
        Amplitude [m] with its frequency; None where no line from 0.5 to 15 Hz stands out of its
        surroundings beyond chance (1 % over all frequencies).

    Notes
    -----
    What the marker's place, speed and acceleration explain is taken off first: gains and delays
    are no vibration. The spectra of all recordings are averaged; the median of the frequencies
    around is the noise. The line must be at one frequency in all recordings.
    """
    if len(trials) < 2:
        return None
    residuals = [_shaking(trial) for trial in trials]
    hz = np.arange(*BAND_HZ, STEP_HZ)
    power = np.mean([_power(time, rest, hz) for time, rest, _ in residuals], axis=0)
    floor = np.array(
        [np.median(power[max(k - NEIGHBOURS, 0) : k + NEIGHBOURS + 1]) for k in range(len(hz))]
    )
    freedom = 2 * len(trials)
    chance = stats.chi2.isf(0.01 / len(hz), freedom) / stats.chi2.median(freedom)
    peak = int(np.argmax(power / floor))
    near = np.arange(hz[peak] - NEAR_HZ, hz[peak] + NEAR_HZ, 0.002)
    own = np.array([near[np.argmax(_power(time, rest, near))] for time, rest, _ in residuals])
    if power[peak] < chance * floor[peak] or own.std(ddof=1) > NEAR_HZ / 4:
        return None
    middle = float(np.mean(own))
    amplitudes = np.array([_amplitude(*residual, middle) for residual in residuals])
    n = np.sqrt(len(trials))
    return Estimate(
        belt,
        f"vibration {'with' if supports else 'without'} supports",
        float(amplitudes.mean()),
        float(amplitudes.std(ddof=1) / n),
        "m",
        len(trials) - 1,
        found=True,
        hz=(middle, float(own.std(ddof=1) / n)),
    )


def _shaking(trial: WeightTrial) -> tuple[Array, Array, Array]:
    """Time, what of the centre of pressure does not follow the marker's motion, and that motion."""
    inside = (trial.time > trial.time[0] + 0.5) & (trial.time < trial.time[-1] - 0.5)
    load = 0.2 * float(np.median(trial.truth[:, 2]))
    seen, true = (center_of_pressure(w, load)[:, 0] for w in (trial.measured, trial.truth))
    x = trial.slow_marker[:, 0]  # a faster one's noise would bias what is taken off
    v = np.gradient(x, trial.time)
    basis = np.column_stack([np.ones(len(x)), trial.time, x, v, np.gradient(v, trial.time)])[inside]
    rest = (seen - true)[inside]
    rest -= basis @ np.linalg.lstsq(basis, rest)[0]
    return trial.time[inside], np.asarray(rest), basis


def _amplitude(time: Array, rest: Array, basis: Array, hz: float) -> float:
    """Amplitude of a sine beside the motion in a recording."""
    angle = 2 * np.pi * hz * time
    waves = np.column_stack([np.cos(angle), np.sin(angle), basis])
    return float(np.hypot(*np.linalg.lstsq(waves, rest)[0][:2]))


def _power(time: Array, signal: Array, hz: Array) -> Array:
    """Squared amplitude of the sine of every frequency in a signal."""
    waves = np.exp(-2j * np.pi * np.outer(hz, time))
    return np.asarray(np.abs(2 / len(signal) * (waves @ signal)) ** 2)
