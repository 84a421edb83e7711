"""An unbalanced roller: a pitch moment that rotates with the belt.

A roller whose centre of mass is off its axis pulls with the square of its speed, in a direction
that rotates with it. The belt's travel gives the roller's angle, so the belt speed predicts this
moment up to the angle at which a trial begins; that follows from a few seconds of empty belt.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from compensation.inputs import read_rate, read_signal, refuse_unequal
from hbm.signals.filtering import low_pass
from hbm.spatial import Array

TRAVEL_STEP_M: Final = 0.01
"""Of belt travel, at which the moment is resampled: sixteen samples on the smallest roller."""
MIN_TURNS_PER_M: Final = 0.3
MAX_TURNS_PER_M: Final = 6.0
"""Rollers of 5 to 100 cm diameter."""
MIN_TURNS: Final = 20
"""Of the largest roller sought: fewer make its line in the spectrum too broad to separate."""
MIN_SPEED_SQUARED_SHARE: Final = 0.1
"""Of the median; slower samples are divided by this, for their own is mostly noise."""
COARSE_STEPS: Final = 9
"""Of the first search about the spectral line; a quarter of its width apart."""


@dataclass(frozen=True, slots=True)
class Roller:
    """Moment ``v² (c cos φ + s sin φ)``, low-passed, with ``φ`` the roller's angle since the start.

    Attributes
    ----------
    turns_per_m
        Turns of the roller per metre of belt [1/m].
    cosine, sine
        ``c`` and ``s`` [N·m per (m/s)²], valid for one trial; see `locate`.
    cutoff_hz
        Cut-off of the real-time filter on the moment [Hz].

    Examples
    --------
    >>> roller = Roller(turns_per_m=1.9, cosine=0.3, sine=0.4, cutoff_hz=6.0)
    >>> f"{roller.circumference_m:.2f} m, {roller.amplitude:.1f} N·m per (m/s)²"
    '0.53 m, 0.5 N·m per (m/s)²'
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
        """Find the roller's angle at the start of another trial.

        Parameters
        ----------
        moment
            Pitch moment of the empty plate from the start of that trial on, (N,) [N·m], low-passed
            as in the calibration, minus the prediction of `BeltModel`.
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
    """Find an unbalanced roller in the pitch moment that a belt model leaves.

    Parameters
    ----------
    moment
        Pitch moment of the empty plate, low-passed in real time, minus the prediction of
        `BeltModel`, (N,) [N·m].
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
        Wrong shapes, no samples, gaps, different lengths, or too little belt travel.

    Notes
    -----
    The moment, divided by ``v²`` and resampled over the belt's travel, has a line in its spectrum
    at every roller; the strongest starts a least-squares fit through the filter itself. Own
    method: on the recordings of Hnat and van den Bogert (2014) it explains 40 % of the
    variance that the second-order model leaves, on a trial that it was not fitted on.

    Examples
    --------
    >>> import numpy as np
    >>> speed = 1.3 + 0.2 * np.sin(np.arange(0, 60, 0.01))
    >>> moment = Roller(1.9, 0.3, 0.4, 6.0).predict(speed, 100.0)
    >>> found = fit_roller(moment, speed, 100.0, cutoff_hz=6.0)
    >>> f"{found.turns_per_m:.3f} {found.cosine:.2f} {found.sine:.2f}"
    '1.900 0.30 0.40'
    """
    moment, speed = _read(moment, belt_speed)
    rate = read_rate(rate_hz)
    travel = _travel(speed, rate)
    length = float(np.ptp(travel))
    if length * MIN_TURNS_PER_M < MIN_TURNS:
        raise ValueError(
            f"the belt ran {length:.3g} m, too little to find a roller; "
            f"give at least {MIN_TURNS / MIN_TURNS_PER_M:.0f} m in one direction"
        )
    grid = np.arange(travel.min(), travel.max(), TRAVEL_STEP_M)
    forwards = np.maximum.accumulate(travel)
    least = MIN_SPEED_SQUARED_SHARE * np.median(speed**2)
    by_speed = np.interp(grid, forwards, moment / np.maximum(speed**2, least))
    spectrum = np.abs(np.fft.rfft((by_speed - by_speed.mean()) * np.hanning(len(grid))))
    turns = np.fft.rfftfreq(len(grid), TRAVEL_STEP_M)
    sought = (turns > MIN_TURNS_PER_M) & (turns < MAX_TURNS_PER_M)
    coarse = float(turns[sought][int(np.argmax(spectrum[sought]))])

    def squared_error(turns_per_m: float) -> float:
        basis = _basis(turns_per_m, speed, rate, cutoff_hz)
        return float(np.sum((moment - basis @ np.linalg.lstsq(basis, moment)[0]) ** 2))

    candidates = np.linspace(coarse - 1 / length, coarse + 1 / length, COARSE_STEPS)
    middle = candidates[int(np.argmin([squared_error(t) for t in candidates]))]
    step = float(candidates[1] - candidates[0])
    best = minimize_scalar(squared_error, bounds=(middle - step, middle + step), method="bounded")
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
