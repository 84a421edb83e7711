"""The platform's pose, frame by frame."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from compensation import commanded_pose, fit_pose, neutral_markers
from compensation.platform import MAX_DISTANCE_M
from hbm.signals.convolution import Convolution
from hbm.spatial import Array, fit_rotation
from pipeline.config.schema import Platform
from pipeline.io.units import angle_in_rad, length_in_m
from pipeline.live.frames.channels import AnalogStreams, Channels
from pipeline.trial.ground.platform import MAX_MARKER_ERROR_M, NEUTRAL_FRAMES

Pose = tuple[Array, Array]
"""Rotation, (3, 3), and position, (3,) [m]; NaN where unknown."""
UNKNOWN: Final[Pose] = (np.full((3, 3), np.nan), np.full(3, np.nan))


class MarkedPlatform:
    """The pose from markers on the platform, whose first frames show it in neutral.

    Parameters
    ----------
    platform
        As stated.
    labels
        Of the markers' stream, (M,).

    Attributes
    ----------
    problem
        Why there is no neutral pose; empty where there is one, or none yet.

    Raises
    ------
    ValueError
        A platform marker is not in the stream.
    """

    ahead_s = 0.0

    def __init__(self, platform: Platform, labels: Sequence[str]) -> None:
        missing = [name for name in platform.markers if name not in labels]
        if missing:
            raise ValueError(
                f"platform markers {', '.join(missing)} are not in the stream of markers; markers "
                f"there: {', '.join(labels)}"
            )
        self.columns = [list(labels).index(name) for name in platform.markers]
        self.first = list[Array]()
        self.neutral: Array | None = None
        self.problem = ""

    def pose(self, position: Array) -> Pose:
        """Give the pose of a frame, its markers (M, 3) [m]; NaN where unknown."""
        own = position[self.columns]
        if self.neutral is None:
            self.first.append(own)
            if len(self.first) == NEUTRAL_FRAMES:
                self._find_neutral()
            return UNKNOWN
        if (np.abs(own) < MAX_DISTANCE_M).all():
            center = own.mean(axis=0)
            rotation = fit_rotation((own - center).T @ self.centered)
            error = self.centered @ rotation.T + center - own
            if (error * error).sum(axis=1).max() <= MAX_MARKER_ERROR_M**2:
                return rotation, center - rotation @ self.neutral_center
        try:
            pose = fit_pose(own[None], self.neutral, MAX_MARKER_ERROR_M).pose
        except ValueError as error:
            self.problem = str(error)
            return UNKNOWN
        return pose.rotation[0], pose.position[0]

    def _find_neutral(self) -> None:
        try:
            neutral = neutral_markers(np.array(self.first))
            fit_pose(neutral[None], neutral, MAX_MARKER_ERROR_M)  # refuses markers in a line
            self.neutral, self.problem = neutral, ""
            self.neutral_center = neutral.mean(axis=0)
            self.centered = neutral - self.neutral_center
        except ValueError as error:
            self.problem = str(error)
            del self.first[0]


class CommandedPlatform:
    """The pose as commanded.

    Parameters
    ----------
    platform
        As stated.
    analog
        All analog streams.
    frames_hz
        Rate of the frames [Hz].

    Raises
    ------
    ValueError
        A channel is in no stream, or in another unit.
    """

    def __init__(self, platform: Platform, analog: AnalogStreams, frames_hz: float) -> None:
        self.pivot_m, self.delay_s, self.problem = platform.pivot_m, platform.delay_s, ""
        self.commands = list[tuple[Channels, Convolution] | None]()
        channels = (platform.sway_channel, length_in_m), (platform.pitch_channel, angle_in_rad)
        for channel, unit_in_si in channels:
            found = None
            if channel is not None:
                stream = analog.find([channel], unit_in_si)
                found = stream, Convolution.between(stream.rate_hz, frames_hz)
            self.commands.append(found)
        reaches = [command[1].reach_s for command in self.commands if command is not None]
        self.ahead_s = self.delay_s + max(reaches)

    def pose(self, time: float) -> Pose:
        """Give the pose at a frame's time [s]; NaN where a command is not known."""
        at, values = time + self.delay_s, []
        for command in self.commands:
            value = 0.0
            if command is not None:
                channels, resampling = command
                samples = channels.samples(at - resampling.reach_s, at + resampling.reach_s)
                value = float(resampling.evaluate(*samples, np.array([at]))[0, 0])
            values.append(value)
        if not np.isfinite(values).all():
            return UNKNOWN
        try:
            pose = commanded_pose([values[0]], [values[1]], self.pivot_m)
        except ValueError as error:
            self.problem = str(error)
            return UNKNOWN
        return pose.rotation[0], pose.position[0]
