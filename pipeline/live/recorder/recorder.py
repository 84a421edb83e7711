"""Everything that is received and computed, written by a thread of its own."""

import threading
from collections.abc import Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final
from xml.etree.ElementTree import Element

from hbm.spatial import Array
from pipeline.live.recorder.result_parts import ResultParts
from pipeline.live.recorder.xdf_writer import XdfWriter
from pipeline.live.stream import Samples

STREAMS: Final = "streams.xdf"
RESULTS: Final = "results"
EVERY_S: Final = 0.5
"""Between writings: what is missing if the process is killed."""
MAX_WAITING: Final = 60_000
"""Entries that wait for a disk that stalls, about a minute of them; memory stays bounded."""


def require_new(folder: Path) -> None:
    """Refuse a folder that holds a recording."""
    if (folder / STREAMS).exists() or (folder / RESULTS).exists():
        raise ValueError(f"{folder} holds a recording already; choose another folder")


class Recorder:
    """Records streams and results without ever making their sender wait.

    Parameters
    ----------
    folder
        A new or empty folder: ``streams.xdf`` takes the streams, which every command reads like any
        other recording, and ``results`` small Parquet files.
    descriptions
        Of the streams, as for `XdfWriter`.
    columns
        Names of the numbers of a frame's results.

    Raises
    ------
    ValueError
        If the folder holds a recording already.
    OSError
        If the folder cannot be written to.

    Attributes
    ----------
    fault
        Why nothing is recorded any more, in words; None as long as all is well.
    lost
        Entries that could not be written.
    """

    def __init__(
        self, folder: Path, descriptions: Sequence[Element], columns: Sequence[str]
    ) -> None:
        require_new(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self._streams = XdfWriter(folder / STREAMS, descriptions)
        self._results = ResultParts(folder / RESULTS, columns)
        self._waiting: SimpleQueue[Samples | Array] = SimpleQueue()
        self._stop = threading.Event()
        self.fault: str | None = None
        self.lost = 0
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def samples(self, received: Samples) -> None:
        """Take samples as they were received."""
        self._take(received)

    def frame(self, row: Array) -> None:
        """Take a frame's results, (K,)."""
        self._take(row)

    def close(self) -> None:
        """Write all that was taken, and end the files."""
        self._stop.set()
        self._thread.join()

    def _take(self, entry: Samples | Array) -> None:
        if self.fault is not None or self._waiting.qsize() >= MAX_WAITING:
            self.lost += 1
        else:
            self._waiting.put(entry)

    def _run(self) -> None:
        ending = False
        while not ending:
            ending = self._stop.wait(EVERY_S)
            try:
                self._write_waiting()
            except OSError as error:
                self.fault = f"recording stopped: {error.strerror or error}"
                self.lost += self._waiting.qsize()
                return
        try:
            self._streams.close()
        except OSError as error:
            self.fault = f"recording not ended: {error.strerror or error}"

    def _write_waiting(self) -> None:
        while True:
            try:
                entry = self._waiting.get_nowait()
            except Empty:
                break
            if isinstance(entry, Samples):
                self._streams.write(entry)
            else:
                self._results.add(entry)
        self._results.write()
