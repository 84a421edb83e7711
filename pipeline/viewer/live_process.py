"""The process that draws a live view: frames come by its standard input, answers go out.

It is sent no more than it has drawn, so that nothing piles up where the viewer is slow or stopped,
and ends with its viewer once the input ends.
"""

import json
import os
import pickle
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from secrets import token_hex
from subprocess import Popen
from typing import IO, TYPE_CHECKING, Any, Final

from pipeline.viewer.live_frames import LiveScene, Screen

if TYPE_CHECKING:
    import rerun as rr

APPLICATION: Final = "hbm_residuals_live"
MEMORY: Final = "1GB"
"""Of the viewer, which then drops its oldest data: about a quarter of an hour at 100 Hz."""
SERVER_MEMORY: Final = "16MB"
"""Of what the viewer's server keeps for others."""
PAGE_BYTES: Final = 64_000_000
"""Of what is kept for pages that open later: about half a minute at 100 Hz, soon caught up with."""
FLUSH_S: Final = 0.25
"""How often the ends of viewer and input are looked for while the viewer takes no data."""
GRACE_S: Final = 1.0
"""After the end of the input, the viewer is killed if it has not ended."""
LOWER_PRIORITY: Final = 5
SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
"""Any of them names a screen on Linux."""
WITHOUT_SCREEN: Final = "show it to a browser (--web), or use --view on a computer with one"

Shown = tuple[str | None, Callable[[], bool]]
"""Where it is shown, and what waits until all that is drawn is taken; false if the viewer ended."""


class _Input:
    """Messages from the standard input; once it ends, the viewer has a second to end."""

    def __init__(self, pipe: IO[bytes]) -> None:
        self._pipe = pipe
        self._messages = SimpleQueue[Any]()
        self.ended = threading.Event()
        self.viewer: Popen[bytes] | None = None
        threading.Thread(target=self._read, daemon=True).start()

    def next(self) -> Any:
        """Give the next message; None once the input has ended."""
        return self._messages.get()

    def _read(self) -> None:
        with suppress(Exception):
            while True:
                self._messages.put(pickle.load(self._pipe))
        self.ended.set()
        self._messages.put(None)
        time.sleep(GRACE_S)
        if self.viewer is not None:
            self.viewer.kill()


def _draw(inbox: _Input, answer: Callable[..., None]) -> None:
    """Draw until the input or the viewer ends.

    Raises
    ------
    OSError
        If the viewer does not start, or ends before the input.
    """
    try:
        import rerun as rr
    except ImportError as error:
        raise OSError(f"the viewer is not installed (rerun-sdk): {error}") from error
    from pipeline.viewer.live_drawing import LiveDrawing

    scene: LiveScene | None = inbox.next()
    if scene is None:
        return
    if scene.screen == "window" and sys.platform == "linux" and not os.environ.keys() & SCREENS:
        raise OSError(f"there is no screen; {WITHOUT_SCREEN}")
    rr.set_strict_mode(True)
    stream = rr.RecordingStream(APPLICATION, recording_id=token_hex(8), send_properties=False)
    shown = _page(stream) if scene.screen == "browser" else _viewer(stream, scene.screen, inbox)
    with shown as (address, taken):
        drawing = LiveDrawing(stream, scene)
        taken()
        answer(address=address)
        while (news := inbox.next()) is not None:
            drawing.show(news)
            if not taken():
                break
            answer()
    if not inbox.ended.is_set():
        raise OSError("the viewer's window was closed")


@contextmanager
def _page(stream: "rr.RecordingStream") -> Iterator[Shown]:
    """Serve what is drawn to browsers."""
    from rerun import binary_stream

    from pipeline.viewer.page import GrowingRecording, page_server
    from pipeline.viewer.serve import viewer_files

    drawn, recording = binary_stream(stream), GrowingRecording(PAGE_BYTES)

    def taken() -> bool:
        recording.append(drawn.read() or b"")
        return True

    with page_server(viewer_files(), recording.pieces) as address:
        yield address, taken


@contextmanager
def _viewer(stream: "rr.RecordingStream", screen: Screen, inbox: _Input) -> Iterator[Shown]:
    """Run a viewer, in a window or unseen, and send it what is drawn."""
    from pipeline.viewer.serve import data_address, free_ports, running_viewer

    (port,) = free_ports(1)
    limits = ["--memory-limit", MEMORY, "--server-memory-limit", SERVER_MEMORY]
    arguments = ["--port", str(port), *limits, "--hide-welcome-screen"]
    unseen = ["--headless", "--window-size", "1920x1080"] if screen == "none" else []
    with running_viewer([*unseen, *arguments], (port,), without_screen=WITHOUT_SCREEN) as process:
        inbox.viewer = process
        stream.connect_grpc(data_address(port))

        def taken() -> bool:
            _wait_until_sent(stream, process, inbox)
            return process.poll() is None

        yield data_address(port) if screen == "none" else None, taken


def _wait_until_sent(stream: "rr.RecordingStream", process: Popen[bytes], inbox: _Input) -> None:
    """Wait until the viewer has taken all, or has ended, or the input has."""
    while process.poll() is None and not inbox.ended.is_set():
        try:
            stream.flush(timeout_sec=FLUSH_S)
        except RuntimeError as error:
            if "timed out" not in str(error):
                time.sleep(FLUSH_S)
        else:
            return


def main() -> None:
    """Draw what comes, and say in one line why it ends before the input does."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if hasattr(os, "nice"):
        os.nice(LOWER_PRIORITY)

    def answer(**told: str | None) -> None:
        answers.write(json.dumps(told) + "\n")
        answers.flush()

    with suppress(BrokenPipeError):
        try:
            _draw(_Input(sys.stdin.buffer), answer)
        except Exception as error:
            answer(fault=" ".join(str(error).split()) or type(error).__name__)
    os._exit(0)  # a stopped viewer would be waited for


if __name__ == "__main__":
    main()
