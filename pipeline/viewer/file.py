"""Rerun recordings: filled column by column, then written whole or not at all."""

import hashlib
import os
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from hbm.spatial import Array, Mask
from pipeline.io.write import whole_file

_NOT_IN_FONT: Final = re.compile(
    "[^\n -~\u00a0-\u0148\u014a-\u017f"  # Latin
    "\u0391-\u03a1\u03a3-\u03c9\u0410-\u044f"  # Greek, Cyrillic
    "–—‘’“”„•…‰′″←↑→↓−≈≠≤≥√]"
)
Timelines = Mapping[str, np.ndarray]
"""Timeline -> its value in each row: seconds if the name is "time", else whole numbers."""
Clock = Callable[[Array], Timelines]
"""Gives the timelines of any instants [s]."""


class Folder:
    """A folder of a recording, in which one of several trials is drawn."""

    def __init__(self, stream: rr.RecordingStream, name: str) -> None:
        self._stream, self._name = stream, name

    def log(self, entity: str, shape: Any, *, static: bool) -> None:
        """Log a shape."""
        self._stream.log(f"{self._name}/{entity}", shape, static=static)

    def send_columns(self, entity: str, indexes: Any, columns: Any, *, strict: bool) -> None:
        """Send rows of shapes."""
        self._stream.send_columns(f"{self._name}/{entity}", indexes, columns, strict=strict)


Stream = rr.RecordingStream | Folder
"""What a trial is drawn to."""


@contextmanager
def recording_file(
    path: Path, application: str, title: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Open a recording; the file appears when it is complete.

    It is filled in memory and written here: where a disk is full, Rerun's own file sink prints to
    the terminal, raises nothing, and waits forever when it is flushed. Recordings of one
    ``application`` have one layout in the viewer. The identifier, which usage statistics of other
    viewers may see hashed, is a pseudonym of title and place.
    """
    rr.set_strict_mode(True)
    pseudonym = hashlib.sha256(os.fsencode(f"{title} {path.resolve()}")).hexdigest()[:16]
    stream = rr.RecordingStream(application, recording_id=pseudonym, send_properties=False)
    memory = stream.memory_recording()
    try:
        stream.send_blueprint(blueprint, make_active=True, make_default=True)
        stream.send_recording_name(printable(title))
        yield stream
        content = memory.drain_as_bytes()
    finally:
        stream.disconnect()
    with whole_file(path) as temporary:
        try:
            temporary.write_bytes(content)
        except OSError as error:
            error.filename = str(path)
            raise


def send(
    stream: Stream,
    entity: str,
    timelines: Timelines,
    archetype: Any,
    present: Mask,
    **fields: np.ndarray,
) -> None:
    """Send an archetype's fields, (T, K, ...), for all rows; of those present, (T, K)."""
    chunk = 6000  # rows at once, about a minute: the viewer loads chunks of this size fastest
    for start in range(0, len(present), chunk):
        rows = slice(start, start + chunk)
        chosen = {name: value[rows][present[rows]] for name, value in fields.items()}
        stream.send_columns(
            entity,
            [
                rr.TimeColumn(name, **{"duration" if name == "time" else "sequence": value[rows]})
                for name, value in timelines.items()
            ],
            archetype.columns(**chosen).partition(present[rows].sum(axis=1)),
            strict=True,
        )


def rgba(*colours: str) -> np.ndarray:
    """Give hexadecimal colours, "#rrggbb" or "#rrggbbaa", as bytes, (K, 4)."""
    channels = [list(bytes.fromhex(f"{colour[1:]}ff"[:8])) for colour in colours]
    return np.array(channels, np.uint8).reshape(-1, 4)


def printable(text: str) -> str:
    """Give a text with "?" for letters that the viewer's font lacks, on which it would fail."""
    return _NOT_IN_FONT.sub("?", unicodedata.normalize("NFC", text))
