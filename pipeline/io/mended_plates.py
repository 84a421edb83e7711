"""Plates mended as a person states it: channels reversed, turned, scaled; plates moved."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import percentile_filter

from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices, shift_wrench
from pipeline.io.recording import Plate, Recording
from pipeline.io.stated import parse_mending

NEAR_SAMPLES: Final = 8
"""Samples on both sides of a jump that show how fast the load changes without it."""
JUMP: Final = 12.0
"""By the upper quartile of the changes near it. The onset of a load is up to 6 times as steep, as
the low-pass before the converter spreads it over some samples."""
ISOLATED: Final = 4.0
"""By the change in the same direction in the sample before or after it: an impact lasts longer."""
FULL_RANGE: Final = 1.06
"""Largest range of a channel by its jumps, where these are wraps: between two samples the load
itself changes too."""

MOST: Final = 0.8
"""Of a jump: other changes as large are jumps too, also where noise crosses the limit often."""


class Jumps(NamedTuple):
    """Samples of one channel between which no foot can change its load.

    Attributes
    ----------
    at
        Sample before each jump, (J,).
    size
        Of each, signed, (J,) [N or N·m].
    wraps
        Whether a converter or a counter overflows: unwrapping removes the jumps.
    """

    at: Indices
    size: Array
    wraps: bool


def find_jumps(channel: Array, least: float = 0.0) -> Jumps:
    """Find the jumps of a raw channel, (N,), of at least a size [N or N·m].

    Samples that are exactly zero are lost or gated, and no jump begins or ends there.
    """
    change = np.diff(channel)
    if not (np.abs(change) > least).any():
        return Jumps(np.zeros(0, int), np.zeros(0), False)
    span = 2 * NEAR_SAMPLES + 1
    usual = percentile_filter(np.abs(change), 75, size=span, mode="nearest")
    known = (channel[1:] != 0) & (channel[:-1] != 0)
    at = np.flatnonzero(known & (np.abs(change) > np.maximum(least, JUMP * usual)))
    if len(at) and _wraps(channel, change[at], least):
        return Jumps(at, change[at], True)
    sign, around = np.sign(change), np.pad(change, 1)
    same_way = np.maximum(sign * around[:-2], sign * around[2:])
    at = at[np.abs(change[at]) > ISOLATED * same_way[at]]
    return Jumps(at, change[at], False)


def _wraps(channel: Array, jumps: Array, least: float) -> bool:
    """Tell whether a channel overflows: it jumps by its full range, and not once unwrapped."""
    period = float(np.median(np.abs(jumps)))
    back_and_forth = np.count_nonzero(np.abs(np.diff(channel)) > MOST * period) > 1
    if not back_and_forth or np.ptp(channel) > FULL_RANGE * period:
        return False
    undone = np.unwrap(channel, period=period)
    return not len(find_jumps(undone, least).at)


def with_mended_plates(recording: Recording) -> Recording:
    """Mend the plates of a recording as is stated of it; a note says what was done.

    Channels are those of the plate's own axes, the action on the subject; they are reversed, turned
    and amplified about its transducer, the rest is about the centre of its surface. One that does
    not wrap in this recording stays as it is. Exchanged plates keep their places and exchange what
    they measured. A recording without plates stays as it is.

    Raises
    ------
    ValueError
        A plate is not in the recording, which has others.
    """
    stated = recording.stated.mend_plates
    if not stated or not recording.plates:
        return recording
    note = Note.of("plates_mended", done=[" ".join(text.split()) for text in stated])
    plates = mended_plates(recording.plates, stated)
    return replace(recording, plates=plates, notes=(*recording.notes, note))


def mended_plates(given: Sequence[Plate], stated: Sequence[str]) -> tuple[Plate, ...]:
    """Mend plates in their own axes; errors are those of `with_mended_plates`."""
    plates = {plate.number: plate for plate in given}
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
            for one, measured in ((plate, other), (other, plate)):
                plates[one.number] = replace(
                    one, time=measured.time, wrench_in_plate=measured.wrench_in_plate
                )
        elif deed == "move":
            axis, metres = what.split()
            way = float(metres) * plate.rotation[:, "xyz".index(axis)]
            plates[number] = replace(plate, center=plate.center + way, corners=plate.corners + way)
        else:
            plates[number] = replace(plate, wrench_in_plate=_mended(plate, deed, what))
    return tuple(plates.values())


def _mended(plate: Plate, deed: str, what: str) -> Array:
    """Give what a plate measured, with its channels mended, (N, 6)."""
    if deed in CHANGES:
        return of_channels(plate, CHANGES[deed](what), plate.wrench_in_plate)
    component, *zero = what.split()
    wrench = np.array(plate.wrench_in_plate)
    channel = wrench[:, WRENCH_COMPONENTS.index(component)]
    if deed == "zero":
        channel -= float(zero[0])
    elif (jumps := find_jumps(channel)).wraps:
        channel[:] = np.unwrap(channel, period=float(np.median(np.abs(jumps.size))))
    return wrench


def of_channels(plate: Plate, change: Array, wrench: Array) -> Array:
    """Give a plate's wrench, (N, 6), as if its channels were changed by a matrix, (6, 6).

    Channels hold moments about the transducer.
    """
    return shift_wrench(shift_wrench(wrench, plate.transducer) @ change.T, -plate.transducer)


def turning(degrees: str | int) -> Array:
    """Give what turns a wrench about the plate's third axis, (6, 6)."""
    angle = np.radians(int(degrees))
    cos, sin = round(np.cos(angle)), round(np.sin(angle))
    about_z = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.kron(np.eye(2), about_z)


def reversing(what: str) -> Array:
    """Give what reverses one component of a wrench, or all, (6, 6)."""
    return np.diag([-1.0 if what in (name, "all") else 1.0 for name in WRENCH_COMPONENTS])


def _amplifying(what: str) -> Array:
    component, factor = what.split()
    return np.diag([float(factor) if component == name else 1.0 for name in WRENCH_COMPONENTS])


CHANGES: Final = {"turn": turning, "reverse": reversing, "gain": _amplifying}
"""Deed -> what it does to the channels of a plate."""
