"""Gait events of a C3D file: its EVENT group, or the old ones of its header."""

import re
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.io.c3d.header import Header
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.recording import Event

KINDS: Final = {
    **dict.fromkeys(
        ("footstrike", "heelstrike", "initialcontact", "fs", "hs", "ic"), "foot_strike"
    ),
    **dict.fromkeys(("footoff", "toeoff", "fo", "to"), "foot_off"),
}
"""Letters of a label without its side -> kind of event."""
SIDES: Final = {"left": "left", "l": "left", "right": "right", "r": "right"}
LABEL: Final = re.compile(
    rf"(?P<before>{'|'.join(SIDES)})?(?P<kind>{'|'.join(KINDS)})(?P<after>{'|'.join(SIDES)})?"
)


def read_events(
    header: Header, parameters: Parameters, start_s: float
) -> tuple[tuple[Event, ...], tuple[Note, ...]]:
    """Give the foot strikes and foot offs of a file.

    Parameters
    ----------
    header, parameters
        What `read_header` gave for the file.
    start_s
        Time of the first frame on the file's own clock [s].

    Returns
    -------
    events
        On the clock of the first frame.
    notes
        ``event_times_flat`` where minutes and seconds do not stand in two rows,
        ``event_sides_from_labels`` where the context does not say the side, but the label does,
        ``events_left_out`` where there are others.

    Raises
    ------
    ValueError
        EVENT:TIMES holds neither minutes and seconds nor seconds of the labelled events.
    """
    times = parameters.numbers("EVENT", "TIMES")
    notes = []
    if times.size:
        labels, contexts = (parameters.texts("EVENT", name) for name in ("LABELS", "CONTEXTS"))
        seconds, flat = _seconds(times, len(labels))
        notes += [Note.of("event_times_flat", numbers=flat)] if flat else []
    else:
        labels, contexts = [label for label, _ in header.events], []
        seconds = np.array([time for _, time in header.events])
    labels += [""] * (len(seconds) - len(labels))
    contexts += [""] * (len(seconds) - len(contexts))
    events = []
    by_label = 0
    for time, label, context in zip(seconds, labels, contexts, strict=False):
        kind, side = _kind_and_side(label)
        stated = SIDES.get(context.lower(), "")
        if kind and np.isfinite(time) and (side or stated) and side in ("", stated or side):
            events.append(Event(float(time - start_s), kind, stated or side))
            by_label += not stated
    if by_label and times.size:
        notes.append(Note.of("event_sides_from_labels", events=by_label))
    if others := len(seconds) - len(events):
        notes.append(Note.of("events_left_out", events=others))
    return tuple(events), tuple(notes)


def _seconds(times: Array, labelled: int) -> tuple[Array, str]:
    """Give the times of the events [s], and how they stand in the file if not in two rows."""
    if times.ndim == 2 and len(times) == 2:
        return 60 * times[0] + times[1], ""
    flat = times.ravel(order="F")
    if len(flat) == 2 * labelled and (flat[::2] % 1 == 0).all():
        return 60 * flat[::2] + flat[1::2], "minutes and seconds in turn"
    if len(flat) == labelled or not labelled:
        return flat, "seconds"
    raise ValueError(
        f"EVENT:TIMES holds {len(flat)} numbers for {labelled} labels, expected minutes and "
        "seconds of each event; correct the events in the capture software, or delete them to use "
        "those that the markers show"
    )


def _kind_and_side(label: str) -> tuple[str, str]:
    """Give kind and side that a label states, such as "Left Foot Strike" or "RHS"; "" if not."""
    found = LABEL.fullmatch("".join(re.findall("[a-z]", label.lower())))
    if found is None:
        return "", ""
    sides = {SIDES[word] for word in (found["before"], found["after"]) if word}
    return (KINDS[found["kind"]], "".join(sides)) if len(sides) < 2 else ("", "")
