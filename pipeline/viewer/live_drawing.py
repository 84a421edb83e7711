"""The process that draws a live view: frames come by its standard input, answers go out.

It asks for no more than it has drawn, so that nothing piles up where the viewer is slow or stopped,
and ends with its viewer once the input ends.
"""

import json
import os
import pickle
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from queue import SimpleQueue
from secrets import token_hex
from subprocess import Popen
from typing import IO, Any, Final

import numpy as np
import rerun as rr

from hbm.coordinates import MOVING
from hbm.markers import Markers
from hbm.poses import segment_frames
from hbm.spatial import Array
from pipeline.trial.residuals import AXES, reported
from pipeline.viewer.blueprint import live_layout
from pipeline.viewer.body import draw_body, send_body
from pipeline.viewer.cycles import SHOWN_CYCLES, draw_cycle_axes, send_cycles
from pipeline.viewer.file import printable, send
from pipeline.viewer.legend import LEGEND
from pipeline.viewer.live_frames import FrameBlock, FrameRows, LiveNews, LiveScene, Screen
from pipeline.viewer.plots import draw_residual_curves, send_residual_curves
from pipeline.viewer.scene import (
    draw_arrows,
    draw_markers,
    draw_plates,
    send_ground,
    send_markers,
    send_platform,
    send_residual,
)
from pipeline.viewer.serve import data_address, free_ports, page_address, running_viewer

APPLICATION: Final = "hbm_residuals_live"
SCENE_RATE_HZ: Final = 50.0
"""Smooth to the eye; residual curves have every frame."""
PELVIS: Final = MOVING.index("pelvis")
PELVIS_HEIGHT_M: Final = 0.95
"""Above the plates, roughly; where the camera looks."""
MEMORY: Final = "1GB"
"""Of the viewer, which then drops its oldest data: about an hour."""
SERVER_MEMORY: Final = {"window": "16MB", "browser": "256MB", "none": "16MB"}
"""Of what the server keeps for pages that open later."""
FLUSH_S: Final = 0.25
"""How often the ends of viewer and input are looked for while the viewer takes no data."""
GRACE_S: Final = 1.0
"""After the end of the input, the viewer is killed if it has not ended."""
LOWER_PRIORITY: Final = 5


class LiveDrawing:
    """What a live view shows, sent to a recording.

    Parameters
    ----------
    stream
        Recording to write to.
    scene
        What stays.
    """

    def __init__(self, stream: rr.RecordingStream, scene: LiveScene) -> None:
        self._stream, self._scene = stream, scene
        self._rows = FrameRows(len(scene.markers), tuple(scene.variants))
        self._cycles: dict[str, deque[Mapping[str, Array]]] = {}
        self._time, self._number = 0.0, -1.0
        centers = np.array([plate.center for plate in scene.plates]).reshape(-1, 3)
        ground = centers.mean(axis=0) if len(centers) else np.zeros(3)
        self._surface_m = float(ground[2])
        layout = live_layout(ground + [0, 0, PELVIS_HEIGHT_M])
        stream.send_blueprint(layout, make_active=True, make_default=True)
        stream.send_recording_name("live")
        stream.log("lab", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("lab/axes", rr.TransformAxes3D(0.2), static=True)
        draw_body(stream, scene.body)
        draw_markers(stream, scene.markers)
        draw_plates(stream, scene.plates)
        for variant in scene.variants:
            draw_arrows(stream, variant)
        draw_residual_curves(stream, scene.variants)
        draw_cycle_axes(stream)
        stream.log("legend", rr.TextDocument(LEGEND, media_type="text/markdown"), static=True)

    def show(self, news: LiveNews) -> None:
        """Send frames, the last gait cycles and the status."""
        if len(news.rows):
            block = self._rows.unpack(news.rows)
            later = np.maximum.accumulate(np.append(-np.inf, block.time[:-1]))
            block = block[block.time > later]
            self._send_curves(block)
            step = int(np.ceil(len(block.time) / (1 + np.ptp(block.time) * SCENE_RATE_HZ)))
            self._send_scene(block[(len(block.time) - 1) % step :: step])
            self._time, self._number = float(block.time[-1]), float(block.number[-1])
        for side, cycle in news.cycles:
            self._cycles.setdefault(side, deque(maxlen=SHOWN_CYCLES)).append(cycle)
        now = {"time": np.array([self._time])}
        if news.cycles:
            side = "right" if "right" in self._cycles else "left"
            send_cycles(self._stream, now, list(self._cycles[side]))
        if news.status is not None:
            self._stream.send_columns(
                "status",
                [rr.TimeColumn("time", duration=now["time"])],
                rr.TextDocument.columns(
                    text=[printable(news.status)], media_type=["text/markdown"]
                ),
                strict=True,
            )

    def _send_curves(self, block: FrameBlock) -> None:
        """Send the residuals of all frames, broken where frames were left out."""
        before = np.append(self._number, block.number[:-1])
        gaps = np.flatnonzero(block.number > before + 1)
        time = np.insert(block.time, gaps, block.time[gaps] - 1e-6)
        curves = {
            name: np.insert(value, gaps, np.nan, axis=0) for name, value in block.residual.items()
        }
        send_residual_curves(self._stream, {"time": time}, curves)

    def _send_scene(self, block: FrameBlock) -> None:
        stream, scene, timelines = self._stream, self._scene, {"time": block.time}
        rotation, origin = segment_frames(scene.body, block.q)
        send_body(stream, timelines, rotation, origin)
        markers = Markers(block.time, scene.markers, block.markers)
        send_markers(stream, timelines, markers, scene.body, rotation, origin)
        send_platform(stream, timelines, block.platform)
        for variant in scene.variants:
            feet = block.ground[variant]
            send_ground(
                stream,
                timelines,
                variant,
                {"left_foot": feet[:, 0], "right_foot": feet[:, 1]},
                surface_m=self._surface_m,
                platform=block.platform,
                threshold_n=scene.contact_threshold_n,
            )
            in_lab = reported(block.residual[variant])
            send_residual(stream, timelines, variant, in_lab, origin[:, PELVIS])


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
        with suppress(EOFError, OSError, pickle.UnpicklingError):
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
    scene: LiveScene = inbox.next()
    data, page = free_ports(2)
    arguments, ports = _arguments(scene.screen, data, page)
    with running_viewer(arguments, ports) as process:
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


def _wait_until_sent(
    stream: rr.RecordingStream, process: Popen[bytes], inbox: _Input
) -> None:
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
