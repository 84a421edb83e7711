"""What a live view shows, as it comes."""

from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import rerun as rr

from hbm.coordinates import MOVING
from hbm.markers import Markers
from hbm.poses import segment_frames
from hbm.spatial import Array
from pipeline.trial.residuals import reported
from pipeline.viewer.blueprint import live_layout
from pipeline.viewer.body import draw_body, send_body
from pipeline.viewer.cycles import SHOWN_CYCLES, draw_cycle_axes, send_cycles
from pipeline.viewer.file import printable
from pipeline.viewer.legend import LEGEND
from pipeline.viewer.live_frames import FrameBlock, FrameRows, LiveNews, LiveScene
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

SCENE_RATE_HZ: Final = 50.0
"""Smooth to the eye; residual curves have every frame."""
PELVIS: Final = MOVING.index("pelvis")
TARGET_FROM_PLATES_M: Final = np.array([0.0, 0.0, 0.8])
"""Where the camera looks: head and plates are in the picture."""


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
        self._start_s: float | None = None
        self._time, self._number = 0.0, -1.0
        centers = np.array([plate.center for plate in scene.plates]).reshape(-1, 3)
        ground = centers.mean(axis=0) if len(centers) else np.zeros(3)
        self._surface_m = float(ground[2])
        layout = live_layout(ground + TARGET_FROM_PLATES_M)
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
        block = self._rows.unpack(news.rows)
        block = block[np.isfinite(block.time)]
        if len(block.time):
            self._send_frames(block)
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

    def _send_frames(self, block: FrameBlock) -> None:
        """Send the frames whose time increases, at the time since the first one."""
        if self._start_s is None:
            self._start_s = float(block.time[0])
        block = replace(block, time=block.time - self._start_s)
        block = block[block.time > np.maximum.accumulate(np.append(-np.inf, block.time[:-1]))]
        self._send_curves(block)
        step = int(np.ceil(len(block.time) / (1 + np.ptp(block.time) * SCENE_RATE_HZ)))
        self._send_scene(block[(len(block.time) - 1) % step :: step])
        self._time, self._number = float(block.time[-1]), float(block.number[-1])

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
        markers = Markers(block.time, tuple(scene.markers), block.markers)
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
