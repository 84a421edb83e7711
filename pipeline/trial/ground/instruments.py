"""Analog channels of a recording in SI units."""

from collections.abc import Callable

from hbm.spatial import Array
from pipeline.io.recording import Recording


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
