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
from collections.abc import Callable
from contextlib import suppress
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
SERVER_MEMORY: Final = {"window": "16MB", "browser": "256MB", "none": "16MB"}
"""Of what the server keeps for pages that open later."""
FLUSH_S: Final = 0.25
"""How often the ends of viewer and input are looked for while the viewer takes no data."""
GRACE_S: Final = 1.0
"""After the end of the input, the viewer is killed if it has not ended."""
LOWER_PRIORITY: Final = 5
SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
"""Any of them names a screen on Linux."""
WITHOUT_SCREEN: Final = "show it to a browser (--web), or use --view on a computer with one"


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
    from pipeline.viewer.serve import data_address, free_ports, page_address, running_viewer

    scene: LiveScene | None = inbox.next()
    if scene is None:
        return
    if scene.screen == "window" and sys.platform == "linux" and not os.environ.keys() & SCREENS:
        raise OSError(f"there is no screen; {WITHOUT_SCREEN}")
    data, page = free_ports(2)
    arguments, ports = _arguments(scene.screen, data, page)
    with running_viewer(arguments, ports, without_screen=WITHOUT_SCREEN) as process:
        inbox.viewer = process
        rr.set_strict_mode(True)
        stream = rr.RecordingStream(APPLICATION, recording_id=token_hex(8), send_properties=False)
        stream.connect_grpc(data_address(data))
        drawing = LiveDrawing(stream, scene)
        address = {"browser": page_address(data, page), "none": data_address(data)}
        _wait_until_sent(stream, process, inbox)
        answer(address=address.get(scene.screen))
        while (news := inbox.next()) is not None:
            drawing.show(news)
            _wait_until_sent(stream, process, inbox)
            if process.poll() is not None:
                break
            answer()
    if not inbox.ended.is_set():
        raise OSError("the viewer's window was closed")


def _arguments(screen: Screen, data: int, page: int) -> tuple[list[str], tuple[int, ...]]:
    """Give the viewer's arguments, and the ports that answer once it runs."""
    limits = ["--memory-limit", MEMORY, "--server-memory-limit", SERVER_MEMORY[screen]]
    arguments = ["--port", str(data), *limits, "--hide-welcome-screen"]
    if screen == "browser":
        web = ["--serve-web", "--web-viewer-port", str(page), "--newest-first"]
        return [*web, *arguments], (data, page)
    unseen = ["--headless", "--window-size", "1920x1080"] if screen == "none" else []
    return [*unseen, *arguments], (data,)


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
