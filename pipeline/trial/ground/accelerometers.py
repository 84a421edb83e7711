"""Which analog channels of a recording are accelerometers."""

import re
from typing import Final

from pipeline.io.recording import Recording
from pipeline.io.units import acceleration_in_mps2

AXIS: Final = re.compile(r"(?P<sensor>.*?)[ ._-]?(?P<axis>[xyz])", re.IGNORECASE)
WORD: Final = re.compile(r"acc", re.IGNORECASE)


def find_accelerometers(recording: Recording) -> dict[str, tuple[str, str, str]]:
    """Find the triaxial accelerometers among a recording's analog channels.

    Parameters
    ----------
    recording
        The trial.

    Returns
    -------
    dict
        Sensor name -> its x, y and z channel: channels whose unit is one of acceleration or whose
        name holds "acc", and that end in x, y or z.

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
        match = AXIS.fullmatch(name)
        if match and (WORD.search(name) or _is_acceleration(unit)):
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


def _is_acceleration(unit: str) -> bool:
    try:
        acceleration_in_mps2(unit)
    except ValueError:
        return False
    return True
