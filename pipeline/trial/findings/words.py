"""Findings of plates in words: a note for all who read, and the cells of a table."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array
from hbm.spelling import written
from pipeline.io.read_options import correction
from pipeline.io.recording import Plate
from pipeline.trial.findings.finding import Correction, Finding


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
        alone = (str(_said(one, plates, time)[0]) for one in _rivals(finding))
        return Note.of("plates_unclear", faults="; or ".join(alone))
    remedy = remedy_of(finding.correction) if remedy is None else remedy
    return _said(finding, plates, time, remedy)[0]


def row_of(finding: Finding, plates: Sequence[Plate], time: Array) -> Row:
    """Put a finding in the cells of a table; what cannot be told apart in one row."""
    # a correction that helps is advice; what does not help stands in the column of effects
    tried = finding.correction
    typed = _typed(tried) + "." if tried is not None and tried.helps else ""
    advice = " ".join(note_of(finding, plates, time, typed).advice.split())
    effect = "none can be typed" if tried is None else tried.effect
    if finding.rivals:
        effect = "not tried: which one is unknown"
    elif tried is not None and not tried.helps:
        effect = f"not advised: {effect}"
    # what the trial cannot tell apart shares a row
    _, what, sizes = zip(*(_said(one, plates, time) for one in _rivals(finding)), strict=True)
    if finding.kind in ("zero", "drift"):
        evidence = "readings without load"
    elif finding.evidence is None:
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
    return f"Set plate_delay_s = {delay:.3f} in [settings] (--plate-delay-ms {option_ms:.0f})"


def _rivals(finding: Finding) -> tuple[Finding, ...]:
    return finding, *finding.rivals


def _said(
    finding: Finding, plates: Sequence[Plate], time: Array, remedy: str = ""
) -> tuple[Note, str, str]:
    """Put one fault in words, without its rivals: a note; what it is, and how large."""
    number, size, interval = finding.plates[0], finding.size, finding.interval
    plate, name = f"plate {number}", finding.component
    of_plate = partial(Note.of, plate=number)
    sizes = {fault.channel: abs(fault.size) for fault in finding.channels}
    channels, larger = ", ".join(sizes), ", ".join(map(_with_unit, sizes.items()))
    first_s = min((fault.first_s for fault in finding.channels), default=0.0)
    of_jumps = partial(of_plate, jumps=sum(f.count for f in finding.channels), first_s=first_s)
    match finding.kind:
        case "dead":
            note = of_plate("plate_dead", channels=[*sizes])
            return note, f"{plate}: no signal in {channels}", "whole trial"
        case "clipped":
            frames = _frames(finding, time)
            note = of_plate("plate_clipped", limits=sizes, frames=frames, first_s=first_s)
            return note, f"{plate}: {channels} clipped", f"at {larger}"
        case "wraps":
            note = of_jumps("plate_wraps", sizes=sizes, remedy=remedy)
            return note, f"{plate}: {channels} overflows", f"by {larger}"
        case "lost":
            samples = max(fault.count for fault in finding.channels)
            note = of_plate("plate_samples_zero", samples=samples, first_s=first_s)
            return note, f"{plate}: samples of {channels} lost", f"{samples} exactly zero"
        case "zero":
            rest_n = {f"plate {k}": force for k, force in zip(finding.plates, size, strict=True)}
            total = {"total_n": sum(size), "mass_kg": sum(size) / GRAVITY_MPS2}
            words = {"components": name or "none", "remedy": remedy}
            note = Note.of("plates_not_zeroed", rest_n=rest_n, **total, **words)
            forces = (f"{k} Fz {written(force, '+.0f')} N" for k, force in rest_n.items())
            return note, "plates: not zero without load", "\n".join([*forces, *name.split(", ")])
        case "drift":
            channels_changed = zip(name.split(", "), size, interval, strict=True)
            drifts = [
                f"{k} {written(n, '+.1f')} ± {_with_unit((k, half), '.2g')}"
                for k, n, half in channels_changed
            ]
            first_s, last_s = finding.span_s or (0.0, 0.0)
            span = {"first_s": first_s, "last_s": last_s}
            note = of_plate("plate_drifts", changes=drifts, **span, remedy=remedy)
            return note, f"{plate}: zero drifts", "\n".join(drifts)
        case "jumps":
            note = of_jumps("plate_jumps", sizes=sizes)
            return note, f"{plate}: {channels} jumps", f"by {larger}"
        case "gain":
            fraction, low, high = _share(finding)
            direction = _direction(finding, plates)
            gain = partial(of_plate, share=fraction, low=low, high=high, component=name)
            note = gain("plate_gain", direction=direction, remedy=remedy)
            percent = f"{100 * fraction:.0f} %, {100 * low:.0f} to {100 * high:.0f} %"
            return note, f"{plate}: gain of {name}, {direction}", percent
        case "reversed":
            note = of_plate("plate_reversed", what=name, remedy=remedy)
            return note, f"{plate}: sign of {name}", "× −1"
        case "turned":
            note = of_plate("plate_turned", what=name, remedy=remedy)
            return note, f"{plate}: channels turned", f"{name}°"
        case "exchanged":
            first, second = finding.plates
            note = Note.of("plates_exchanged", first=first, second=second, remedy=remedy)
            return note, f"plates {first} and {second}: exchanged", "all channels"
        case "moved":
            off_m, half_m = _off_m(finding, plates), max(interval)
            moved = partial(of_plate, off_m=off_m, interval_m=half_m)
            off = ", ".join(f"{way} {written(1000 * m, '+z.0f')}" for way, m in off_m.items())
            note = moved("plate_elsewhere", remedy=remedy)
            return note, f"{plate}: place", f"{off}, ± {1000 * half_m:.0f} mm"
        case "askew":
            turn_deg, half_deg = -np.degrees(size[0]), np.degrees(interval[0])
            note = of_plate("plate_askew", turn_deg=turn_deg, interval_deg=half_deg)
            turn = f"{written(turn_deg, '+.0f')} ± {half_deg:.0f}°"
            return note, f"{plate}: turned about the vertical", turn
    late_ms = f"{written(1000 * size[0], '.0f')} ± {1000 * interval[0]:.0f} ms"
    if finding.kind == "late":
        note = of_plate("plate_late", delay_s=size[0], interval_s=interval[0])
        return note, f"{plate}: late", late_ms
    note = Note.of("plates_late", delay_s=size[0], uncertainty_s=interval[0], remedy=remedy)
    return note, "all plates: late", late_ms


def _with_unit(channel: tuple[str, float], spec: str = ".0f") -> str:
    return f"{channel[1]:{spec}} {'N' if channel[0].startswith('F') else 'N·m'}"


def _share(finding: Finding) -> tuple[float, float, float]:
    """Give what a channel measures of what it should, and the ends of the interval."""
    # what corrects it is a factor; what is measured is its inverse
    factor, half = 1 + finding.size[0], finding.interval[0]
    low, high = sorted((1 / (factor + half), 1 / (factor - half)))
    return 1 / factor, low, high


def _direction(finding: Finding, plates: Sequence[Plate]) -> str:
    """Name a channel by the axis of the lab that is nearest to it."""
    k = WRENCH_COMPONENTS.index(finding.component)
    # direction of the channel in the lab
    column = _plate_of(finding, plates).rotation[:, k % 3]
    axis = ("forward", "sideways", "vertical")[int(np.argmax(np.abs(column)))]
    return f"{axis} {'force' if k < 3 else 'moment'}"


def _off_m(finding: Finding, plates: Sequence[Plate]) -> dict[str, float]:
    """Give where a plate is from where it is said to be, in the axes of the lab."""
    # what corrects the place is the opposite of where it is; from the plate's axes to the lab
    off = _plate_of(finding, plates).rotation @ -np.array([*finding.size, 0.0])
    return {"forward": float(off[0]), "left": float(off[1])}


def _plate_of(finding: Finding, plates: Sequence[Plate]) -> Plate:
    return next(plate for plate in plates if plate.number == finding.plates[0])


def _frames(finding: Finding, time: Array) -> int:
    """Count the frames in which a channel is clipped."""
    spans = np.array([span for fault in finding.channels for span in fault.spans_s])
    inside = (spans[:, :1] <= time) & (time <= spans[:, 1:])
    return int(np.count_nonzero(inside.any(axis=0)))
