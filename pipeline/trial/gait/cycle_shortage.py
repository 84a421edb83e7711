"""Why a trial has no gait cycle that can be used, in one line."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, Mask
from pipeline.io.recording import Event

REASONS: Final = {
    "cycle_unsolved": "frames without a solution or without forces",
    "cycle_not_carried": "plates that do not carry the subject",
    "cycle_unsettled": "an end or a gap too near for the filters to settle",
    "cycle_outside": "an end beyond the recorded markers",
    "cycle_duration": "a duration far from the median",
    "cycle_events": "events that do not alternate",
}
"""Code of the note on a cycle that was left out -> what is wrong with it."""


def cycle_shortage(
    events: Sequence[Event],
    notes: Iterable[Note],
    time: Array,
    solved: Mask,
) -> str:
    """Say why there is no gait cycle.

    Parameters
    ----------
    events
        The trial's gait events.
    notes
        Notes of the trial; those on events and on cycles that were left out count.
    time
        Of the markers, (T,) [s].
    solved
        Whether pose and forces are known, (T,).

    Returns
    -------
    str
        The reason, without a full stop.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(300) / 100
    >>> strikes = [Event(4.1, "foot_strike", "left"), Event(5.2, "foot_strike", "left")]
    >>> cycle_shortage(strikes, (), time, time >= 0)
    'all foot strikes are beyond the markers, which end at 2.99 s: 4.10 to 5.20 s'
    """
    notes = tuple(notes)
    strikes = [event for event in events if event.label == "foot_strike"]
    inside = [event for event in strikes if time[0] <= event.time <= time[-1]]
    counts = [f"{[e.side for e in inside].count(side)} {side}" for side in ("left", "right")]
    left_out = {
        (str(note.values["side"]), note.values["start_s"]): REASONS[note.code]
        for note in notes
        if note.code in REASONS
    }
    unsolved = np.count_nonzero(~solved)
    if unsolved == len(time):
        return "no frame could be solved; check the markers' labels and the calibration pose"
    if not strikes:
        reasons = [f": {note.values['reason']}" for note in notes if note.code == "events_unknown"]
        return f"there are no foot strikes{''.join(reasons)}"
    if not inside:
        return f"all foot strikes are {_beyond(strikes, time)}"
    if left_out:
        reasons = [f"{n} for {reason}" for reason, n in Counter(left_out.values()).most_common()]
        frames = f"; {unsolved} of {len(time)} frames could not be solved" if unsolved else ""
        return f"all gait cycles were left out, {', '.join(reasons)}{frames}"
    if max(Counter(event.side for event in inside).values()) < 2:
        others = [event for event in strikes if event not in inside]
        more = f"; {len(others)} more are {_beyond(others, time)}" if others else ""
        return (
            f"a gait cycle needs two foot strikes of one side, there are {' and '.join(counts)} in "
            f"{time[-1] - time[0]:.2f} s{more}"
        )
    return "none of the gait cycles is one that the condition asks for"


def _beyond(strikes: Sequence[Event], time: Array) -> str:
    times = [event.time for event in strikes]
    return (
        f"beyond the markers, which end at {time[-1]:.2f} s: {min(times):.2f} to {max(times):.2f} s"
    )
