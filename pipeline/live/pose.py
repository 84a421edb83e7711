"""The calibration pose, shown live: found as soon as the subject stands still."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.config.live import Live
from pipeline.io.recording import Plate, Recording
from pipeline.live.stream import Samples, StreamDescription
from pipeline.trial.subject import MAX_STILL_EXTENT_M, MIN_MASS_KG, median_extent

POSE_S: Final = 1.2
"""A second of standing still, in which the body is built and weighed, and a little more."""
EVERY_S: Final = 0.1
"""Between looks."""


class PoseFinder:
    """Watches streams until a subject stands still on the plates, with all markers in sight.

    Parameters
    ----------
    live
        Which streams and channels are what.
    streams
        What is received.
    plates
        Places of the plates.

    Attributes
    ----------
    why_not
        What is amiss as long as no pose is found, in words.
    """

    def __init__(
        self, live: Live, streams: Sequence[StreamDescription], plates: Sequence[Plate]
    ) -> None:
        self._streams = {stream.name: stream for stream in streams}
        self._markers = live.markers or next(s.name for s in streams if s.kind == "markers")
        self._live, self._plates = live, plates
        self._kept: dict[str, deque[Samples]] = {stream.name: deque() for stream in streams}
        self._looked_s = -np.inf
        self.why_not = f"stream {self._markers} has sent too few frames"

    def add(self, samples: Samples) -> Recording | None:
        """Take what arrived; give the pose's recording once the last 1.2 s show it."""
        kept = self._kept.get(samples.stream)
        if kept is None or not len(samples.time):
            return None
        kept.append(samples)
        while samples.time[-1] - kept[0].time[-1] > POSE_S:
            kept.popleft()
        if samples.stream != self._markers or samples.time[-1] - self._looked_s < EVERY_S:
            return None
        self._looked_s = float(samples.time[-1])
        return self._pose()

    def _pose(self) -> Recording | None:
        time, position = self._joined(self._markers)
        if time[-1] - time[0] < POSE_S - EVERY_S:
            return None
        names = self._streams[self._markers].labels
        markers = Markers(time - time[0], names, position.reshape(len(time), len(names), 3))
        seen = np.isfinite(markers.position).all(axis=(0, 2))
        if not seen.any():
            self.why_not = "no marker is seen all the time"
            return None
        extent_m = median_extent(markers.position[:, seen])
        if extent_m > MAX_STILL_EXTENT_M:
            self.why_not = (
                f"the markers moved by {1000 * extent_m:.0f} mm within {POSE_S:g} s, at most "
                f"{1000 * MAX_STILL_EXTENT_M:.0f} mm are standing still"
            )
            return None
        plates = [self._plate(plate, float(time[0])) for plate in self._plates]
        standing = [plate for plate in plates if plate is not None]
        carried_n = sum(float(np.mean(plate.wrench[:, 2])) for plate in standing)
        if len(standing) < len(plates):
            self.why_not = "a plate has sent nothing"
            return None
        if not carried_n >= MIN_MASS_KG * GRAVITY_MPS2:
            self.why_not = f"the plates carry {carried_n:.0f} N, which is nobody"
            return None
        return Recording(Path("calibration pose"), markers, tuple(standing))

    def _plate(self, plate: Plate, start_s: float) -> Plate | None:
        """Give a plate with what it read lately; None where it sends nothing."""
        channels = self._live.channels_of(plate.number)
        for stream in self._streams.values():
            if set(channels) <= set(stream.labels) and self._kept[stream.name]:
                time, values = self._joined(stream.name)
                columns = [stream.labels.index(channel) for channel in channels]
                wrench = values[:, columns]
                return replace(plate, time=time - start_s, wrench_in_plate=wrench)
        return None

    def _joined(self, stream: str) -> tuple[Array, Array]:
        kept = self._kept[stream]
        time = np.concatenate([samples.time for samples in kept])
        values = np.concatenate([samples.values for samples in kept])
        order = np.unique(time, return_index=True)[1]
        return time[order], values[order]
