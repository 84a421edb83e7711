"""Signals of instruments: channels in SI units, the speed of the belts, ends that are held."""

import re
from collections.abc import Callable
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.io.units import speed_in_mps

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


def mean_belt_speed(recording: Recording, treadmill: Treadmill) -> float | None:
    """Give the constant speed of belts whose fourth power is a recording's mean [m/s].

    What rollers leave on plates has a variance that grows with it. None where it is unknown;
    parameters and errors are those of `fastest_belt`.
    """
    found = fastest_belt(recording, treadmill)
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
