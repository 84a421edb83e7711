"""An unbalanced roller: a pitch moment that goes round with the belt.

A roller whose mass is off its axis pulls with the square of its speed, in a direction that turns
with it. The belt's travel is the roller's angle, so the belt speed predicts this moment but for
the angle at which a trial begins: a few seconds of empty belt, or an index pulse, tell that.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from compensation.inputs import read_rate, read_signal, refuse_unequal
from hbm.signals.filtering import low_pass
from hbm.spatial import Array

_STEP_M = 0.01  # of belt travel, at which the moment is resampled to find the roller
_TURNS = (0.3, 6.0)  # turns per metre: rollers of 5 to 100 cm diameter
_TURNS_AT_LEAST = 20  # of the largest roller sought


@dataclass(frozen=True, slots=True)
class Roller:
    """Moment ``v² (c cos φ + s sin φ)``, low-passed, with ``φ`` the roller's turn since the start.

    Attributes
    ----------
    turns_per_m
        Turns of the roller per metre of belt [1/m].
    cosine, sine
        ``c`` and ``s`` [N·m per (m/s)²]; they hold for one trial, see `locate`.
    cutoff_hz
        Cut-off of the real-time filter through which the moment was measured [Hz].
    """

    turns_per_m: float
    cosine: float
    sine: float
    cutoff_hz: float

    @property
    def circumference_m(self) -> float:
        """Length of belt per turn [m]."""
        return 1 / self.turns_per_m

    @property
    def amplitude(self) -> float:
        """Amplitude by the square of the speed [N·m per (m/s)²]."""
        return float(np.hypot(self.cosine, self.sine))

    def predict(self, belt_speed: ArrayLike, rate_hz: float) -> Array:
        """Predict the moment of a trial.

        Parameters
        ----------
        belt_speed
            Unfiltered belt speed from the start of the trial on, (N,) [m/s].
        rate_hz
            Sampling rate [Hz].

        Returns
        -------
        Array
            Pitch moment, (N,) [N·m].

        Raises
        ------
        ValueError
            Wrong shape, no samples, gaps or no rate.
        """
        speed = read_signal(belt_speed, "belt speed")
        basis = _basis(self.turns_per_m, speed, read_rate(rate_hz), self.cutoff_hz)
        return basis[:, 0] * self.cosine + basis[:, 1] * self.sine

    def locate(self, moment: ArrayLike, belt_speed: ArrayLike, rate_hz: float) -> "Roller":
        """Find where the roller stood when another trial began.

        Parameters
        ----------
        moment
            Pitch moment of the empty plate from the start of that trial on, (N,) [N·m], low-passed
            like the calibration and without what `BeltModel` predicts.
        belt_speed
            Unfiltered belt speed, (N,) [m/s].
        rate_hz
            Sampling rate [Hz].

        Returns
        -------
        Roller
            The same roller with ``cosine`` and ``sine`` of that trial.

        Raises
        ------
        ValueError
            Wrong shapes, no samples, gaps, different lengths or no rate.
        """
        moment, speed = _read(moment, belt_speed)
        basis = _basis(self.turns_per_m, speed, read_rate(rate_hz), self.cutoff_hz)
        cosine, sine, _ = np.linalg.lstsq(basis, moment)[0]
        return replace(self, cosine=float(cosine), sine=float(sine))


def fit_roller(
    moment: ArrayLike, belt_speed: ArrayLike, rate_hz: float, cutoff_hz: float
) -> Roller:
    """Find an unbalanced roller in what a belt model leaves of the pitch moment.

    Parameters
    ----------
    moment
        Pitch moment of the empty plate without what `BeltModel` predicts, low-passed, (N,) [N·m].
    belt_speed
        Unfiltered belt speed, (N,) [m/s].
    rate_hz
        Sampling rate [Hz].
    cutoff_hz
        Cut-off of the real-time filter on the moment [Hz].

    Returns
    -------
    Roller
        The strongest one with a circumference of 0.17 to 3.3 m.

    Raises
    ------
    ValueError
        Wrong shapes, no samples, gaps, different lengths, or a belt that did not run far enough.

    Notes
    -----
    The moment, divided by ``v²`` and resampled over the belt's travel, has a line in its spectrum
    at every roller; the strongest starts a least-squares fit through the filter itself. Own
    method: on the recordings of Hnat and van den Bogert (2014) it explains 40 % of the
    variance that the second-order model leaves, on a trial that it was not fitted on.
    """
    moment, speed = _read(moment, belt_speed)
    rate = read_rate(rate_hz)
    travel = _travel(speed, rate)
    length = float(np.ptp(travel))
    if length * _TURNS[0] < _TURNS_AT_LEAST:
        raise ValueError(
            f"the belt ran {length:.3g} m, too little to find a roller; "
            f"give at least {_TURNS_AT_LEAST / _TURNS[0]:.0f} m at a steady direction"
        )
    grid = np.arange(travel.min(), travel.max(), _STEP_M)
    forwards = np.maximum.accumulate(travel)
    by_speed = np.interp(grid, forwards, moment / np.maximum(speed**2, np.median(speed**2) / 10))
    spectrum = np.abs(np.fft.rfft((by_speed - by_speed.mean()) * np.hanning(len(grid))))
    turns = np.fft.rfftfreq(len(grid), _STEP_M)
    sought = (turns > _TURNS[0]) & (turns < _TURNS[1])
    coarse = float(turns[sought][int(np.argmax(spectrum[sought]))])

    def left_over(turns_per_m: float) -> float:
        basis = _basis(turns_per_m, speed, rate, cutoff_hz)
        return float(np.sum((moment - basis @ np.linalg.lstsq(basis, moment)[0]) ** 2))

    fine = np.linspace(coarse - 1 / length, coarse + 1 / length, 9)
    middle = fine[int(np.argmin([left_over(t) for t in fine]))]
    width = 0.25 / length
    best = minimize_scalar(left_over, bounds=(middle - width, middle + width), method="bounded")
    unknown = Roller(float(best.x), 0.0, 0.0, cutoff_hz)
    return unknown.locate(moment, speed, rate)


def _read(moment: ArrayLike, belt_speed: ArrayLike) -> tuple[Array, Array]:
    moment, speed = read_signal(moment, "pitch moment"), read_signal(belt_speed, "belt speed")
    refuse_unequal(pitch_moment=moment, belt_speed=speed)
    return moment, speed


def _travel(speed: Array, rate: float) -> Array:
    return np.cumsum(speed) / rate


def _basis(turns_per_m: float, speed: Array, rate: float, cutoff_hz: float) -> Array:
    """Cosine, sine and constant through the filter, (N, 3)."""
    angle = 2 * np.pi * turns_per_m * _travel(speed, rate)
    waves = [
        low_pass(speed**2 * wave(angle), rate, cutoff_hz, "realtime") for wave in (np.cos, np.sin)
    ]
    return np.column_stack([*waves, np.ones(len(speed))])
