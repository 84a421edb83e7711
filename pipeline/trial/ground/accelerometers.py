"""Accelerometers on the platform: their channels in a recording, and what they read."""

import re
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.trial.ground.instruments import read_channel

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
            f"({', '.join(names) or 'none'}); name channels such as Acc1.X, Acc1.Y, Acc1.Z, or "
            "state them in a study's treadmill.accelerometers"
        )
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
    return channels[0][0], np.column_stack([values for _, values in channels])


def _is_acceleration(unit: str) -> bool:
    try:
        acceleration_in_mps2(unit)
    except ValueError:
        return False
    return True
