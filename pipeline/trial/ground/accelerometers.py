"""Signals of instruments: channels in SI units, speeds of the belts, and accelerometers."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from compensation import Sensor, dynamic_channels
from hbm.signals.resampling import Convolution, resample
from hbm.spatial import Array
from hbm.spelling import short
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2, angle_in_rad, length_in_m, speed_in_mps

MAX_HELD_S: Final = 0.5
"""At either end, over which the nearest known value is used: no delay is longer."""
BELT: Final = re.compile(r"belt|treadmill", re.IGNORECASE)
NOT_BELT: Final = re.compile(r"sway|pitch|platform", re.IGNORECASE)
"""In names of channels with another speed of a treadmill."""


def read_channel(
    recording: Recording, name: str, unit_in_si: Callable[[str], float], unit: str | None = None
) -> tuple[Array, Array]:
    """Give times [s] and values of an analog channel in SI units, (N,) each.

    The unit is the stated one, or as the file states it; `unit_in_si` gives one of it in SI. A
    ValueError where there is no such channel, or its unit is unknown.
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
    """Give a belt's speed, (N,) [m/s], from a channel in a unit of speed."""
    return read_channel(recording, channel, speed_in_mps)[1]


def fastest_belt(recording: Recording, treadmill: Treadmill) -> tuple[Array, Array] | None:
    """Give times [s] and how fast the belts run, without a sign; of several the fastest, (N,).

    Where no channels are stated, those in a unit of speed count whose name contains "belt" or
    "treadmill", and not "sway", "pitch" or "platform". NaN where it is unknown; None where it is
    unknown throughout. A ValueError where a stated channel is in no unit of speed.
    """
    analog = recording.analog
    if analog is None:
        return None
    stated = treadmill.belt.speed_channels if treadmill.belt is not None else ()
    known = [name for name in stated if name in analog.names] or [
        name
        for name, unit in zip(analog.names, analog.units, strict=True)
        if BELT.search(name) and not NOT_BELT.search(name) and _is_unit(unit, speed_in_mps)
    ]
    speeds = np.abs([belt_speed(recording, name) for name in known])
    speeds[~np.isfinite(speeds)] = np.nan
    if np.isnan(speeds).all():  # also of no channels
        return None
    return analog.time, np.fmax.reduce(speeds)


def find_commands(recording: Recording) -> Platform:
    """Find the channels of the commanded motion: "sway" in a length, "pitch" in an angle."""
    analog = recording.analog
    found: dict[str, str] = {}
    for word, unit_in_si in (("sway", length_in_m), ("pitch", angle_in_rad)):
        for name, unit in zip(*((analog.names, analog.units) if analog else ((), ())), strict=True):
            if word in name.lower() and _is_unit(unit, unit_in_si):
                found.setdefault(f"{word}_channel", name)
    return Platform.model_validate(found)


def mean_belt_speed(found: tuple[Array, Array] | None) -> float | None:
    """Give the constant speed whose fourth power is the mean of the fastest belt's [m/s].

    What rollers leave on plates has a variance that grows with it. Takes what `fastest_belt` gives.
    """
    if found is None:
        return None
    with np.errstate(over="ignore"):
        mean = float(np.nanmean(found[1] ** 4) ** 0.25)
    return mean if np.isfinite(mean) else None


def _is_unit(unit: str, unit_in_si: Callable[[str], float]) -> bool:
    try:
        unit_in_si(unit)
    except ValueError:
        return False
    return True


def hold_ends(time: Array, values: Array, what: str) -> Array:
    """Fill what is unknown at either end of a signal (N, k) with its nearest known value.

    A ValueError that says `what` it is where values are unknown between known ones, or for more
    than 0.5 s at an end.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if not len(known):
        raise ValueError(f"{what} has no values while the plates are recorded")
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
    return values[np.clip(np.arange(len(values)), first, last)]


CHANNEL: Final = re.compile(r"(?P<sensor>.*?)[ ._-]?(?P<axis>[xyz])", re.IGNORECASE)
ACCELEROMETER: Final = re.compile(r"acc", re.IGNORECASE)


def find_accelerometers(recording: Recording) -> dict[str, tuple[str, str, str]]:
    """Find the triaxial accelerometers among a recording's analog channels.

    Gives sensor -> its x, y and z channel: of the channels that end in x, y or z, those whose unit
    is one of acceleration or whose name contains "acc". A ValueError that lists the channels where
    there is none with all three axes.
    """
    analog = recording.analog
    names = analog.names if analog is not None else ()
    units = analog.units if analog is not None else ()
    found: dict[str, dict[str, str]] = {}
    for name, unit in zip(names, units, strict=True):
        match = CHANNEL.fullmatch(name)
        if match and (ACCELEROMETER.search(name) or _is_unit(unit, acceleration_in_mps2)):
            found.setdefault(match["sensor"], {})[match["axis"].lower()] = name
    sensors = {
        sensor: (axes["x"], axes["y"], axes["z"])
        for sensor, axes in found.items()
        if len(axes) == 3
    }
    if not sensors:
        raise ValueError(
            f"{recording.source.name}: no triaxial accelerometer among the analog channels "
            f"({', '.join(names) or 'none'}); give them: --accelerometer rear=CH1,CH2,CH3, or "
            "treadmill.accelerometers in a study"
        )
    return sensors


def stated_accelerometers(texts: Sequence[str]) -> dict[str, tuple[str, str, str]]:
    """Read sensor -> its three channels as typed; a ValueError for another form or a name twice.

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
    """Give times (N,) [s] and readings (N, k) [m/s²], three columns per sensor as stated.

    A ValueError where no accelerometers are stated, a channel is missing, or its unit is unknown.
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


def sensor_delays_s(treadmill: Treadmill, sensors: Sequence[Sensor]) -> tuple[float, ...]:
    """Give how much later each is than the plates: as a calibration found, else as stated [s]."""
    stated = treadmill.accelerometer_delay_s or 0.0
    found = tuple(sensor.correction_s for sensor in sensors)
    return found or (stated,) * len(treadmill.accelerometers)


def at_plate_times(
    clock: Array,
    readings: Array,
    plate_times: Sequence[Array],
    delays_s: Sequence[float],
    lags_s: Sequence[float] = (),
) -> list[Array]:
    """Give what the accelerometers felt at the samples of each plate, (M, k (1 + lags)) [m/s²].

    The readings (N, k) at times of the clock (N,) have their sensors' delays undone; of a dynamic
    model, differences over the lags follow. NaN where unknown. Plates of equal times share one
    array.
    """
    kinds = [readings]
    if lags_s:
        rate_hz = (len(clock) - 1) / float(clock[-1] - clock[0])
        kinds = np.split(dynamic_channels(readings, rate_hz, lags_s), 1 + len(lags_s), axis=1)

    def at(values: Array, time: Array) -> Array:
        if len(set(delays_s)) == 1:
            return resample(clock, values, time + delays_s[0])
        parts = zip(np.split(values, len(delays_s), axis=1), delays_s, strict=True)
        return np.hstack([resample(clock, part, time + delay) for part, delay in parts])

    felt: list[Array] = []
    for number, time in enumerate(plate_times):
        same = [k for k in range(number) if np.array_equal(plate_times[k], time)]
        if same:
            felt.append(felt[same[0]])
            continue
        found = [at(kind, time) for kind in kinds]
        felt.append(np.hstack(found) if lags_s else found[0])
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
        Of a dynamic model's differences, whole steps of the resampling [s].
    """

    resampling: Convolution
    delays_s: tuple[float, ...]
    lags_s: tuple[float, ...] = ()

    @classmethod
    def of(
        cls, delays_s: tuple[float, ...], lags_s: Sequence[float], rate_hz: float, frames_hz: float
    ) -> "RealtimeAccelerometers":
        """Give it for samples and frames at these rates."""
        resampling = Convolution.between(rate_hz, frames_hz)
        step_s = resampling.step_s
        return cls(resampling, delays_s, tuple(max(round(x / step_s), 1) * step_s for x in lags_s))

    @property
    def ahead_s(self) -> float:
        """How much later than an instant the last sample is that it needs [s]."""
        return max(self.delays_s) + max(self.lags_s, default=0.0) + self.resampling.reach_s

    @property
    def behind_s(self) -> float:
        """How much earlier than an instant the first sample is that it needs [s]."""
        return max(self.lags_s, default=0.0) + self.resampling.reach_s - min(self.delays_s)

    def felt(self, time: Array, readings: Array, at: Array) -> Array:
        """Give what they felt at instants on the plates' clock, (T, k (1 + lags)) [m/s²].

        From samples (N, k) at times (N,); NaN where unknown.
        """
        now = self._readings(time, readings, at)
        kinds = [now]
        for lag_s in self.lags_s:
            later, earlier = (self._readings(time, readings, at + s) for s in (lag_s, -lag_s))
            kinds.append(later - 2 * now + earlier)
        return np.hstack(kinds) if self.lags_s else now

    def _readings(self, time: Array, readings: Array, at: Array) -> Array:
        evaluate = partial(Convolution.evaluate, self.resampling)
        delays_s = self.delays_s
        if len(set(delays_s)) == 1:
            return evaluate(time, readings, at + delays_s[0])
        each = [
            evaluate(time, readings[:, 3 * k : 3 * k + 3], at + delay_s)
            for k, delay_s in enumerate(delays_s)
        ]
        return np.concatenate(each, axis=1)
