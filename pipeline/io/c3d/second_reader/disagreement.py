"""Where two readings of C3D data differ: marker or channel, frame, both values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.second_reader.reading import Parameter

FRAMES_PER_SLICE: Final = 4096
"""Some megabytes at a time: large enough for NumPy, small beside the readings."""
SMALLEST: Final = 4 * float(np.finfo(np.float32).tiny)
"""Numbers below are zero, or occur only in DEC files, where ezc3d 1.7.2 reads four times as
much."""
MAX_SHOWN: Final = 40
"""Characters of a text that are shown."""
Kind = Literal["header", "number", "parameter", "marker", "channel", "rotation", "bytes"]


@dataclass(frozen=True, slots=True)
class Disagreement:
    """One thing in which two readings differ.

    Attributes
    ----------
    kind, name
        What it is, such as channel "Force.Fz1".
    frame, sample
        First frame in which it differs, as the file counts frames; first sample in that frame,
        from 1; None where it has none.
    first, second
        What either reading holds there.
    further
        How many samples more of it differ.
    """

    kind: Kind
    name: str
    first: str
    second: str
    frame: int | None = None
    sample: int | None = None
    further: int = 0

    def line(self, first: str, second: str) -> str:
        """Say it in one line, given what to call either reading."""
        frame = f", frame {self.frame}" if self.frame is not None else ""
        sample = f", sample {self.sample}" if self.sample is not None else ""
        verb = "differs" if self.further == 1 else "differ"
        further = f", and {self.further} further {verb}" if self.further else ""
        return (
            f"{self.kind} {self.name}{frame}{sample}: {self.first} {first}, "
            f"{self.second} {second}{further}"
        )


def samples_that_differ(
    kind: Kind,
    names: Sequence[str],
    first: NDArray[Any],
    second: NDArray[Any],
    differ: Callable[[NDArray[Any], NDArray[Any]], NDArray[np.bool_]],
    *,
    first_frame: int,
    per_frame: int = 1,
    show: Callable[[Any], str] | None = None,
) -> list[Disagreement]:
    """Compare samples of markers or channels.

    Parameters
    ----------
    kind, names
        What the second axis holds.
    first, second
        Samples of equal shape, (N, names) or (N, names, 3).
    differ
        Whether two slices of them differ, (n, names).
    first_frame
        Number of the first frame.
    per_frame
        Samples per frame.
    show
        How to show a value; default: `shown`.

    Returns
    -------
    list[Disagreement]
        One per marker or channel that differs somewhere.
    """
    if not names:
        return []
    show = show or shown
    count, where = np.zeros(len(names), int), np.full(len(names), -1)
    for start in range(0, len(first), FRAMES_PER_SLICE):
        part = slice(start, start + FRAMES_PER_SLICE)
        different = differ(first[part], second[part])
        found = different.any(axis=0)
        where = np.where(found & (where < 0), start + different.argmax(axis=0), where)
        count += different.sum(axis=0)
    return [
        Disagreement(
            kind,
            names[k],
            show(first[where[k], k]),
            show(second[where[k], k]),
            first_frame + int(where[k]) // per_frame,
            int(where[k]) % per_frame + 1 if per_frame > 1 else None,
            int(count[k]) - 1,
        )
        for k in np.flatnonzero(count).tolist()
    ]


def parameters_that_differ(
    first: Mapping[str, Parameter], second: Mapping[str, Parameter]
) -> list[Disagreement]:
    """Compare parameters, ``GROUP:NAME`` -> values; absent ones are empty.

    Parameters
    ----------
    first, second
        The parameters of both readings.

    Returns
    -------
    list[Disagreement]
        One per parameter that differs, with its first value that does.

    Notes
    -----
    Spaces after texts, empty texts at the end and the sign of 16-bit numbers are not compared:
    the format does not define them.
    """
    found = []
    for key in sorted({*first, *second}):
        ours, theirs = (_without_empty_end(side.get(key, ())) for side in (first, second))
        pairs = list(zip(ours, theirs, strict=False))
        unequal = [k for k, pair in enumerate(pairs) if not _alike(*pair)]
        if unequal:
            at = unequal[0]
            name = f"{key}({at + 1})" if len(pairs) > 1 else key
            one, other = (shown(side[at]) for side in (ours, theirs))
            found.append(Disagreement("parameter", name, one, other, further=len(unequal) - 1))
        elif len(ours) != len(theirs):
            one, other = (f"{len(side)} values" for side in (ours, theirs))
            found.append(Disagreement("parameter", key, one, other))
    return found


def shown(value: object) -> str:
    """Show a value in a few characters: a position with NaN is missing."""
    if isinstance(value, np.ndarray) and value.ndim:
        if np.isnan(value.astype(float)).any():
            return "missing"
        return f"({', '.join(shown(number) for number in value)})"
    if isinstance(value, str):
        text = value if len(value) <= MAX_SHOWN else f"{value[:MAX_SHOWN]}…"
        return f"'{text}'"
    return f"{float(value):.9g}" if isinstance(value, (int, float, np.number)) else str(value)


def _without_empty_end(values: Parameter) -> Parameter:
    end = len(values)
    while end and values[end - 1] == "":
        end -= 1
    return values[:end]


def _alike(first: str | float, second: str | float) -> bool:
    if isinstance(first, str) or isinstance(second, str):
        return first == second
    if np.isnan(first) and np.isnan(second):
        return True
    return (
        abs(first - second) <= SMALLEST
        or first == second
        or (abs(first - second) == 65536 and -32768 <= min(first, second) < 0 <= max(first, second))
    )
