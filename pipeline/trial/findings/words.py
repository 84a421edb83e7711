"""Findings of plates in words: a note for all who read, and the cells of a table."""

from collections.abc import Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from hbm.notes import Note
from hbm.spatial import WRENCH_COMPONENTS, Array
from hbm.spelling import written
from pipeline.io.recording import Plate
from pipeline.io.stated import correction
from pipeline.trial.findings.finding import Correction, Finding

AXES: Final = ("forward", "sideways", "vertical")
CHANNELS_OF: Final = "force", "moment"


class Row(NamedTuple):
    """A finding in a table: what, how large, by which evidence, what mends it, what to do."""

    what: str
    size: str
    evidence: str
    effect: str
    advice: str


def note_of(
    finding: Finding, plates: Sequence[Plate], time: Array, remedy: str | None = None
) -> Note:
    """Put a finding in words; what cannot be told apart together.

    Parameters
    ----------
    finding, plates
        Of a trial.
    time
        Of its frames, (T,) [s].
    remedy
        What to type; by default with what it does.
    """
    if finding.rivals:
        alone = (str(_of_one(one, plates, time, "")) for one in _rivals(finding))
        return Note.of("plates_unclear", faults="; or ".join(alone))
    remedy = remedy_of(finding.correction) if remedy is None else remedy
    return _of_one(finding, plates, time, remedy)


def row_of(finding: Finding, plates: Sequence[Plate], time: Array) -> Row:
    """Put a finding in the cells of a table; what cannot be told apart in one row."""
    tried = finding.correction
    typed = _typed(tried) + "." if tried is not None and tried.helps else ""
    advice = " ".join(note_of(finding, plates, time, typed).advice.split())
    effect = "none can be typed" if tried is None else tried.effect
    if finding.rivals:
        effect = "not tried: which one is unknown"
    elif tried is not None and not tried.helps:
        effect = f"not advised: {effect}"
    what, sizes = zip(*(_cells(one, plates) for one in _rivals(finding)), strict=True)
    if finding.evidence is None:
        first_s = min(fault.first_s for fault in finding.channels)
        samples = sum(fault.count for fault in finding.channels)
        evidence = f"raw samples: {samples}, first at {first_s:.3f} s"
    else:
        evidence = f"{finding.evidence:.0f}"
    return Row("\nor ".join(what), "\n".join(sizes), evidence, effect, advice)


def remedy_of(tried: Correction | None) -> str:
    """Say what to type, and what it does, or that it does not help."""
    if tried is None:
        return "No correction can be typed."
    if not tried.helps:
        return f"Its correction was tried and is not advised: {tried.effect}."
    return f"{_typed(tried)}: {tried.effect}."


def _typed(tried: Correction) -> str:
    if tried.plate_delay_s is None:
        return f"Set {correction(*tried.mendings)}"
    delay, option_ms = tried.plate_delay_s, 1000 * tried.plate_delay_s
    return f"Set plate_delay_s = {delay:.3f} (--plate-delay-ms {option_ms:.0f})"


def _rivals(finding: Finding) -> tuple[Finding, ...]:
    return finding, *finding.rivals


def _of_one(finding: Finding, plates: Sequence[Plate], time: Array, remedy: str) -> Note:
    """Put one fault in words, without its rivals."""
    number, size, interval = finding.plates[0], finding.size, finding.interval
    of_plate = partial(Note.of, plate=number)
    of_channels = {fault.channel: abs(fault.size) for fault in finding.channels}
    first_s = min((fault.first_s for fault in finding.channels), default=0.0)
    of_jumps = partial(of_plate, jumps=sum(f.count for f in finding.channels), first_s=first_s)
    match finding.kind:
        case "dead":
            return of_plate("plate_dead", channels=[*of_channels])
        case "clipped":
            frames = _frames(finding, time)
            return of_plate("plate_clipped", limits=of_channels, frames=frames, first_s=first_s)
        case "wraps":
            return of_jumps("plate_wraps", sizes=of_channels, remedy=remedy)
        case "jumps":
            return of_jumps("plate_jumps", sizes=of_channels)
        case "gain":
            share, low, high = _share(finding)
            gain = partial(of_plate, share=share, low=low, high=high, remedy=remedy)
            direction = _direction(finding, plates)
            return gain("plate_gain", component=finding.component, direction=direction)
        case "reversed":
            return of_plate("plate_reversed", what=finding.component, remedy=remedy)
        case "turned":
            return of_plate("plate_turned", what=finding.component, remedy=remedy)
        case "exchanged":
            first, second = finding.plates
            return Note.of("plates_exchanged", first=first, second=second, remedy=remedy)
        case "moved":
            off_m, interval_m = _off_m(finding, plates), max(interval)
            moved = partial(of_plate, off_m=off_m, interval_m=interval_m)
            return moved("plate_elsewhere", remedy=remedy)
        case "askew":
            turn_deg, interval_deg = -np.degrees(size[0]), np.degrees(interval[0])
            return of_plate("plate_askew", turn_deg=turn_deg, interval_deg=interval_deg)
        case "late":
            return of_plate("plate_late", delay_s=size[0], interval_s=interval[0])
    return Note.of("plates_late", delay_s=size[0], uncertainty_s=interval[0], remedy=remedy)


def _cells(finding: Finding, plates: Sequence[Plate]) -> tuple[str, str]:
    """Say what one fault is, and how large."""
    plate, name = f"plate {finding.plates[0]}", finding.component
    channels = ", ".join(fault.channel for fault in finding.channels)
    sizes = ", ".join(
        f"{written(abs(f.size), '.0f')} {'N' if f.channel[0] == 'F' else 'N·m'}"
        for f in finding.channels
    )
    match finding.kind:
        case "dead":
            return f"{plate}: no signal in {channels}", "whole trial"
        case "clipped":
            return f"{plate}: {channels} clipped", f"at {sizes}"
        case "wraps":
            return f"{plate}: {channels} overflows", f"by {sizes}"
        case "jumps":
            return f"{plate}: {channels} jumps", f"by {sizes}"
        case "gain":
            share, low, high = (f"{100 * value:.0f}" for value in _share(finding))
            what = f"{plate}: gain of {name}, {_direction(finding, plates)}"
            return what, f"{share} %, {low} to {high} %"
        case "reversed":
            return f"{plate}: sign of {name}", "× −1"
        case "turned":
            return f"{plate}: channels turned", f"{name}°"
        case "exchanged":
            return f"plates {finding.plates[0]} and {finding.plates[1]}: exchanged", "all channels"
        case "moved":
            half = 1000 * max(finding.interval)
            off = (f"{k} {written(1000 * m, '+z.0f')}" for k, m in _off_m(finding, plates).items())
            return f"{plate}: place", f"{', '.join(off)}, ± {half:.0f} mm"
        case "askew":
            turn, half = -np.degrees(finding.size[0]), np.degrees(finding.interval[0])
            return f"{plate}: turned about the vertical", f"{written(turn, '+.0f')} ± {half:.0f}°"
    late = f"{written(1000 * finding.size[0], '.0f')} ± {1000 * finding.interval[0]:.0f} ms"
    return (f"{plate}: late" if finding.kind == "late" else "all plates: late"), late


def _share(finding: Finding) -> tuple[float, float, float]:
    """Give what a channel measures of what it should, and the ends of the interval."""
    # what corrects it is a factor; what is measured is its inverse
    factor, half = 1 + finding.size[0], finding.interval[0]
    low, high = sorted((1 / (factor + half), 1 / (factor - half)))
    return 1 / factor, low, high


def _direction(finding: Finding, plates: Sequence[Plate]) -> str:
    """Name a channel by the axis of the lab that is nearest to it."""
    k = WRENCH_COMPONENTS.index(finding.component)
    column = _plate_of(finding, plates).rotation[:, k % 3]
    return f"{AXES[int(np.argmax(np.abs(column)))]} {CHANNELS_OF[k // 3]}"


def _off_m(finding: Finding, plates: Sequence[Plate]) -> dict[str, float]:
    """Give where a plate is from where it is said to be, in the axes of the lab."""
    off = _plate_of(finding, plates).rotation @ -np.array([*finding.size, 0.0])
    return {"forward": float(off[0]), "left": float(off[1])}


def _plate_of(finding: Finding, plates: Sequence[Plate]) -> Plate:
    return next(plate for plate in plates if plate.number == finding.plates[0])


def _frames(finding: Finding, time: Array) -> int:
    """Count the frames in which a channel is clipped."""
    spans = np.array([span for fault in finding.channels for span in fault.spans_s])
    inside = (spans[:, :1] <= time) & (time <= spans[:, 1:])
    return int(np.count_nonzero(inside.any(axis=0)))
