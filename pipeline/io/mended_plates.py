"""Plates mended as a person states it: channels reversed, turned, scaled; plates moved."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.converters import Wraps, find_wraps
from hbm.spatial import WRENCH_COMPONENTS, Array, shift_wrench
from pipeline.io.read_options import parse_mending
from pipeline.io.recording import Plate, Recording

LIMITS: Final = read_numbers("pipeline.io", "thresholds.toml", "plates")


def channels_about(plate: Plate) -> Iterator[tuple[Array, Array]]:
    """Give what a plate's channels may be: about where, (3,), and they, (N, 6).

    Moments are about the transducer, or, where an amplifier shifts them, the middle of the surface.
    """
    for about in (plate.transducer, np.zeros(3))[: 1 + plate.transducer.any()]:
        yield about, shift_wrench(plate.wrench_in_plate, about)


def find_overflows(plate: Plate) -> tuple[Array, dict[int, Wraps]]:
    """Find the channels of a plate that overflow: about where, (3,), and number -> overflows."""
    for about, channels in channels_about(plate):
        by_axis = enumerate(map(find_wraps, channels.T, LIMITS.least_wrap.tolist()))
        if overflows := {axis: wraps for axis, wraps in by_axis if wraps is not None}:
            return about, overflows
    return plate.transducer, {}


def with_mended_plates(recording: Recording) -> Recording:
    """Mend the plates of a recording as is stated of it; a note says what was done, and what not.

    Channels are those of the plate's own axes, the action on the subject; they are reversed,
    turned, amplified and unwrapped about its transducer, the rest is about the centre of its
    surface. One that does not wrap in this recording stays as it is. Exchanged plates keep their
    places and exchange what they measured. A zero that drifts is followed once it is known where
    the feet are (`pipeline.trial.findings.drift`). A recording without plates stays as it is.

    Raises
    ------
    ValueError
        A plate is not in the recording, which has others.
    """
    mendings = recording.options.mend_plates
    if not mendings or not recording.plates:
        return recording
    plates, done = recording.plates, list[str]()
    for text in mendings:
        number, deed, what = parse_mending(text)
        wraps = {p.number: find_overflows(p)[1] for p in plates if deed == "unwrap"}
        idle = wraps and WRENCH_COMPONENTS.index(what) not in wraps.get(number, {})
        done.append(" ".join(text.split()) + (" (does not wrap here)" if idle else ""))
        plates = mended_plates(plates, (text,))
    note = Note.of("plates_mended", done=done)
    return replace(recording, plates=plates, notes=(*recording.notes, note))


def mended_plates(measured: Sequence[Plate], mendings: Sequence[str]) -> tuple[Plate, ...]:
    """Mend plates in their own axes; errors are those of `with_mended_plates`."""
    plates = {plate.number: plate for plate in measured}
    for text in mendings:
        number, deed, what = parse_mending(text)
        for named in (number, int(what) if deed == "exchange" else number):
            if named not in plates:
                has = ", ".join(map(str, plates)) or "none"
                raise ValueError(
                    f"mend_plates: there is no plate {named}; the recording has plates {has}"
                )
        plate = plates[number]
        if deed == "exchange":
            other = plates[int(what)]
            for here, there in ((plate, other), (other, plate)):
                plates[here.number] = replace(
                    here, time=there.time, wrench_in_plate=there.wrench_in_plate
                )
        elif deed == "drift":
            continue
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
    axis, wrench = WRENCH_COMPONENTS.index(component), np.array(plate.wrench_in_plate)
    if deed == "zero":
        wrench[:, axis] -= float(zero[0])
        return wrench
    about, overflows = find_overflows(plate)
    if axis not in overflows:
        return plate.wrench_in_plate
    # a converter overflows in its own channels, whose moments are about the transducer
    channels = shift_wrench(wrench, about)
    channels[:, axis] = overflows[axis].undone
    return shift_wrench(channels, -about)


def of_channels(plate: Plate, change: Array, wrench: Array) -> Array:
    """Give a plate's wrench, (N, 6), as if its channels were changed by a matrix, (6, 6).

    Channels hold moments about the transducer.
    """
    # to the transducer, where the change is, and back to the centre of the surface
    return shift_wrench(shift_wrench(wrench, plate.transducer) @ change.T, -plate.transducer)


def turning(degrees: str | int) -> Array:
    """Give what turns a wrench about the plate's third axis, (6, 6)."""
    angle = np.radians(int(degrees))
    cos, sin = round(np.cos(angle)), round(np.sin(angle))
    return np.kron(np.eye(2), [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def reversing(what: str) -> Array:
    """Give what reverses one component of a wrench, or all, (6, 6)."""
    return np.diag([-1.0 if what in (name, "all") else 1.0 for name in WRENCH_COMPONENTS])


def _amplifying(what: str) -> Array:
    component, factor = what.split()
    return np.diag([float(factor) if component == name else 1.0 for name in WRENCH_COMPONENTS])


CHANGES: Final = {"turn": turning, "reverse": reversing, "gain": _amplifying}
"""Deed -> what it does to the channels of a plate."""
