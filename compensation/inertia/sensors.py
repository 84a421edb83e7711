"""What a calibration recording shows of its accelerometers: delay, gain and noise of each."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import welch

from compensation.alignment.delay import BLOCKS
from compensation.alignment.sensor_delay import sensor_delays
from compensation.inertia.fit import RIGID_DIRECTIONS, sensor_noise_of
from compensation.inertia.model import Setup, sensor_names
from compensation.inertia.plausibility import MIN_MOTION_MPS2
from compensation.inputs import read_table
from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array

QUANTILE_95: Final = 1.96
REST_S: Final = 0.5
"""Longer than a period of any motion of a platform but the slowest."""
OFFSET_SD_MPS2: Final = 0.1
"""Of an accelerometer's offset, 10 mg: what adjustment by hand leaves of the data sheets' 25 to 50.
At rest it cannot be told from a gain that is 1 % wrong."""
AXIS_GAIN_SD: Final = 0.01
"""Of the gains of one sensor's axes about their mean: 1 % in data sheets."""
MIN_SWAY_TO_NOISE: Final = 100.0
"""Variance of what two sensors agree in, by what they disagree in: less shows no common sway."""
NOISE_BAND: Final = (2.0, 0.4)
"""Times the cut-off, and times the sampling rate: between them readings are noise alone."""
MAX_NOISE_EXCESS: Final = 1.1
"""Factor by which the sensors may disagree more than their noise explains. On a platform that bends
or vibrates it is more, and its part cannot be taken out as noise."""


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
    gain, gain_error
        Reading by true acceleration, and the standard error; the error is None where the recording
        shows no gain.
    noise_mps2
        Standard deviation of its noise per channel, low-passed as for the fit [m/s²]; None where it
        could not be told from motion.

    Examples
    --------
    >>> late = Sensor("rear", 0.005, 0.0001, gain=1.004, gain_error=0.009, noise_mps2=0.006)
    >>> late.correction_s, late.scale
    (0.005, 1.0)
    """

    name: str
    delay_s: float = 0.0
    delay_error_s: float | None = None
    gain: float = 1.0
    gain_error: float | None = None
    noise_mps2: float | None = None

    def __post_init__(self) -> None:
        for name in ("delay_s", "delay_error_s", "gain", "gain_error", "noise_mps2"):
            value = getattr(self, name)
            if value is None and name not in ("delay_s", "gain"):
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise TypeError(f"sensor {self.name}: {name} must be a number, got {value!r}")
            if not np.isfinite(value) or (name not in ("delay_s",) and value < 0):
                raise ValueError(f"sensor {self.name}: {name} cannot be {value}")
        if not self.gain > 0:
            raise ValueError(f"sensor {self.name}: gain must be positive, got {self.gain}")

    @property
    def correction_s(self) -> float:
        """The delay that is undone: the estimate where its interval excludes 0, else 0 [s]."""
        return self.delay_s if _differs(self.delay_s, self.delay_error_s) else 0.0

    @property
    def scale(self) -> float:
        """The gain that is divided by: the estimate where its interval excludes 1, else 1."""
        return self.gain if _differs(self.gain - 1, self.gain_error) else 1.0


def find_sensors(
    accelerations: ArrayLike,
    wrench: ArrayLike,
    readings: ArrayLike,
    setup: Setup,
    readings_rate_hz: float,
) -> tuple[Sensor, ...]:
    """Estimate delay, gain and noise of every accelerometer of a calibration recording.

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

    Raises
    ------
    ValueError
        Wrong shapes, no samples, or gaps.

    Notes
    -----
    Delays are those of `compensation.alignment.sensor_delay.sensor_delays`.

    The gain of a sensor is absorbed by the fit. It matters where the sensor is exchanged or its
    setting changes, and because it shows a wrong setting. Two observations determine it: at rest a
    sensor reads 9.81 m/s², apart from its offset; and where two sensors ``a₁, a₂`` sway on one
    rigid body, ``n₁·a₁ + n₂·a₂`` is constant for one ``(n₁, n₂)``, with ``|n₂|/|n₁|`` the ratio of
    their gains along the sway. Both are weighted by their errors in a least-squares fit of the
    logarithms.

    Noise is read from the density of the readings between twice the cut-off and 0.4 of their rate,
    taken as white.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> setup = Setup(("rear",), rate_hz=200.0, cutoff_hz=20.0)
    >>> felt = setup.low_pass(rng.normal([0, 0, 9.81], 1.0, (6000, 3)), 200.0)
    >>> wrench = felt @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> (rear,) = find_sensors(felt, wrench, felt, setup, 200.0)
    >>> abs(rear.delay_s) < 1e-4
    True
    """
    a, w = read_table(accelerations, "accelerations"), read_table(wrench, "wrench")
    names = sensor_names(setup, a.shape[1])
    gains, gain_errors = _gains(a, setup.rate_hz)
    noise = _noise(read_table(readings, "readings", a.shape[1]), readings_rate_hz, setup)
    try:
        delays = [(d.seconds, d.standard_error) for d in sensor_delays(a, w, setup.rate_hz)]
    except ValueError:
        delays = []
    sensors = []
    for k, name in enumerate(names):
        late, error = delays[k] if delays and np.isfinite(delays[k][1]) else (0.0, None)
        known = np.isfinite(gain_errors[k])
        sensors.append(
            Sensor(
                name,
                delay_s=late,
                delay_error_s=error,
                gain=float(gains[k]) if known else 1.0,
                gain_error=float(gain_errors[k]) if known else None,
                noise_mps2=float(noise[k]) if noise is not None else None,
            )
        )
    return tuple(sensors)


def noise_for_fit(sensors: tuple[Sensor, ...], accelerations: ArrayLike) -> Array | float:
    """Give the noise that a fit allows for, (k,) [m/s²]; 0 where it is not the sensors' alone.

    It is allowed for where the sensors disagree by no more than their noise: then the platform
    moves as one rigid body, and what is left between them is noise.
    """
    a = read_table(accelerations, "accelerations", 3 * len(sensors))
    noise = np.array([sensor.noise_mps2 or 0.0 for sensor in sensors])
    if a.shape[1] <= RIGID_DIRECTIONS or not np.all(noise > 0):
        return 0.0
    rigid = sensor_noise_of(a) < MAX_NOISE_EXCESS * float(np.sqrt(np.mean(noise**2)))
    return np.repeat(noise, 3) if rigid else 0.0


def describe_sensors(sensors: tuple[Sensor, ...]) -> tuple[Note, ...]:
    """Say which sensors are late or wrongly scaled, and of which the delay is unknown."""
    notes = []
    for sensor in sensors:
        if sensor.delay_error_s is None:
            notes.append(Note.of("accelerometer_delay_unknown", sensor=sensor.name))
        elif sensor.correction_s:
            notes.append(
                Note.of(
                    "accelerometer_late",
                    sensor=sensor.name,
                    delay_s=sensor.delay_s,
                    interval_s=QUANTILE_95 * sensor.delay_error_s,
                )
            )
        if sensor.scale != 1 and sensor.gain_error is not None:
            notes.append(
                Note.of(
                    "accelerometer_gain",
                    sensor=sensor.name,
                    excess=sensor.gain - 1,
                    interval=QUANTILE_95 * sensor.gain_error,
                )
            )
    return tuple(notes)


def _differs(value: float, error: float | None) -> bool:
    return error is not None and abs(value) > QUANTILE_95 * error


def _gains(a: Array, rate_hz: float) -> tuple[Array, Array]:
    """Give gain and standard error of every sensor, (S,); errors are infinite where unknown."""
    parts = np.split(a, a.shape[1] // 3, axis=1)
    rows, observed, sd = [], [], []
    rest = _at_rest(a, rate_hz)
    if rest.any():
        for k, part in enumerate(parts):
            rows.append(np.eye(len(parts))[k])
            size = np.mean(np.linalg.norm(part[rest], axis=1))
            observed.append(np.log(size / GRAVITY_MPS2))
            sd.append(OFFSET_SD_MPS2 / GRAVITY_MPS2)
    for k in range(1, len(parts)):
        ratio, error = _sway_ratio(parts[0], parts[k])
        if np.isfinite(error):
            rows.append(np.eye(len(parts))[k] - np.eye(len(parts))[0])
            observed.append(np.log(ratio))
            sd.append(float(np.hypot(error / ratio, np.sqrt(2) * AXIS_GAIN_SD)))
    if not rest.any():  # ratios alone leave open which sensor is wrong
        return np.ones(len(parts)), np.full(len(parts), np.inf)
    weighted = np.array(rows) / np.array(sd)[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted)
    gains = np.exp(covariance @ weighted.T @ (np.array(observed) / np.array(sd)))
    return gains, gains * np.sqrt(np.diag(covariance))


def _at_rest(a: Array, rate_hz: float) -> Array:
    """Give the samples of those half seconds in which no channel moves, (N,)."""
    length = max(round(REST_S * rate_hz), 2)
    whole = len(a) // length * length
    windows = a[:whole].reshape(-1, length, a.shape[1])
    still = windows.std(axis=1).max(axis=1) < MIN_MOTION_MPS2
    return np.concatenate([np.repeat(still, length), np.zeros(len(a) - whole, bool)])


def _sway_ratio(first: Array, second: Array) -> tuple[float, float]:
    """Give the gain of the second sensor by that of the first, and its error; inf if unknown."""
    both = np.hstack([first, second])
    blocks = [np.cov(b, rowvar=False) * len(b) for b in np.array_split(both, BLOCKS)]
    total = np.cov(both, rowvar=False) * len(both)
    ratios = [_ratio_of(total - block) for block in blocks]
    spread = np.var(ratios) * (len(ratios) - 1)
    variance, directions = np.linalg.eigh(total)
    shared = [
        d @ part @ d
        for d, part in zip(
            np.split(directions[:, 0], 2), (total[:3, :3], total[3:, 3:]), strict=True
        )
    ]
    if not min(shared) > MIN_SWAY_TO_NOISE * max(float(variance[0]), 0.0):
        return 1.0, np.inf
    return _ratio_of(total), float(np.sqrt(spread))


def _ratio_of(covariance: Array) -> float:
    first, second = np.split(np.linalg.eigh(covariance)[1][:, 0], 2)
    return float(np.linalg.norm(first) / max(np.linalg.norm(second), np.finfo(float).tiny))


def _noise(readings: Array, rate_hz: float, setup: Setup) -> Array | None:
    """Give the noise of every sensor after the filter, (S,) [m/s²]; None where it is not seen."""
    if setup.cutoff_hz is None:
        return None
    low, high = NOISE_BAND[0] * setup.cutoff_hz, NOISE_BAND[1] * rate_hz
    length = round(rate_hz)
    if low >= high or len(readings) < 4 * length:
        return None
    frequency, density = welch(readings, rate_hz, nperseg=length, axis=0)
    inside = (frequency > low) & (frequency < high)
    white = np.median(density[inside], axis=0) * rate_hz / 2  # variance per sample
    impulse = np.zeros(4 * length)
    impulse[2 * length] = 1.0
    passed = float(np.sum(setup.low_pass(impulse, rate_hz) ** 2))
    found: Array = np.sqrt(passed * white.reshape(-1, 3).mean(axis=1))
    return found
