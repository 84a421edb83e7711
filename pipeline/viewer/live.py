"""The live view: the body and its residuals on a screen while the subject walks."""

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

from hbm.model import Body
from hbm.spatial import Array
from pipeline.config.schema import Settings
from pipeline.trial.result import PlateSurface
from pipeline.viewer.live_frames import FrameRows, LiveNews, LiveScene, Screen, ShownFrame

PROGRAM: Final = "pipeline.viewer.live_process"
PERIOD_S: Final = 1 / 30
"""Pause between what is sent: with the time that drawing takes, about 25 pictures a second."""
MAX_WAITING: Final = 1000
"""Frames that wait for a slow viewer, 10 s at 100 Hz; then the oldest are left out."""
MAX_WAITING_CYCLES: Final = 10
CYCLE_SHAPE: Final = (101, 6)
MAX_WRITE_S: Final = 1.0
ENDED: Final = json.dumps({"fault": "the process that draws the live view has ended"})
MAX_STOP_S: Final = 4.0
"""After this, the drawing process and its viewer are killed."""


class LiveView:
    """The viewer, live, drawn by a process of its own.

    Nothing ever waits for it: what is shown is copied and sent by a thread about 25 times a second,
    and where the viewer is slower, stopped or gone, frames are left out and counted. The viewer
    listens on this machine alone; its memory is limited, and it then drops its oldest data.

    Parameters
    ----------
    body
        The subject.
    plates
        Where the plates are with the platform in neutral.
    markers
        Names of the markers, in the order of `ShownFrame.markers`.
    variants
        "measured" and, with a calibration, "compensated".
    screen
        "window"; "browser", which serves a page to this machine; or "none": it is drawn unseen, and
        pictures can be taken at its `address`.
    contact_threshold_n
        A foot with less vertical force has no arrow [N].

    Notes
    -----
    The drawing is a process, not a thread, because it takes about a quarter of a core in Python,
    for which a thread that computes frames would often wait, 5 ms by default
    (``sys.setswitchinterval``). What `pipeline.viewer.serve.view` says of who can read what is
    shown holds here, too. The memory of a page in a browser is limited by the page itself, to
    about 2 GB.

    Examples
    --------
    >>> view = LiveView(body, [], body.markers, ["measured"])           # doctest: +SKIP
    >>> view.show(ShownFrame(0.0, q, markers, {"measured": residual},   # doctest: +SKIP
    ...                      {"measured": feet}))
    >>> view.close()                                                    # doctest: +SKIP
    """

    def __init__(
        self,
        body: Body,
        plates: Sequence[PlateSurface],
        markers: Sequence[str],
        variants: Sequence[str],
        *,
        screen: Screen = "window",
        contact_threshold_n: float = Settings().contact_threshold_n,
    ) -> None:
        scene = LiveScene(
            body, tuple(plates), tuple(markers), tuple(variants), contact_threshold_n, screen
        )
        self._rows = FrameRows(len(scene.markers), scene.variants)
        self._lock = threading.Lock()
        self._waiting = deque[bytes]()
        self._cycles = deque[tuple[str, Mapping[str, Array]]](maxlen=MAX_WAITING_CYCLES)
        self._status: str | None = None
        self._count = self._left_out = self._shown = 0
        self._address: str | None = None
        self._fault: str | None = None
        self._over = False
        self._ready, self._closing = threading.Event(), threading.Event()
        self._writing = threading.Lock()
        self._process = _start()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        self._thread = threading.Thread(target=self._run, args=(scene,), daemon=True)
        self._thread.start()

    @property
    def address(self) -> str | None:
        """Page to open in a browser, or address of an unseen viewer; None until it is served."""
        return self._address

    @property
    def fault(self) -> str | None:
        """Why nothing is shown any more, in one line; None while all is well."""
        return self._fault

    @property
    def left_out(self) -> int:
        """Frames left out because the viewer was slower than they came, or gone."""
        return self._left_out

    @property
    def shown(self) -> int:
        """Frames that the viewer has taken; the others wait or are left out."""
        return self._shown

    @property
    def process_id(self) -> int:
        """Of the drawing process, whose child is the viewer."""
        return self._process.pid

    def wait(self, timeout_s: float) -> bool:
        """Wait until the viewer shows something or has failed; give whether it shows it."""
        return self._ready.wait(timeout_s) and self._fault is None

    def show(self, frame: ShownFrame) -> None:
        """Show a frame; returns at once, and the frame's arrays may change afterwards.

        Raises
        ------
        ValueError
            If an array has another shape than the view was made for, or another type than double.
        KeyError
            If a variant is missing.
        """
        row = self._rows.pack(self._count, frame)
        self._count += 1
        with self._lock:
            self._waiting.append(row)
            if self._over or len(self._waiting) > MAX_WAITING:
                self._waiting.popleft()
                self._left_out += 1

    def show_cycle(self, side: str, residual: Mapping[str, Array]) -> None:
        """Show a gait cycle; the last ten of a side stay, of the right one if there are any.

        Parameters
        ----------
        side
            "left" or "right".
        residual
            Variant -> residuals in the reported axes over 0 to 100 %, (101, 6) [N, N·m]; NaN where
            frames do not count.

        Raises
        ------
        ValueError
            If an array has another shape.
        KeyError
            If a variant is missing.
        """
        copied = {variant: np.array(residual[variant]) for variant in self._rows.variants}
        for variant, values in copied.items():
            if values.shape != CYCLE_SHAPE:
                raise ValueError(
                    f"{variant}: a gait cycle must have shape {CYCLE_SHAPE}, got {values.shape}"
                )
        with self._lock:
            self._cycles.append((side, copied))

    def show_status(self, text: str) -> None:
        """Show a text, Markdown, in place of the last one."""
        with self._lock:
            self._status = text

    def close(self) -> None:
        """End the viewer; takes at most some seconds, whatever state it is in."""
        self._closing.set()
        if self._writing.acquire(timeout=MAX_WRITE_S):
            with suppress(OSError):
                self._to.close()  # it ends once its input does
            self._writing.release()
        try:
            failed = self._process.wait(MAX_STOP_S) != 0
        except subprocess.TimeoutExpired:
            failed = True
        if failed:
            _kill(self._process)
        self._thread.join(MAX_STOP_S)
        self._from.close()

    def _run(self, scene: LiveScene) -> None:
        """Send what is new and wait until it is drawn, again and again."""
        sent = 0
        try:
            self._address = self._ask(scene).get("address")
            self._ready.set()
            while not self._closing.wait(PERIOD_S):
                news = self._news()
                if news is not None:
                    sent = len(news.rows) // self._rows.size
                    self._ask(news)
                    self._shown += sent
                    sent = 0
        except Exception as error:
            if not self._closing.is_set():
                self._fault = str(error) or type(error).__name__
        with self._lock:
            self._over = True
            self._left_out += sent + len(self._waiting)
            self._waiting.clear()
        self._ready.set()

    def _news(self) -> LiveNews | None:
        with self._lock:
            rows, cycles, status = list(self._waiting), list(self._cycles), self._status
            self._waiting.clear()
            self._cycles.clear()
            self._status = None
        if not rows and not cycles and status is None:
            return None
        return LiveNews(b"".join(rows), cycles, status)

    def _ask(self, message: LiveScene | LiveNews) -> dict[str, str | None]:
        """Send a message and give the answer.

        Raises
        ------
        OSError
            If the drawing process has ended, or says what failed.
        """
        with self._writing, suppress(BrokenPipeError):
            pickle.dump(message, self._to)
            self._to.flush()
        answer: dict[str, str | None] = json.loads(self._from.readline() or ENDED)
        if fault := answer.get("fault"):
            raise OSError(fault)
        return answer


def _start() -> subprocess.Popen[bytes]:
    """Start the drawing process; Ctrl-C in a terminal is not for it, nor for its viewer."""
    here = str(Path(__file__).parents[2])
    path = os.pathsep.join(filter(None, [here, os.environ.get("PYTHONPATH")]))
    own = {"PYTHONPATH": path, "RUST_LOG": "off", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-P", "-m", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | own,
        process_group=0 if os.name == "posix" else None,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill the drawing process and its viewer."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()
