"""The live view: the body and its residuals on a screen while the subject walks."""

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from hbm.model import Body
from hbm.spatial import Array
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate

Screen = Literal["window", "browser", "none"]
"""A window of its own, a page for a browser of this machine, or pictures that nobody sees."""
Colour = Literal["good", "look", "stop"]
"""Of the light of a session."""
News = tuple[list[tuple[int, "ShownFrame"]], "Board | None"]
"""New frames with their numbers; the board, None where it is the same."""
FULL_SCALE: Final = (100.0, 100.0, 100.0, 50.0, 50.0, 50.0)
"""Of all bars and curves of residuals, whatever they are [N, N·m]."""
MAX_WAITING: Final = 1000
"""Frames that wait for a slow viewer, 10 s at 100 Hz; then the oldest are left out."""
MAX_STOP_S: Final = 4.0
"""After this, the drawing process and its viewer are killed."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownFrame:
    """What a live view shows of one frame.

    Attributes
    ----------
    time
        [s], on any clock that does not jump; shown is the time since the first frame.
    q
        Coordinates, (46,) [m and rad]; NaN where the body is not known, which hides it.
    markers
        Measured markers in the lab, (M, 3) [m]; NaN where one is not seen.
    residual
        "measured" and, with a calibration, "compensated" -> residual on the pelvis in the reported
        axes (x forward, y right, z up), (6,) [N, N·m].
    ground
        The same -> wrench on the left and the right foot in lab axes about the lab origin, (2, 6)
        [N, N·m].
    platform
        Rotation, (3, 3), and position, (3,) [m], of the platform in the lab, NaN where unknown;
        None where it stands still.
    counts
        Whether the residual counts; it is not shown where it does not.
    """

    time: float
    q: Array
    markers: Array
    residual: Mapping[str, Array]
    ground: Mapping[str, Array]
    platform: tuple[Array, Array] | None = None
    counts: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """What can be read from three metres.

    Attributes
    ----------
    colour, sentence
        The light: good, look or stop; what is wrong and what to do.
    progress
        Fraction of the gait cycles that are done; it may exceed 1.
    done
        The same in words, such as "12 / 25 gait cycles".
    rms
        Variant -> RMS residuals of the last ten gait cycles, (6,) [N, N·m]; empty before.
    senders
        Which stream comes from where.
    """

    colour: Colour
    sentence: str
    progress: float
    done: str
    rms: Mapping[str, Array]
    senders: str = ""


STARTING: Final = Board("look", "Starting", 0.0, "", {})
"""Before the first frame."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveScene:
    """What stays while frames are shown.

    Attributes
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
        pictures can be taken at the view's address.
    contact_threshold_n
        A foot with less vertical force has no arrow [N].
    """

    body: Body
    plates: Sequence[Plate]
    markers: Sequence[str]
    variants: Sequence[str]
    screen: Screen = "window"
    contact_threshold_n: float = Settings().contact_threshold_n


class LiveView:
    """The viewer, live, drawn by a process of its own.

    Nothing ever waits for it: what is shown is copied and sent by a thread about 25 times a second,
    and where the viewer is slower, stopped or gone, frames are left out and counted. The viewer
    listens on this machine alone; its memory is limited, and it then drops its oldest data.

    Parameters
    ----------
    scene
        What stays.

    Attributes
    ----------
    address
        Page to open in a browser, or address of an unseen viewer; None until it is served.
    fault
        Why nothing is shown any more, in one line; None while all is well.
    shown, left_out
        Frames that the viewer has taken, and those that it has not since it was slower than they
        came, or gone; the others wait.
    process_id
        Of the drawing process, whose child is the viewer.

    Notes
    -----
    The drawing is a process, not a thread, because it takes about a quarter of a core in Python,
    for which a thread that computes frames would often wait, 5 ms by default
    (``sys.setswitchinterval``). What `pipeline.viewer.serve.view` says of who can read what is
    shown holds here, too. The memory of a page in a browser is limited by the page itself, to
    about 2 GB.

    Examples
    --------
    >>> view = LiveView(LiveScene(body, [], body.markers, ["measured"]))  # doctest: +SKIP
    >>> view.show(ShownFrame(0.0, q, markers, {"measured": residual},   # doctest: +SKIP
    ...                      {"measured": feet}))
    >>> view.close()                                                    # doctest: +SKIP
    """

    def __init__(self, scene: LiveScene) -> None:
        self.address: str | None = None
        self.fault: str | None = None
        self.left_out = self.shown = 0
        self._lock = threading.Lock()
        self._waiting = deque[tuple[int, ShownFrame]]()
        self._board: Board | None = None
        self._count = 0
        self._over = False
        self._ready, self._closing = threading.Event(), threading.Event()
        self._writing = threading.Lock()
        self._process = _start()
        self.process_id = self._process.pid
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        self._thread = threading.Thread(target=self._run, args=(scene,), daemon=True)
        self._thread.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait until the viewer shows something or has failed; give whether it shows it."""
        return self._ready.wait(timeout_s) and self.fault is None

    @property
    def late_s(self) -> float:
        """By how much what is shown is older than the newest frame [s]."""
        with self._lock:
            return self._waiting[-1][1].time - self._waiting[0][1].time if self._waiting else 0.0

    def show(self, frame: ShownFrame) -> None:
        """Show a frame, whose arrays stay as they are; returns at once."""
        with self._lock:
            self._waiting.append((self._count, frame))
            self._count += 1
            if self._over or len(self._waiting) > MAX_WAITING:
                self._waiting.popleft()
                self.left_out += 1

    def show_board(self, board: Board) -> None:
        """Show the light in place of the last one."""
        with self._lock:
            self._board = board

    def close(self) -> None:
        """End the viewer; takes at most some seconds, whatever state it is in."""
        self._closing.set()
        if self._writing.acquire(timeout=1.0):
            with suppress(OSError):
                self._to.close()  # it ends once its input does
            self._writing.release()
        try:
            failed = self._process.wait(MAX_STOP_S) != 0
        except subprocess.TimeoutExpired:
            failed = True
        if failed:
            if hasattr(os, "killpg"):
                with suppress(ProcessLookupError):
                    os.killpg(self.process_id, signal.SIGKILL)  # the viewer, too
            self._process.kill()
            self._process.wait()
        self._thread.join(MAX_STOP_S)
        self._from.close()

    def _run(self, scene: LiveScene) -> None:
        """Send what is new and wait until it is drawn, again and again."""
        sent = 0
        try:
            self.address = self._ask(scene)
            self._ready.set()
            # with this pause and the time that drawing takes, about 25 pictures a second
            while not self._closing.wait(1 / 30):
                with self._lock:
                    # to pack more would hold up the thread that computes frames
                    sent = min(len(self._waiting), 100)
                    frames = [self._waiting.popleft() for _ in range(sent)]
                    board, self._board = self._board, None
                if sent or board is not None:
                    self._ask((frames, board))
                    self.shown += sent
                    sent = 0
        except (EOFError, pickle.UnpicklingError):
            self._fail("the process that draws the live view has ended")
        except Exception as error:
            self._fail(str(error) or type(error).__name__)
        with self._lock:
            self._over = True
            self.left_out += sent + len(self._waiting)
            self._waiting.clear()
        self._ready.set()

    def _fail(self, fault: str) -> None:
        if not self._closing.is_set():
            self.fault = fault

    def _ask(self, message: LiveScene | News) -> str | None:
        """Send a message and give the answer; an OSError says what failed."""
        with self._writing, suppress(BrokenPipeError):
            pickle.dump(message, self._to)
            self._to.flush()
        answer: Any = pickle.load(self._from)
        if isinstance(answer, OSError):
            raise answer
        address: str | None = answer
        return address


def _start() -> subprocess.Popen[bytes]:
    """Start the drawing process; Ctrl-C in a terminal is not for it, nor for its viewer."""
    here = str(Path(__file__).parents[2])
    path = os.pathsep.join(filter(None, [here, os.environ.get("PYTHONPATH")]))
    quiet = {"PYTHONPATH": path, "RUST_LOG": "off", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "pipeline.viewer.live_drawing"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | quiet,
        process_group=0 if os.name == "posix" else None,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )
