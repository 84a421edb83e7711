"""Plates mended as a person states it: channels reversed, turned, exchanged or unwrapped."""

import re
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from hbm.spelling import short
from pipeline.io.recording import Plate, Recording

MENDING: Final = re.compile(
    r"\s*(\d{1,2})\s*:\s*(?:(reverse)\s+([FM][xyz]|all)|(turn)\s+(90|180|270)"
    r"|(exchange)\s+(\d{1,2})|(unwrap)\s+([FM][xyz]))\s*",
    re.ASCII,
)
EXAMPLES: Final = "3: reverse Fx, 2: turn 90, 1: exchange 2, or 2: unwrap Mz"

MOST: Final = 0.8
"""Of the largest change between two samples: the others that large are wraps too."""
MAX_RANGE: Final = 1.3
"""Of a channel, by what it jumps where it wraps; the load itself changes meanwhile."""


def parse_mending(text: str) -> tuple[int, str, str]:
    """Parse what is done to one plate: its number, the deed, and with what.

    Examples
    --------
    >>> parse_mending("2: turn 90")
    (2, 'turn', '90')
    """
    match = MENDING.fullmatch(text)
    if match is None:
        raise ValueError(f"a plate is mended by such as {EXAMPLES}; got {short(text)!r}")
    number, deed, what = (part for part in match.groups() if part is not None)
    return int(number), deed, what


def with_mended_plates(recording: Recording) -> Recording:
    """Mend the plates of a recording as is stated of it; a note says what was done.

    Reversed, turned and unwrapped channels are those of the plate's own axes about the centre of
    its surface. Exchanged plates keep their places and exchange what they measured.

    Raises
    ------
    ValueError
        A plate is not in the recording, or a channel that should be unwrapped never jumps.
    """
    stated = recording.stated.mend_plates
    if not stated:
        return recording
    plates = {plate.number: plate for plate in recording.plates}
    for text in stated:
        number, deed, what = parse_mending(text)
        for wanted in (number, int(what) if deed == "exchange" else number):
            if wanted not in plates:
                has = ", ".join(map(str, plates)) or "none"
                raise ValueError(
                    f"mend_plates: there is no plate {wanted}; the recording has plates {has}"
                )
        plate = plates[number]
        if deed == "exchange":
            other = plates[int(what)]
            plates[number] = _measuring(plate, other.time, other.wrench_in_plate)
            plates[other.number] = _measuring(other, plate.time, plate.wrench_in_plate)
        elif deed == "unwrap":
            wrench = np.array(plate.wrench_in_plate)
            k = WRENCH_COMPONENTS.index(what)
            wrench[:, k] = _unwrapped(wrench[:, k], f"plate {number} {what}")
            plates[number] = _measuring(plate, plate.time, wrench)
        else:
            change = turning(int(what)) if deed == "turn" else reversing(what)
            plates[number] = _measuring(plate, plate.time, plate.wrench_in_plate @ change.T)
    note = Note.of("plates_mended", done=[" ".join(text.split()) for text in stated])
    return replace(recording, plates=tuple(plates.values()), notes=(*recording.notes, note))


def _measuring(plate: Plate, time: Array, wrench: Array) -> Plate:
    return replace(plate, time=time, wrench_in_plate=wrench)


def _unwrapped(channel: Array, name: str) -> Array:
    """Unwrap a channel that jumps by its full range."""
    change = np.abs(np.diff(channel))
    period = float(np.median(change[change >= MOST * change.max()]))
    if period == 0 or np.ptp(channel) > MAX_RANGE * period:
        raise ValueError(f"mend_plates: {name} does not wrap: it never jumps by its full range")
    return np.asarray(np.unwrap(channel, period=period))


def turning(degrees: int) -> Array:
    """Give what turns a wrench about the plate's third axis, (6, 6)."""
    angle = np.radians(degrees)
    cos, sin = round(np.cos(angle)), round(np.sin(angle))
    about_z = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.kron(np.eye(2), about_z)


def reversing(what: str) -> Array:
    """Give what reverses one component of a wrench, or all, (6, 6)."""
    return np.diag([-1.0 if what in (name, "all") else 1.0 for name in WRENCH_COMPONENTS])
