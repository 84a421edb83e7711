"""The process that draws a live view: frames come by its standard input, answers go out.

It is sent no more than it has drawn, so that nothing piles up where the viewer is slow or stopped,
and ends with its viewer once the input ends.
"""

import os
import pickle
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from secrets import token_hex
from subprocess import Popen
from typing import IO, Any, Final

import numpy as np
import rerun as rr

from compensation.platform import PlatformPose
from hbm.markers import Markers
from pipeline.trial.residuals import reported
from pipeline.viewer.board import log_board
from pipeline.viewer.layout import live_layout, log_legend
from pipeline.viewer.live import STARTING, Board, LiveScene, News, Screen, ShownFrame
from pipeline.viewer.plots import draw_residual_curves, send_residual_curves
from pipeline.viewer.scene import draw_scene, send_scene
from pipeline.viewer.serve import (
    GrowingRecording,
    data_address,
    free_port,
    light_contents,
    page_server,
    running_viewer,
    viewer_files,
)

WITHOUT_SCREEN: Final = "show it to a browser (--web), or use --view on a computer with one"

Shown = tuple[str | None, Callable[[], bool]]
"""Where it is shown, and what waits until all that is drawn is taken; false if the viewer ended."""


class LiveDrawing:
    """What a live view shows, sent to a recording."""

    def __init__(self, stream: rr.RecordingStream, scene: LiveScene) -> None:
        self._stream, self._scene = stream, scene
        self.board, self._drawn = STARTING, b""
        self._start_s: float | None = None
        self._newest_s, self._number = -np.inf, -1
        centers = np.array([plate.center for plate in scene.plates]).reshape(-1, 3)
        ground = centers.mean(axis=0) if len(centers) else np.zeros(3)
        self._surface_m = float(ground[2])
        # head and plates are in the picture
        target = ground + np.array([0.0, 0.0, 0.8])
        layout = live_layout(target, light=scene.screen != "browser")
        stream.send_blueprint(layout, make_active=True, make_default=True)
        stream.send_recording_name("live")
        draw_scene(stream, scene.body, scene.markers, scene.plates, scene.variants)
        draw_residual_curves(stream, scene.variants)
        log_legend(stream)

    def show(self, news: News) -> None:
        """Send frames whose time increases, and the board."""
        numbered, board = news
        later = []
        for number, frame in numbered:
            if frame.time > self._newest_s:
                self._newest_s = frame.time
                later.append((number, frame))
        if later:
            self._send_frames(later)
        self.board = board or self.board
        if self._scene.screen == "browser":
            return  # its page asks for the board
        if board is not None and (content := pickle.dumps(board)) != self._drawn:
            self._drawn = content  # drawing takes some 50 ms
            log_board(self._stream, board)

    def _send_frames(self, numbered: Sequence[tuple[int, ShownFrame]]) -> None:
        """Send frames at the time since the first one."""
        scene, frames = self._scene, [frame for _, frame in numbered]
        if self._start_s is None:
            self._start_s = frames[0].time
        time = np.array([frame.time for frame in frames]) - self._start_s
        absent = np.full(6, np.nan)
        residual = {
            name: np.array([f.residual[name] if f.counts else absent for f in frames])
            for name in scene.variants
        }
        numbers = np.array([number for number, _ in numbered])
        before = np.append(self._number, numbers[:-1])
        self._number = int(numbers[-1])
        gaps = np.flatnonzero(numbers > before + 1)  # where frames were left out
        curves = {name: np.insert(value, gaps, np.nan, axis=0) for name, value in residual.items()}
        broken = {"time": np.insert(time, gaps, time[gaps] - 1e-6)}
        send_residual_curves(self._stream, broken, curves)
        # the scene has fewer frames than the curves, the newest among them: 50 Hz look smooth
        step = int(np.ceil(len(time) / (1 + np.ptp(time) * 50.0)))
        frames, time = frames[::-step][::-1], time[::-step][::-1]
        poses = [frame.platform for frame in frames if frame.platform is not None]
        platform = None
        if poses:
            rotation, position = map(np.array, zip(*poses, strict=True))
            unknown = np.isnan(rotation).any(axis=(1, 2)) | np.isnan(position).any(axis=1)
            rotation[unknown], position[unknown] = np.nan, np.nan
            platform = PlatformPose(rotation, position)
        send_scene(
            self._stream,
            {"time": time},
            scene.body,
            np.array([frame.q for frame in frames]),
            Markers(time, tuple(scene.markers), np.array([frame.markers for frame in frames])),
            platform,
            {name: np.array([f.ground[name] for f in frames]) for name in scene.variants},
            {name: reported(value[::-step][::-1]) for name, value in residual.items()},
            surface_m=self._surface_m,
            threshold_n=scene.contact_threshold_n,
        )


class _Input:
    """Messages from the standard input; once it ends, the viewer has a second to end."""

    def __init__(self, pipe: IO[bytes]) -> None:
        self._pipe = pipe
        self.messages = SimpleQueue[Any]()
        self.ended = threading.Event()
        self.viewer: Popen[bytes] | None = None
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with suppress(Exception):
            while True:
                self.messages.put(pickle.load(self._pipe))
        self.ended.set()
        self.messages.put(None)
        time.sleep(1.0)  # for the viewer to end
        if self.viewer is not None:
            self.viewer.kill()


def _draw(inbox: _Input, answer: Callable[[str | OSError | None], None]) -> None:
    """Draw until the input ends; an OSError says that the viewer does not start, or ends before."""
    scene: LiveScene | None = inbox.messages.get()
    if scene is None:
        return
    screens = {"DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"}  # any of them names one on Linux
    if scene.screen == "window" and sys.platform == "linux" and not os.environ.keys() & screens:
        raise OSError(f"there is no screen; {WITHOUT_SCREEN}")
    rr.set_strict_mode(True)
    application = "hbm_residuals_live"
    stream = rr.RecordingStream(application, recording_id=token_hex(8), send_properties=False)
    drawing = LiveDrawing(stream, scene)
    shown = _viewer(stream, scene.screen, inbox)
    if scene.screen == "browser":
        shown = _page(stream, lambda: drawing.board)
    with shown as (address, taken):
        taken()
        answer(address)
        while (news := inbox.messages.get()) is not None:
            drawing.show(news)
            if not taken():
                break
            answer(None)
    if not inbox.ended.is_set():
        raise OSError("the viewer's window was closed")


@contextmanager
def _page(stream: rr.RecordingStream, board: Callable[[], Board]) -> Iterator[Shown]:
    """Serve what is drawn to browsers, beside the light, which is never as late as the viewer."""
    # for pages that open later about half a minute at 100 Hz is kept, soon caught up with
    drawn, recording = rr.binary_stream(stream), GrowingRecording(64_000_000)

    def taken() -> bool:
        recording.append(drawn.read() or b"")
        return True

    with page_server(viewer_files(), recording.pieces, others=light_contents(board)) as address:
        yield address, taken


@contextmanager
def _viewer(stream: rr.RecordingStream, screen: Screen, inbox: _Input) -> Iterator[Shown]:
    """Run a viewer, in a window or unseen, and send it what is drawn."""
    # the viewer keeps about a quarter of an hour at 100 Hz, its server little for others
    port = free_port()
    limits = ["--memory-limit", "1GB", "--server-memory-limit", "16MB"]
    unseen = ["--headless", "--window-size", "1920x1080"] if screen == "none" else []
    arguments = [*unseen, "--port", str(port), *limits, "--hide-welcome-screen"]
    with running_viewer(arguments, port, without_screen=WITHOUT_SCREEN) as process:
        inbox.viewer = process
        stream.connect_grpc(data_address(port))

        def taken() -> bool:
            """Wait until the viewer has taken all, or has ended, or the input has."""
            pause_s = 0.25  # after which both ends are looked for while the viewer takes no data
            while process.poll() is None and not inbox.ended.is_set():
                try:
                    stream.flush(timeout_sec=pause_s)
                    break
                except RuntimeError as error:
                    if "timed out" not in str(error):
                        time.sleep(pause_s)
            return process.poll() is None

        yield data_address(port) if screen == "none" else None, taken


def main() -> None:
    """Draw what comes, and say in one line why it ends before the input does."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if hasattr(os, "nice"):
        os.nice(5)

    def answer(content: str | OSError | None) -> None:
        pickle.dump(content, answers)
        answers.flush()

    with suppress(BrokenPipeError):
        try:
            _draw(_Input(sys.stdin.buffer), answer)
        except Exception as error:
            answer(OSError(" ".join(str(error).split()) or type(error).__name__))
    os._exit(0)  # a stopped viewer would be waited for


if __name__ == "__main__":
    main()
