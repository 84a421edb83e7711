"""Vibration of a plate: the strongest line in the centre of pressure along the belt."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats
from scipy.signal import czt

from compensation import center_of_pressure
from hbm.spatial import Array
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
ALPHA: Final = 0.01
"""Chance that noise alone shows a line, over all frequencies."""
EDGE_S: Final = 0.5
"""At either end of a recording, where filters are inaccurate."""


@dataclass(frozen=True, slots=True)
class Vibration:
    """A line in the spectrum of all recordings; errors are standard errors over recordings."""

    amplitude_m: float
    amplitude_error_m: float
    frequency_hz: float
    frequency_error_hz: float


@dataclass(frozen=True, slots=True)
class _Residual:
    """Of a recording: times, the centre of pressure minus its regression on motion, and motion."""

    time: Array
    value: Array
    motion: Array


def find_vibration(trials: Sequence[WeightTrial]) -> Vibration | None:
    """Find the strongest line in the centre of pressure along the belt, if there is one.

    Parameters
    ----------
    trials
        Recordings on one plate, equal in their supports.

    Returns
    -------
    Vibration or None
        None where no line from 0.5 to 15 Hz exceeds its surroundings significantly (1 % over all
        frequencies), with fewer than two recordings, or where a true load is at times so small
        that it has no centre of pressure (the marker's noise exceeds a weight's acceleration).

    Notes
    -----
    The regression on the marker's position, speed and acceleration is subtracted first: gains and
    delays are no vibration. The spectra of all recordings are averaged; the median of the
    frequencies around is the noise. The line must be at one frequency in all recordings.
    """
    if len(trials) < 2:
        return None
    residuals = [_residual(trial) for trial in trials]
    hz = np.arange(MIN_HZ, MAX_HZ, STEP_HZ)
    power = np.mean([_power(r.time, r.value, hz) for r in residuals], axis=0)
    if not np.isfinite(power).all():
        return None
    floor = np.array(
        [np.median(power[max(k - NEIGHBOURS, 0) : k + NEIGHBOURS + 1]) for k in range(len(hz))]
    )
    freedom = 2 * len(trials)
    chance = stats.chi2.isf(ALPHA / len(hz), freedom) / stats.chi2.median(freedom)
    peak = int(np.argmax(power / floor))
    near = np.arange(hz[peak] - NEAR_HZ, hz[peak] + NEAR_HZ, FINE_STEP_HZ)
    own = np.array([near[np.argmax(_power(r.time, r.value, near))] for r in residuals])
    if power[peak] < chance * floor[peak] or own.std(ddof=1) > MAX_SPREAD_HZ:
        return None
    middle = float(np.mean(own))
    amplitudes = np.array([_amplitude(residual, middle) for residual in residuals])
    root = np.sqrt(len(trials))
    return Vibration(
        float(amplitudes.mean()),
        float(amplitudes.std(ddof=1) / root),
        middle,
        float(own.std(ddof=1) / root),
    )


def _residual(trial: WeightTrial) -> _Residual:
    inside = (trial.time > trial.time[0] + EDGE_S) & (trial.time < trial.time[-1] - EDGE_S)
    load = LOADED_SHARE * float(np.median(trial.truth[:, 2]))
    measured, true = (center_of_pressure(w, load)[:, 0] for w in (trial.measured, trial.truth))
    x = trial.slow_marker[:, 0]  # noise of a faster marker would bias the regression
    v = np.gradient(x, trial.time)
    motion = np.column_stack([np.ones(len(x)), trial.time, x, v, np.gradient(v, trial.time)])
    motion = motion[inside]
    value = (measured - true)[inside]
    value -= motion @ np.linalg.lstsq(motion, value)[0]
    return _Residual(trial.time[inside], np.asarray(value), motion)


def _amplitude(residual: _Residual, hz: float) -> float:
    """Amplitude of a sine, fitted together with the motion."""
    angle = 2 * np.pi * hz * residual.time
    waves = np.column_stack([np.cos(angle), np.sin(angle), residual.motion])
    return float(np.hypot(*np.linalg.lstsq(waves, residual.value)[0][:2]))


def _power(time: Array, signal: Array, hz: Array) -> Array:
    """Squared amplitude of the sine of every frequency, equally spaced, in a signal."""
    turn = 2j * np.pi * (time[1] - time[0])
    spectrum = czt(signal, len(hz), np.exp(-turn * (hz[1] - hz[0])), np.exp(turn * hz[0]))
    return np.asarray(np.abs(2 / len(signal) * spectrum) ** 2)
