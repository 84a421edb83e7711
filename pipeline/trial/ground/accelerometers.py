"""Signals of instruments: channels in SI units, speeds of the belts, and accelerometers."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import Sensor, dynamic_channels
from hbm.notes import Note
from hbm.signals.resampling import Convolution, resample
from hbm.spatial import Array
from hbm.spelling import short
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2, speed_in_mps

MAX_HELD_S: Final = 0.5
"""At either end, over which the nearest known value is used: no delay is longer."""
BELT: Final = re.compile(r"belt|treadmill", re.IGNORECASE)
NOT_BELT: Final = re.compile(r"sway|pitch|platform", re.IGNORECASE)
"""In names of channels with another speed of a treadmill."""


def read_channel(
    recording: Recording, name: str, unit_in_si: Callable[[str], float], unit: str | None = None
) -> tuple[Array, Array]:
    """Give an analog channel in SI units.

    Parameters
    ----------
    recording
        The trial.
    name
        The channel.
    unit_in_si
        Gives one of a unit in SI, such as `pipeline.io.units.length_in_m`.
    unit
        The channel's unit; by default as the file states it.

    Returns
    -------
    time
        (N,) [s].
    values
        (N,), in SI.

    Raises
    ------
    ValueError
        If there is no such channel, or its unit is unknown.
    """
    file, analog = recording.source.name, recording.analog
    if analog is None:
        raise ValueError(f"{file}: no analog channel {name!r}; there are none")
    try:
        values = analog.channel(name)
    except KeyError as error:
        raise ValueError(f"{file}: {error.args[0]}") from error
    try:
        scale = unit_in_si(unit or analog.units[analog.names.index(name)])
    except ValueError as error:
        raise ValueError(f"{file}: channel {name!r}: {error}") from error
    return analog.time, values * scale


def belt_speed(recording: Recording, channel: str) -> Array:
    """Give a belt's speed.

    Parameters
    ----------
    recording
        The trial.
    channel
        Name of the analog channel, in a unit of speed such as m/s.

    Returns
    -------
    Array
        (N,) [m/s].

    Raises
    ------
    ValueError
        If there is no such channel, or its unit is none of speed.
    """
    return read_channel(recording, channel, speed_in_mps)[1]


def fastest_belt(recording: Recording, treadmill: Treadmill) -> tuple[Array, Array] | None:
    """Give how fast the belts run, without a sign; of several the fastest.

    Parameters
    ----------
    recording
        The trial.
    treadmill
        Its belts' channels; where none are stated, those in a unit of speed whose name contains
        "belt" or "treadmill", and not "sway", "pitch" or "platform", count.

    Returns
    -------
    time, speed
        (N,) [s] and (N,) [m/s], NaN where unknown; None where it is unknown throughout.

    Raises
    ------
    ValueError
        If a stated channel is in no unit of speed.
    """
    analog = recording.analog
    if analog is None:
        return None
    stated = treadmill.belt.speed_channels if treadmill.belt is not None else ()
    known = [name for name in stated if name in analog.names] or [
        name
        for name, unit in zip(analog.names, analog.units, strict=True)
        if BELT.search(name) and not NOT_BELT.search(name) and _is_speed(unit)
    ]
    speeds = np.abs([belt_speed(recording, name) for name in known])
    speeds[~np.isfinite(speeds)] = np.nan
    if np.isnan(speeds).all():  # also of no channels
        return None
    return analog.time, np.fmax.reduce(speeds)


def mean_belt_speed(found: tuple[Array, Array] | None) -> float | None:
    """Give the constant speed whose fourth power is the mean of the fastest belt's [m/s].

    What rollers leave on plates has a variance that grows with it. Takes what `fastest_belt` gives.
    """
    if found is None:
        return None
    with np.errstate(over="ignore"):
        mean = float(np.nanmean(found[1] ** 4) ** 0.25)
    return mean if np.isfinite(mean) else None


def _is_speed(unit: str) -> bool:
    try:
        speed_in_mps(unit)
    except ValueError:
        return False
    return True


def hold_ends(time: Array, values: Array, what: str) -> tuple[Array, float]:
    """Fill what is unknown at either end of a signal with its nearest known value.

    Parameters
    ----------
    time
        (N,) [s].
    values
        (N, k); NaN where they are unknown.
    what
        Their name, for the error.

    Returns
    -------
    values
        Without gaps, (N, k).
    held_s
        The longer one of the two ends that were filled [s].

    Raises
    ------
    ValueError
        Values are unknown between known ones, or for more than 0.5 s at an end.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if not len(known):
        raise ValueError(f"{what} is nowhere known while the plates are recorded")
    first, last = known[[0, -1]].tolist()
    if len(known) < last - first + 1:
        gap = known[np.argmax(np.diff(known) > 1)] + 1
        raise ValueError(
            f"{what} has a gap at {time[gap]:.3f} s; samples of plates cannot have one"
        )
    held_s = float(max(time[first] - time[0], time[-1] - time[last]))
    if held_s > MAX_HELD_S:
        raise ValueError(
            f"{what} is unknown for {held_s:.2f} s at one end of the plates' recording, expected "
            f"at most {MAX_HELD_S:g} s"
        )
    return values[np.clip(np.arange(len(values)), first, last)], held_s


CHANNEL: Final = re.compile(r"(?P<sensor>.*?)[ ._-]?(?P<axis>[xyz])", re.IGNORECASE)
ACCELEROMETER: Final = re.compile(r"acc", re.IGNORECASE)


def find_accelerometers(recording: Recording) -> dict[str, tuple[str, str, str]]:
    """Find the triaxial accelerometers among a recording's analog channels.

    Parameters
    ----------
    recording
        The trial.

    Returns
    -------
    dict
        Sensor name -> its x, y and z channel: of the channels that end in x, y or z, those whose
        unit is one of acceleration or whose name contains "acc".

    Raises
    ------
    ValueError
        If there is none with all three axes; the message lists the channels.
    """
    analog = recording.analog
    names = analog.names if analog is not None else ()
    units = analog.units if analog is not None else ()
    found: dict[str, dict[str, str]] = {}
    for name, unit in zip(names, units, strict=True):
        match = CHANNEL.fullmatch(name)
        if match and (ACCELEROMETER.search(name) or _is_acceleration(unit)):
            found.setdefault(match["sensor"], {})[match["axis"].lower()] = name
    sensors = {
        sensor: (axes["x"], axes["y"], axes["z"])
        for sensor, axes in found.items()
        if len(axes) == 3
    }
    if not sensors:
        raise ValueError(
            f"{recording.source.name}: no triaxial accelerometer among the analog channels "
            f"({', '.join(names) or 'none'}); state them: --accelerometer rear=CH1,CH2,CH3, or "
            "treadmill.accelerometers in a study"
        )
    return sensors


def stated_accelerometers(texts: Sequence[str]) -> dict[str, tuple[str, str, str]]:
    """Read which channels are whose, as typed.

    Parameters
    ----------
    texts
        One per sensor: its name, and its x, y and z channel, whatever they are called.

    Returns
    -------
    dict
        Sensor name -> its three channels.

    Raises
    ------
    ValueError
        If a text is of another form, or names a sensor a second time.

    Examples
    --------
    >>> stated_accelerometers(["rear=ch14,ch15,ch16"])
    {'rear': ('ch14', 'ch15', 'ch16')}
    """
    sensors: dict[str, tuple[str, str, str]] = {}
    for text in texts:
        name, sign, channels = text.partition("=")
        axes = [channel.strip() for channel in channels.split(",")]
        if not (name.strip() and sign and len(axes) == 3 and all(axes)):
            raise ValueError(
                f"--accelerometer {short(text)}: expected a name and three channels, such as "
                "rear=ch14,ch15,ch16"
            )
        if sensors.setdefault(name.strip(), (axes[0], axes[1], axes[2])) != tuple(axes):
            raise ValueError(f"--accelerometer names {short(name.strip())} twice")
    return sensors


def accelerations(recording: Recording, treadmill: Treadmill) -> tuple[Array, Array]:
    """Give the accelerometers' readings.

    Parameters
    ----------
    recording
        The trial.
    treadmill
        Its ``accelerometers``: sensor name -> its three channels.

    Returns
    -------
    time
        (N,) [s].
    readings
        Specific force, three columns per sensor in the order stated, (N, k) [m/s²].

    Raises
    ------
    ValueError
        If no accelerometers are stated, a channel is missing, or its unit is unknown.
    """
    if not treadmill.accelerometers:
        raise ValueError(
            "compensation needs the accelerometers' channels: treadmill.accelerometers"
        )
    channels = [
        read_channel(recording, name, acceleration_in_mps2, treadmill.accelerometer_unit)
        for names in treadmill.accelerometers.values()
        for name in names
    ]
    return channels[0][0], np.stack([values for _, values in channels]).T


def at_plate_times(
    clock: Array,
    readings: Array,
    plate_time: Array,
    treadmill: Treadmill,
    sensors: Sequence[Sensor] = (),
    lags_s: Sequence[float] = (),
) -> Array:
    """Give what the accelerometers felt at the instants of a plate's samples.

    Parameters
    ----------
    clock
        Times of the readings, (N,) [s].
    readings
        Three columns per sensor, (N, k) [m/s²].
    plate_time
        (M,) [s].
    treadmill
        Its stated delay counts where the calibration describes no sensors.
    sensors
        The calibration's, of which delays are undone.
    lags_s
        Of a dynamic model: differences over them follow the readings [s].

    Returns
    -------
    Array
        (M, k (1 + lags)) [m/s²]; NaN where unknown.
    """
    if lags_s:
        rate_hz = (len(clock) - 1) / float(clock[-1] - clock[0])
        kinds = np.split(dynamic_channels(readings, rate_hz, lags_s), 1 + len(lags_s), axis=1)
        return np.hstack([at_plate_times(clock, x, plate_time, treadmill, sensors) for x in kinds])
    if not sensors:
        return resample(clock, readings, plate_time + (treadmill.accelerometer_delay_s or 0.0))
    delays = [s.correction_s for s in sensors]
    if len(set(delays)) == 1:
        return resample(clock, readings, plate_time + delays[0])
    parts = np.split(readings, len(sensors), axis=1)
    return np.hstack(
        [resample(clock, p, plate_time + d) for p, d in zip(parts, delays, strict=True)]
    )


def at_times_of_plates(
    clock: Array,
    readings: Array,
    plate_times: Sequence[Array],
    treadmill: Treadmill,
    sensors: Sequence[Sensor] = (),
    lags_s: Sequence[float] = (),
) -> list[Array]:
    """Give what the accelerometers felt for every plate, as `at_plate_times`.

    Plates whose samples have the same times, (M,) each, share one array.
    """
    felt: list[Array] = []
    for number, time in enumerate(plate_times):
        same = [
            x for x, t in zip(felt, plate_times[:number], strict=True) if np.array_equal(t, time)
        ]
        felt += same[:1] or [at_plate_times(clock, readings, time, treadmill, sensors, lags_s)]
    return felt


@dataclass(frozen=True, slots=True)
class RealtimeAccelerometers:
    """How what accelerometers felt follows from their samples.

    Attributes
    ----------
    resampling
        From their clock to the frames'.
    delays_s
        How much later each sensor is than the plates [s].
    lags_s
        Of a dynamic model's differences [s].
    """

    resampling: Convolution
    delays_s: tuple[float, ...]
    lags_s: tuple[float, ...] = ()

    @classmethod
    def of(
        cls,
        treadmill: Treadmill,
        sensors: Sequence[Sensor],
        lags_s: Sequence[float],
        rate_hz: float,
        frames_hz: float,
    ) -> "RealtimeAccelerometers":
        """Give it for sensors as a calibration found them, or as stated where it found none."""
        stated = [treadmill.accelerometer_delay_s or 0.0] * len(treadmill.accelerometers)
        resampling = Convolution.between(rate_hz, frames_hz)
        samples = [max(round(lag_s / resampling.step_s), 1) for lag_s in lags_s]
        return cls(
            resampling,
            tuple(s.correction_s for s in sensors) or tuple(stated),
            tuple(count * resampling.step_s for count in samples),
        )

    @property
    def ahead_s(self) -> float:
        """How much later than an instant the last sample is that it needs [s]."""
        return max(self.delays_s) + max(self.lags_s, default=0.0) + self.resampling.reach_s

    @property
    def behind_s(self) -> float:
        """How much earlier than an instant the first sample is that it needs [s]."""
        return max(self.lags_s, default=0.0) + self.resampling.reach_s - min(self.delays_s)

    def felt(self, time: Array, readings: Array, at: Array) -> Array:
        """Give what they felt, as an inertia model takes it.

        Parameters
        ----------
        time
            Sample times, (N,) [s].
        readings
            Three columns per sensor, (N, k) [m/s²].
        at
            Instants on the plates' clock, (T,) [s].

        Returns
        -------
        Array
            (T, k (1 + lags)) [m/s²]; NaN where unknown.
        """
        now = self._readings(time, readings, at)
        kinds = [now]
        for lag_s in self.lags_s:
            later, earlier = (self._readings(time, readings, at + s) for s in (lag_s, -lag_s))
            kinds.append(later - 2 * now + earlier)
        return np.hstack(kinds) if self.lags_s else now

    def _readings(self, time: Array, readings: Array, at: Array) -> Array:
        evaluate, delays_s = self.resampling.evaluate, self.delays_s
        if len(set(delays_s)) == 1:
            return evaluate(time, readings, at + delays_s[0])
        each = [
            evaluate(time, readings[:, 3 * k : 3 * k + 3], at + delay_s)
            for k, delay_s in enumerate(delays_s)
        ]
        return np.concatenate(each, axis=1)


def corrected_sensors(sensors: Sequence[Sensor]) -> tuple[Note, ...]:
    """Say which delays of a calibration's sensors are undone in a trial, if any are."""
    delays = {sensor.name: sensor.correction_s for sensor in sensors}
    return (Note.of("accelerometers_corrected", delay_s=delays),) if any(delays.values()) else ()


def _is_acceleration(unit: str) -> bool:
    try:
        acceleration_in_mps2(unit)
    except ValueError:
        return False
    return True
