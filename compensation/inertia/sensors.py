"""Accelerometers: what a calibration shows of each, and whether a trial's are as they were."""

from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from compensation.delay import sensor_delays
from compensation.inertia.model import InertiaModel, Setup, sensor_names
from compensation.inputs import read_table
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array, Mask

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "sensors")

QUANTILE_95: Final = 1.96
"""Half of a 95 % interval, in standard deviations."""
RIGID_DIRECTIONS: Final = 5
"""Of sway and pitch: ``f₀``, the angular acceleration and the angular velocity squared."""
NOISE_BAND: Final = (2.0, 0.4)
"""Times the cut-off, and times the sampling rate: between them readings are noise alone."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """An accelerometer as a calibration found it.

    Attributes
    ----------
    name
        As in the setup.
    delay_s, delay_error_s
        How much later it is than the plates, and the standard error [s]; the error is None where
        the delay could not be estimated, and 0 where it was stated.
    noise_mps2
        Standard deviation of its noise per channel, low-passed as for the fit [m/s²]; None where it
        could not be told from motion.

    Examples
    --------
    >>> Sensor("rear", 0.005, 0.0001).correction_s, Sensor("front", 0.0001, 0.0001).correction_s
    (0.005, 0.0)
    """

    name: str
    delay_s: float = 0.0
    delay_error_s: float | None = None
    noise_mps2: float | None = None

    @property
    def correction_s(self) -> float:
        """The delay that is undone: the estimate where its interval excludes 0, else 0 [s]."""
        error = self.delay_error_s
        determined = error is not None and abs(self.delay_s) > QUANTILE_95 * error
        return self.delay_s if determined else 0.0


def find_sensors(
    accelerations: ArrayLike,
    wrench: ArrayLike,
    readings: ArrayLike,
    setup: Setup,
    readings_rate_hz: float,
) -> tuple[Sensor, ...]:
    """Estimate delay and noise of every accelerometer of a calibration recording.

    Parameters
    ----------
    accelerations
        Readings through the setup's low-pass at the plates' nominal instants, (N, 3 S) [m/s²].
    wrench
        Wrenches of the empty plates, equally filtered, side by side, (N, 6 P) [N, N·m].
    readings
        Readings as recorded, unfiltered, (M, 3 S) [m/s²].
    setup
        Sensors, rate of the plates, and filter.
    readings_rate_hz
        Rate of the unfiltered readings [Hz].

    Returns
    -------
    tuple of Sensor
        In the order of their columns. What the recording does not show is None.

    Notes
    -----
    Delays are those of `compensation.delay.sensor_delays`; the gain of a sensor is absorbed by the
    fit. Noise is read from the density of the readings between twice the cut-off and 0.4 of their
    rate, taken as white.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> setup = Setup(("rear",), rate_hz=200.0, cutoff_hz=20.0)
    >>> accelerations = setup.low_pass(rng.normal([0, 0, 9.81], 1.0, (6000, 3)), 200.0)
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> (rear,) = find_sensors(accelerations, wrench, accelerations, setup, 200.0)
    >>> abs(rear.delay_s) < 1e-4
    True
    """
    a, w = read_table(accelerations, "accelerations"), read_table(wrench, "wrench")
    names = sensor_names(setup, a.shape[1])
    noise = _noise(read_table(readings, "readings", a.shape[1]), readings_rate_hz, setup)
    try:
        delays = [(d.seconds, d.standard_error) for d in sensor_delays(a, w, setup.rate_hz)]
    except ValueError:
        delays = []
    sensors = []
    for k, name in enumerate(names):
        late, error = delays[k] if delays and np.isfinite(delays[k][1]) else (0.0, None)
        sensors.append(Sensor(name, late, error, None if noise is None else float(noise[k])))
    return tuple(sensors)


def noise_for_fit(sensors: tuple[Sensor, ...], accelerations: ArrayLike) -> Array | float:
    """Give the noise that a fit allows for, (k,) [m/s²]; 0 where it is not the sensors' alone.

    It is allowed for where the sensors disagree by no more than their noise: then the platform
    moves as one rigid body, and what is left between them is noise.
    """
    a = read_table(accelerations, "accelerations", 3 * len(sensors))
    # sway and pitch are five directions: only more channels than these show noise beside motion
    noise = np.array([sensor.noise_mps2 or 0.0 for sensor in sensors])
    if a.shape[1] <= RIGID_DIRECTIONS or not np.all(noise > 0):
        return 0.0
    rigid = sensor_noise_of(a) < LIMITS.largest_noise_excess * float(np.sqrt(np.mean(noise**2)))
    return np.repeat(noise, 3) if rigid else 0.0


def describe_sensors(sensors: tuple[Sensor, ...]) -> tuple[Note, ...]:
    """Say of which sensors the delay is unknown."""
    unknown = tuple(sensor.name for sensor in sensors if sensor.delay_error_s is None)
    return (Note.of("accelerometer_delay_unknown", sensors=unknown),) if unknown else ()


def sensor_noise_of(accelerations: Array) -> float:
    """Estimate the noise per channel of a trial of sway and pitch, from (N, k), k > 5 [m/s²].

    Rigid sway and pitch move the channels along five directions only; the variance of the other
    principal directions is noise, taken as equal in all channels. On a platform that also rolls,
    yaws or bends the estimate is too large.
    """
    # smallest eigenvalues: directions that no rigid motion reaches
    variance = np.linalg.eigvalsh(np.cov(accelerations, rowvar=False))
    return float(np.sqrt(max(variance[:-RIGID_DIRECTIONS].mean(), 0.0)))


class SensorFault(StrEnum):
    """What makes a trial's compensation doubtful, by the codes of notes."""

    DEAD = "accelerometer_dead"
    CLIPPED = "accelerometer_clipped"
    TURNED = "accelerometer_turned"
    SWAPPED = "accelerometers_swapped"
    BEYOND_RANGE = "calibration_range_exceeded"


def check_trial(
    model: InertiaModel, accelerations: ArrayLike, range_g: float = 2.0
) -> tuple[Note, ...]:
    """Find what in a trial's accelerations makes its compensation doubtful.

    Parameters
    ----------
    model
        The fitted calibration.
    accelerations
        Of the trial, in the calibration's order and unit, (N, k) [m/s²]. Clipping is seen best
        before any filter.
    range_g
        Range of the accelerometers [g].

    Returns
    -------
    tuple of Note
        Warnings, empty where nothing is doubtful: a sensor that is dead, clipped, or turned (or
        upside down), two that are swapped, motion beyond that of the calibration.

    Raises
    ------
    ValueError
        Wrong shape, no samples or gaps.

    Notes
    -----
    Swapped sensors show in the combinations of channels that hardly changed in the calibration,
    such as the difference of two sensors along the sway: they stay as they were unless a sensor
    was moved. Two sensors whose offsets and axes agree to within 0.03 m/s² cannot be
    distinguished.

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> model = compensation.fit_inertia(accelerations, wrench)
    >>> [note.code for note in check_trial(model, -accelerations)]
    ['accelerometer_turned', 'calibration_range_exceeded']
    """
    faults = sensor_faults(model, accelerations, range_g)
    return tuple(Note.of(fault.value, **values) for fault, values in faults.items())


def sensor_faults(
    model: InertiaModel, accelerations: ArrayLike, range_g: float = 2.0
) -> dict[SensorFault, dict[str, Any]]:
    """Give what `check_trial` finds as data: fault -> the values of its note."""
    a = read_table(accelerations, "accelerations", len(model.acceleration_mean))
    names, readings = model.sensors, a.reshape(len(a), -1, 3)
    # gravity in the median, whatever the motion
    size = np.median(np.linalg.norm(readings, axis=2), axis=0)
    still = (a == a[0]).all(axis=0)
    # factor from gravity either way; a channel that never changes is dead too
    dead = np.abs(np.log(np.maximum(size, np.finfo(float).tiny) / GRAVITY_MPS2)) >= np.log(
        LIMITS.gravity_factor
    )
    dead |= still.reshape(-1, 3).any(axis=1) & ~still.all()
    faults = _faulty(model, a, readings, size, dead, range_g)
    low, high = model.acceleration_low, model.acceleration_high
    margin = LIMITS.largest_excess * (high - low)
    outside = (a < low - margin) | (a > high + margin)
    outside[:, np.repeat(dead, 3)] = False
    if outside.any():
        worst = int(np.argmax(outside.mean(axis=0)))
        faults[SensorFault.BEYOND_RANGE] = {
            "share": float(np.mean(outside.any(axis=1))),
            "channel": f"{names[worst // 3]} {'xyz'[worst % 3]}",
            "low_mps2": a[:, worst].min(),
            "high_mps2": a[:, worst].max(),
            "calibrated_low_mps2": low[worst],
            "calibrated_high_mps2": high[worst],
        }
    return faults


def faulty_sensors(model: InertiaModel, accelerations: Array, range_g: float) -> tuple[Note, ...]:
    """Name the sensors that are dead, clipped, turned or swapped; parameters as `check_trial`."""
    faults = sensor_faults(model, accelerations, range_g)
    return tuple(
        Note.of(fault.value, **values)
        for fault, values in faults.items()
        if fault is not SensorFault.BEYOND_RANGE
    )


def _faulty(
    model: InertiaModel, a: Array, readings: Array, size: Array, dead: Mask, range_g: float
) -> dict[SensorFault, dict[str, Any]]:
    """Find sensors that are dead; where none is, those that are clipped, turned or swapped."""
    names = model.sensors
    if dead.any():
        sensors = {names[k]: size[k] for k in np.flatnonzero(dead)}
        return {SensorFault.DEAD: {"sensors": sensors, "gravity_mps2": GRAVITY_MPS2}}
    faults = dict[SensorFault, dict[str, Any]]()
    limit = range_g * GRAVITY_MPS2
    clipped = np.mean(np.abs(readings) >= LIMITS.clipped * limit, axis=0).max(axis=1)
    if clipped.any():
        shares = {names[k]: clipped[k] for k in np.flatnonzero(clipped)}
        faults[SensorFault.CLIPPED] = {"shares": shares, "limit_mps2": limit}
    now, then = (mean.reshape(-1, 3) for mean in (a.mean(axis=0), model.acceleration_mean))
    # mean readings are gravity in the sensor's axes: the angle is how far it was turned
    cosine = np.vecdot(now, then) / np.linalg.norm(now, axis=1) / np.linalg.norm(then, axis=1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    if (angle > LIMITS.turned).any():
        angles = {names[k]: angle[k] for k in np.flatnonzero(angle > LIMITS.turned)}
        faults[SensorFault.TURNED] = {"angles_deg": angles}
    elif swapped := _swapped(model, a):
        faults[SensorFault.SWAPPED] = {"first": swapped[0], "second": swapped[1]}
    return faults


def _swapped(model: InertiaModel, a: Array) -> tuple[str, str] | None:
    """Give two sensors that, exchanged, keep constant what the calibration kept; else None."""
    variance, directions = np.linalg.eigh(model.acceleration_covariance)
    # combinations of channels that rigid motion keeps constant: exchanged sensors violate them
    constant = variance < LIMITS.constant_sd**2
    if not constant.any():
        return None
    weights = directions[:, constant] / np.sqrt(np.maximum(variance[constant], 0) + LIMITS.drift**2)

    def violation(first: int, second: int) -> float:
        """Give the mean square of the constraints with two sensors exchanged."""
        order = list(range(len(model.sensors)))
        order[first], order[second] = second, first
        reordered = a.reshape(len(a), -1, 3)[:, order].reshape(a.shape)
        return float(np.mean(((reordered - model.acceleration_mean) @ weights) ** 2))

    as_is, pairs = violation(0, 0), list(combinations(range(len(model.sensors)), 2))
    best = min(pairs, key=lambda pair: violation(*pair), default=(0, 0))
    if as_is < LIMITS.largest_violation or violation(*best) > as_is / LIMITS.least_improvement:
        return None
    return model.sensors[best[0]], model.sensors[best[1]]


def _noise(readings: Array, rate_hz: float, setup: Setup) -> Array | None:
    """Give the noise of every sensor after the filter, (S,) [m/s²]; None where it is not seen."""
    if setup.cutoff_hz is None:
        return None
    low, high = NOISE_BAND[0] * setup.cutoff_hz, NOISE_BAND[1] * rate_hz
    length = round(rate_hz)
    if low >= high or len(readings) < 4 * length:
        return None
    frequency, density = scipy.signal.welch(readings, rate_hz, nperseg=length, axis=0)
    inside = (frequency > low) & (frequency < high)
    # one-sided density times half the rate
    white = np.median(density[inside], axis=0) * rate_hz / 2  # variance per sample
    impulse = np.zeros(4 * length)
    impulse[2 * length] = 1.0
    # energy of the filter's impulse response: the part of white noise that passes
    passed = float(np.sum(setup.low_pass(impulse, rate_hz) ** 2))
    noise: Array = np.sqrt(passed * white.reshape(-1, 3).mean(axis=1))
    return noise
