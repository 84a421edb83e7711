"""Signals of instruments: channels in SI units, speeds of the belts, and accelerometers."""

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import Sensor, Setup, dynamic_channels
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.signals.resampling import Convolution, Signal, resample
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array
from hbm.spelling import short
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.input_file import naming
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2, angle_in_rad, length_in_m, speed_in_mps

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "accelerometers")

FILTER: Final[Method] = "zero_phase"
"""A delay of what is subtracted would leave an artefact wherever platform or belt accelerate."""


def read_channel(
    recording: Recording, name: str, unit_in_si: Callable[[str], float], unit: str | None = None
) -> tuple[Array, Array]:
    """Give times [s] and values of an analog channel in SI units, (N,) each.

    The unit is the stated one, or as the file states it; `unit_in_si` gives one of it in SI. A
    ValueError where there is no such channel, or its unit is unknown.
    """
    analog = recording.analog
    with naming(recording.source):
        if analog is None:
            raise ValueError(f"no analog channel {name!r}; there are none")
        values, sent = analog.channel(name), analog.units[analog.names.index(name)]
        try:
            return analog.time, values * unit_in_si(unit or sent)
        except ValueError as error:
            raise ValueError(f"channel {name!r}: {error}") from error


def _channels_in(recording: Recording, unit_in_si: Callable[[str], float]) -> list[str]:
    """Name the analog channels in a unit of which `unit_in_si` gives one in SI."""
    analog, names = recording.analog, list[str]()
    for name, unit in zip(analog.names, analog.units, strict=True) if analog else ():
        with suppress(ValueError):
            unit_in_si(unit)
            names.append(name)
    return names


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
    names = treadmill.belt.speed_channels if treadmill.belt is not None else ()
    channels = [name for name in names if name in analog.names] or [
        name
        for name in _channels_in(recording, speed_in_mps)
        if re.search("belt|treadmill", name, re.IGNORECASE)
        # these are other speeds of a treadmill
        and not re.search("sway|pitch|platform", name, re.IGNORECASE)
    ]
    speeds = np.abs([belt_speed(recording, name) for name in channels])
    # infinite values are unknown, too
    speeds[~np.isfinite(speeds)] = np.nan
    if np.isnan(speeds).all():  # also of no channels
        return None
    return analog.time, np.fmax.reduce(speeds)


def find_commands(recording: Recording) -> Platform:
    """Find the channels of the commanded motion: "sway" in a length, "pitch" in an angle."""
    lengths, angles = (_channels_in(recording, in_si) for in_si in (length_in_m, angle_in_rad))
    return Platform(
        sway_channel=next((name for name in lengths if "sway" in name.lower()), None),
        pitch_channel=next((name for name in angles if "pitch" in name.lower()), None),
    )


def mean_belt_speed(speeds: tuple[Array, Array] | None) -> float | None:
    """Give the constant speed whose fourth power is the mean of the fastest belt's [m/s].

    What rollers leave on plates has a variance that grows with it. Takes what `fastest_belt` gives.
    """
    if speeds is None:
        return None
    with np.errstate(over="ignore"):
        # the fourth root of the mean fourth power
        mean = float(np.nanmean(speeds[1] ** 4) ** 0.25)
    return mean if np.isfinite(mean) else None


def hold_ends(time: Array, values: Array, what: str) -> Array:
    """Fill what is unknown at either end of a signal (N, k) with its nearest known value.

    A ValueError that says `what` it is where values are unknown between known ones, or for more
    than 0.5 s at an end.
    """
    # first and last sample of which all channels are known
    samples = np.flatnonzero(np.isfinite(values).all(axis=1))
    if not len(samples):
        raise ValueError(f"{what} has no values while the plates are recorded")
    first, last = samples[[0, -1]].tolist()
    if len(samples) < last - first + 1:
        gap = samples[np.argmax(np.diff(samples) > 1)] + 1
        raise ValueError(
            f"{what} has a gap at {time[gap]:.3f} s; samples of plates cannot have one"
        )
    held_s = float(max(time[first] - time[0], time[-1] - time[last]))
    if held_s > LIMITS.longest_held:
        raise ValueError(
            f"{what} is unknown for {held_s:.2f} s at one end of the plates' recording, expected "
            f"at most {LIMITS.longest_held:g} s"
        )
    return values[np.clip(np.arange(len(values)), first, last)]


def find_accelerometers(recording: Recording) -> dict[str, tuple[str, str, str]]:
    """Find the triaxial accelerometers among a recording's analog channels.

    Gives sensor -> its x, y and z channel: of the channels that end in x, y or z, those whose unit
    is one of acceleration or whose name contains "acc". A ValueError that lists the channels where
    there is none with all three axes.
    """
    names = recording.analog.names if recording.analog is not None else ()
    in_unit = _channels_in(recording, acceleration_in_mps2)
    axes_of = defaultdict[str, dict[str, str]](dict)
    for name in names:
        # such as "Acc1.X": the sensor, then its axis
        match = re.fullmatch("(?P<sensor>.*?)[ ._-]?(?P<axis>[xyz])", name, re.IGNORECASE)
        if match and ("acc" in name.lower() or name in in_unit):
            axes_of[match["sensor"]][match["axis"].lower()] = name
    three = {name: axes for name, axes in axes_of.items() if len(axes) == 3}
    sensors = {name: (axes["x"], axes["y"], axes["z"]) for name, axes in three.items()}
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


def without_gaps(*signals: Array) -> list[Array]:
    """Give the samples at which all of some signals (N, K) are known, every channel in one piece.

    Fits sum over samples again and again, which then takes a tenth of the time.
    """
    are_known = np.isfinite(np.hstack(signals)).all(axis=1)
    return [signal.T.compress(are_known, axis=1).T for signal in signals]


def setup_of(recording: Recording, treadmill: Treadmill) -> Setup:
    """Give how a recording's plates and accelerometers were recorded and are to be filtered.

    A ValueError where there are no plates.
    """
    if not recording.plates:
        file, why = recording.source.name, recording.why_no_plates
        raise ValueError(f"{file}: compensation needs plates: {why}")
    rate = float(1 / np.median(np.diff(recording.plates[0].time)))
    return Setup(
        tuple(treadmill.accelerometers), round(rate, 6), treadmill.cutoff_hz, filter_method=FILTER
    )


def sensor_delays_s(treadmill: Treadmill, sensors: Sequence[Sensor]) -> tuple[float, ...]:
    """Give how much later each is than the plates: as a calibration found, else as stated [s]."""
    stated_s = treadmill.accelerometer_delay_s or 0.0
    fitted_s = tuple(sensor.correction_s for sensor in sensors)
    return fitted_s or (stated_s,) * len(treadmill.accelerometers)


def _undelayed(
    readings: Array, delays_s: Sequence[float], read: Callable[[Array, float], Array]
) -> Array:
    """Read each sensor ahead by its delay [s]; where all have the same one, all together."""
    if len(set(delays_s)) == 1:
        return read(readings, delays_s[0])
    parts = np.split(readings, len(delays_s), axis=1)
    return np.hstack([read(*part) for part in zip(parts, delays_s, strict=True)])


def at_plate_times(
    clock: Array,
    readings: Array,
    filtered: Array,
    plate_times: Sequence[Array],
    delays_s: Sequence[float],
    lags_s: Sequence[float] = (),
) -> list[Array]:
    """Give what the accelerometers measure at the samples of each plate, (M, k (1 + lags)) [m/s²].

    The readings (N, k) at times of the clock (N,) have their sensors' delays undone; of a dynamic
    model, differences of the filtered readings over the lags follow. NaN where unknown. Plates of
    equal times share one array.
    """
    # second differences of the filtered readings follow the readings of a dynamic model
    channels = dynamic_channels(filtered, mean_rate_hz(clock), lags_s)
    kinds = [readings, *np.split(channels, 1 + len(lags_s), axis=1)[1:]]

    def accelerations(time: Array) -> Array:
        def read(of_sensors: Array, delay_s: float) -> Array:
            return resample(clock, of_sensors, time + delay_s)

        return np.hstack([_undelayed(kind, delays_s, read) for kind in kinds])

    different = {time.tobytes(): time for time in plate_times}
    at = {key: accelerations(time) for key, time in different.items()}
    return [at[time.tobytes()] for time in plate_times]


@dataclass(frozen=True, slots=True)
class RealtimeAccelerometers:
    """How what accelerometers measure follows from their samples.

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

    def accelerations(self, read: Signal, at: Array) -> Array:
        """Give what they measure at instants on the plates' clock, (T, k (1 + lags)) [m/s²].

        From their resampled readings at any times, (T, k); NaN where unknown.
        """
        kinds = [now := self._undelayed(read, at)]
        for lag_s in self.lags_s:
            later, earlier = (self._undelayed(read, at + s) for s in (lag_s, -lag_s))
            # second difference over the lag
            kinds.append(later - 2 * now + earlier)
        return np.concatenate(kinds, axis=1)

    def _undelayed(self, read: Signal, at: Array) -> Array:
        by_delay = {delay_s: read(at + delay_s) for delay_s in set(self.delays_s)}
        of_sensors = [
            by_delay[late_s][:, 3 * k : 3 * k + 3] for k, late_s in enumerate(self.delays_s)
        ]
        return np.concatenate(of_sensors, axis=1)
