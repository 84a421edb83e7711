"""Plates that are later than the markers, from the motion of the subject."""

from collections import deque
from typing import Final

import numpy as np

from compensation import marker_plate_delay
from hbm.notes import Note
from hbm.signals.filtering import acceleration_lag_s
from pipeline.live.frames.frame import LiveFrame
from pipeline.trial.residuals import REPORTED_SIGN

KEPT_S: Final = 20.0
"""Some fifteen gait cycles."""
JUDGED_S: Final = 10.0
MIN_DELAY_S: Final = 0.005
CHANGED_S: Final = 0.002
"""By which a delay has changed to be noted again."""


class DelayWatch:
    """Notes how much later the plates are than the markers, every ten seconds of walking.

    Notes
    -----
    As `compensation.marker_plate_delay`; the lag of the real-time filter's accelerations is added.
    A delay below 5 ms, or whose 95 % interval contains zero, is none.
    """

    def __init__(self) -> None:
        self._frames: deque[LiveFrame] = deque()
        self._judged_s = -np.inf
        self._noted_s = np.nan

    def add(self, frame: LiveFrame) -> tuple[Note, ...]:
        """Take a frame; give what it and those before show."""
        self._frames.append(frame)
        while frame.time - self._frames[0].time > KEPT_S:
            self._frames.popleft()
        if frame.time - max(self._judged_s, self._frames[0].time) < JUDGED_S:
            return ()
        self._judged_s = frame.time
        return self._judge()

    def _judge(self) -> tuple[Note, ...]:
        variant = list(self._frames[-1].residual)[-1]
        time = np.array([frame.time for frame in self._frames])
        plate = np.array([frame.by_foot[variant][:, :3].sum(axis=0) for frame in self._frames])
        residual = np.array([frame.residual[variant][:3] for frame in self._frames])
        motion = plate + residual * REPORTED_SIGN[:3]
        motion[[not frame.quality.counts for frame in self._frames]] = np.nan
        try:
            found = marker_plate_delay(plate, motion, time)
        except ValueError:  # not determined by what is in it
            return ()
        delay_s = found.seconds + acceleration_lag_s(time)
        if abs(delay_s) <= max(MIN_DELAY_S, found.uncertainty):
            return ()
        if abs(delay_s - self._noted_s) < CHANGED_S:
            return ()
        self._noted_s = delay_s
        return (Note.of("live_plates_late", delay_s=delay_s, uncertainty_s=found.uncertainty),)
