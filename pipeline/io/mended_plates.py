"""Plates mended as a person states it: channels reversed, turned, scaled; plates moved."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import percentile_filter

from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array, Indices, shift_wrench
from pipeline.io.axes import MIN_MEAN_LOAD_N, find_sites, mean_force
from pipeline.io.recording import Fact, Plate, Recording
from pipeline.io.stated import correction, parse_mending

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
    same = np.maximum(np.sign(change[1:]) * change[:-1], 0.0), np.sign(change[:-1]) * change[1:]
    beside = np.maximum(np.append(0.0, same[0]), np.append(np.maximum(same[1], 0.0), 0.0))
    at = at[np.abs(change[at]) > ISOLATED * beside[at]]
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
            plates[number] = _measuring(plate, other.time, other.wrench_in_plate)
            plates[other.number] = _measuring(other, plate.time, plate.wrench_in_plate)
        elif deed == "unwrap":
            wrench = np.array(plate.wrench_in_plate)
            k = WRENCH_COMPONENTS.index(what)
            wrench[:, k] = _unwrapped(wrench[:, k])
            plates[number] = _measuring(plate, plate.time, wrench)
        elif deed == "move":
            axis, metres = what.split()
            way = float(metres) * plate.rotation[:, "xyz".index(axis)]
            plates[number] = replace(plate, center=plate.center + way, corners=plate.corners + way)
        elif deed == "zero":
            component, value = what.split()
            wrench = np.array(plate.wrench_in_plate)
            wrench[:, WRENCH_COMPONENTS.index(component)] -= float(value)
            plates[number] = _measuring(plate, plate.time, wrench)
        else:
            change = CHANGES[deed](what)
            wrench = of_channels(plate, change, plate.wrench_in_plate)
            plates[number] = _measuring(plate, plate.time, wrench)
    return tuple(plates.values())


def reversed_plates(recording: Recording) -> list[Fact]:
    """Say which plates pull the subject down, and how to mend them: as brings them under feet."""
    markers, facts = recording.markers, list[Fact]()
    feet = markers.position[:, find_sites(markers.names, recording.stated.marker_set).low]
    for plate in recording.plates:
        pull_n = -float(plate.rotation[2] @ mean_force(plate.wrench_in_plate[:, :3]))
        if pull_n < MIN_MEAN_LOAD_N:
            continue
        deeds = [f"{plate.number}: reverse {what}" for what in ("all", "Fz")]
        mended = [mended_plates([plate], [deed])[0] for deed in deeds]
        away_m = [_away_from(feet, each, markers.time) for each in mended]
        remedy = correction(deeds[int(np.argmin(away_m))])
        doubt = f"it pulls the subject down by {pull_n:.0f} N on average: set {remedy}"
        facts.append(Fact("in_doubt", f"plate {plate.number}", doubt))
    return facts


def _away_from(feet: Array, plate: Plate, time: Array) -> float:
    """Give how far the pressure of a loaded plate is from the nearest marker of feet [m]."""
    wrench = np.stack([np.interp(time, plate.time, c) for c in plate.wrench_in_plate.T], axis=1)
    loaded = np.abs(wrench[:, 2]) > MIN_MEAN_LOAD_N
    force, mx, my = wrench[loaded, 2], wrench[loaded, 3], wrench[loaded, 4]
    pressure = np.stack([-my / force, mx / force, 0 * force], axis=1)
    apart = feet[loaded] - (plate.center + pressure @ plate.rotation.T)[:, None]
    away = np.linalg.norm(apart[..., :2], axis=-1)
    away = away[np.isfinite(away).any(axis=1)]
    return float(np.median(np.nanmin(away, axis=1))) if away.size else np.inf


def _measuring(plate: Plate, time: Array, wrench: Array) -> Plate:
    return replace(plate, time=time, wrench_in_plate=wrench)


def _unwrapped(channel: Array) -> Array:
    """Unwrap a channel that wraps; another one stays as it is."""
    jumps = find_jumps(channel)
    if not jumps.wraps:
        return channel
    return np.asarray(np.unwrap(channel, period=float(np.median(np.abs(jumps.size)))))


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
