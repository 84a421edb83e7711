"""The wrenches of the plates and the platform's pose, frame by frame, from analog streams."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, groupby
from typing import Final

import numpy as np
from scipy.linalg.lapack import dgesdd

from compensation import InertiaModel, Setup, commanded_pose, fit_pose, neutral_markers
from compensation.platform import MAX_DISTANCE_M
from hbm.signals.resampling import Convolution
from hbm.spatial import Array, Indices, Mask, skew, transform_wrench
from hbm.spelling import listed, short
from pipeline.config.schema import Platform, Settings
from pipeline.io import units
from pipeline.io.recording import Plate
from pipeline.io.streams import over_short_losses
from pipeline.live.stream import Samples, StreamDescription
from pipeline.trial.findings.drift import LIMITS as DRIFT
from pipeline.trial.findings.drift import latest, reading
from pipeline.trial.ground.accelerometers import FILTER, RealtimeAccelerometers, sensor_delays_s
from pipeline.trial.ground.belts import RealtimeBelts, belt_side
from pipeline.trial.ground.laboratory import (
    Laboratory,
    models_of_plates,
    plate_delays_s,
    relative_delays_s,
)
from pipeline.trial.ground.platform import LIMITS as PLATFORM


class SampleBuffer:
    """The newest samples of one stream, so many at most: times, (N,) [s], and values, (N, K).

    Examples
    --------
    >>> buffer = SampleBuffer(columns=1, length=2)
    >>> buffer.append(np.array([0.0, 0.1, 0.2]), np.ones((3, 1)))
    >>> buffer.newest_s, len(buffer.values)
    (0.2, 2)
    """

    def __init__(self, columns: int, length: int) -> None:
        self.length, self.newest_s = length, -np.inf
        self._times, self._rows = np.empty(2 * length), np.empty((2 * length, columns))
        self.time, self.values = self._times[:0], self._rows[:0]
        self._stop = 0

    def append(self, time: Array, values: Array) -> None:
        """Take samples, (N,) [s] and (N, K), in order and later than the last one."""
        time, values = time[-self.length :], values[-self.length :]
        if self._stop + len(time) > len(self._times):  # twice as long, so that few copies do
            self._stop = len(self.time)
            self._times[: self._stop], self._rows[: self._stop] = self.time, self.values
        start, self._stop = self._stop, self._stop + len(time)
        self._times[start : self._stop], self._rows[start : self._stop] = time, values
        kept = slice(max(self._stop - self.length, 0), self._stop)
        self.time, self.values = self._times[kept], self._rows[kept]
        self.newest_s = float(self.time[-1]) if len(self.time) else -np.inf


@dataclass(frozen=True, slots=True)
class Channels:
    """Some channels of one stream: which, and what brings each to SI units, (K,)."""

    stream: str
    buffer: SampleBuffer
    columns: Indices
    factor: Array
    rate_hz: float

    @classmethod
    def joined(cls, channels: Sequence["Channels"]) -> "Channels":
        """Give channels of one stream in a row."""
        columns, factor = (
            np.concatenate([getattr(c, x) for c in channels]) for x in ("columns", "factor")
        )
        return replace(channels[0], columns=columns, factor=factor)

    def samples(self, start_s: float = -np.inf, stop_s: float = np.inf) -> tuple[Array, Array]:
        """Give the samples from one time to another, or all: (N,) [s] and (N, K) in SI units."""
        time = self.buffer.time
        first, last = np.searchsorted(time, (start_s, stop_s))
        part = slice(max(int(first) - 1, 0), int(last) + 1)
        return time[part], self.buffer.values[part][:, self.columns] * self.factor


class AnalogStreams:
    """All analog streams; ``used`` has the newest samples of those of which channels were found."""

    def __init__(self, streams: Sequence[StreamDescription]) -> None:
        self.streams = {stream.name: stream for stream in streams}
        self.used: dict[str, SampleBuffer] = {}

    def append(self, samples: Samples) -> None:
        """Take what arrived, if it is of a stream of which channels are used."""
        if (buffer := self.used.get(samples.stream)) is None:
            return
        # a loss may lie between the newest sample before and the first of these
        kept = min(len(buffer.time), 1)
        time = np.concatenate([buffer.time[-1:], samples.time])
        values = np.concatenate([buffer.values[-1:], samples.values])
        time, values = over_short_losses(time, values, self.streams[samples.stream].rate_hz)
        buffer.append(time[kept:], values[kept:])

    def find(
        self,
        labels: Sequence[str],
        unit_in_si: Sequence[Callable[[str], float]],
        unit: str | None = None,
    ) -> Channels:
        """Find channels of one stream, in this order.

        Of each, ``unit_in_si`` gives one of a unit in SI, such as `pipeline.io.units.length_in_m`;
        the unit is as stated, else as the stream has it. A ValueError says that no stream has all
        of them, that several have, or that a unit is unknown.
        """
        having = [s for s in self.streams.values() if set(labels) <= set(s.labels)]
        if len(having) > 1:
            names = listed(repr(short(stream.name)) for stream in having)
            raise ValueError(
                f"live channels {listed(labels)}: several streams have them ({names}); name one "
                "of these streams in [live] analog"
            )
        if not having:
            there = [label for stream in self.streams.values() for label in stream.labels]
            missing = [label for label in labels if label not in there]
            raise ValueError(
                f"live channels {listed(missing or labels)} are in no stream"
                f"{'' if missing else ' together'}; channels there: {listed(there)}"
            )
        (stream,) = having
        if twice := [label for label in labels if stream.labels.count(label) > 1]:
            raise ValueError(f"stream {short(stream.name)!r}: several channels are {listed(twice)}")
        columns = np.array([stream.labels.index(label) for label in labels])
        sent = [unit or stream.units[column] for column in columns]
        try:
            factor = [in_si(written) for in_si, written in zip(unit_in_si, sent, strict=True)]
        except ValueError as error:
            raise ValueError(f"stream {short(stream.name)!r}: {error}") from error
        # two seconds are kept: markers are never so much later than analog channels
        empty = SampleBuffer(len(stream.labels), round(2.0 * stream.rate_hz))
        buffer = self.used.setdefault(stream.name, empty)
        return Channels(stream.name, buffer, columns, np.array(factor), stream.rate_hz)


Pose = tuple[Array, Array]
"""Rotation, (3, 3), and position, (3,) [m]; NaN where unknown."""
UNKNOWN: Final[Pose] = (np.full((3, 3), np.nan), np.full(3, np.nan))


class MarkedPlatform:
    """The pose from markers on the platform, whose first frames show it in neutral."""

    ahead_s = 0.0

    def __init__(self, platform: Platform, labels: Sequence[str]) -> None:
        missing = [name for name in platform.markers if name not in labels]
        if missing:
            raise ValueError(
                f"platform markers {', '.join(missing)} are not in the stream of markers; markers "
                f"there: {', '.join(labels)}"
            )
        self.columns = np.array([list(labels).index(name) for name in platform.markers])
        self.first, self.neutral = list[Array](), np.empty((0, 3))

    def pose(self, position: Array) -> Pose:
        """Give the pose of a frame, its markers (M, 3) [m]; NaN where unknown."""
        markers = position[self.columns]
        if not len(self.neutral):
            if np.isfinite(position).any():
                self.first.append(markers)
            if len(self.first) == PLATFORM.neutral_frames:
                self._find_neutral()
            return UNKNOWN
        if (np.abs(markers) < MAX_DISTANCE_M).all():  # what `fit_pose` does first, in a tenth of it
            center = np.add.reduce(markers) / len(markers)
            around = markers - center
            # the rotation with the least squares of errors, from the SVD of the covariance
            u, _, vt, _ = dgesdd(around.T @ self.around_then)  # as `fit_rotation`
            rotation = u @ vt
            error = self.around_then @ rotation.T - around
            fits = np.vecdot(error, error).max() <= PLATFORM.largest_marker_error**2
            if fits and np.linalg.det(rotation) > 0:
                return rotation, center - rotation @ self.center_then
        # a marker is hidden or wrong: it is left out, if three or more others agree
        try:
            pose = fit_pose(markers[None], self.neutral, PLATFORM.largest_marker_error).pose
        except ValueError:
            return UNKNOWN
        return pose.rotation[0], pose.position[0]

    def _find_neutral(self) -> None:
        try:
            neutral = neutral_markers(np.array(self.first))
            # refuses markers in a line
            fit_pose(neutral[None], neutral, PLATFORM.largest_marker_error)
            self.neutral, self.center_then = neutral, neutral.mean(axis=0)
            self.around_then = neutral - self.center_then
        except ValueError:
            del self.first[0]


class CommandedPlatform:
    """The pose as commanded."""

    def __init__(self, platform: Platform, analog: AnalogStreams, frames_hz: float) -> None:
        if not platform.channels:
            raise ValueError("the platform's pose needs its markers, or its sway or pitch channel")
        self.pivot_m, self.delay_s = platform.pivot_m, platform.delay_s
        sway, pitch = platform.sway_channel, platform.pitch_channel
        commands = (0, sway, units.length_in_m), (1, pitch, units.angle_in_rad)
        sent = [
            (k, analog.find([name], [in_si])) for k, name, in_si in commands if name is not None
        ]
        self.commands = [(k, c, Convolution.between(c.rate_hz, frames_hz)) for k, c in sent]
        self.ahead_s = self.delay_s + max(how.reach_s for _, _, how in self.commands)

    def pose(self, time: float) -> Pose:
        """Give the pose at a frame's time [s]; NaN where a command is not known."""
        sway_and_pitch = np.zeros(2)
        for k, channels, how in self.commands:
            sway_and_pitch[k] = _resampled(channels, how, time + self.delay_s)[0]
        try:
            pose = commanded_pose(sway_and_pitch[:1], sway_and_pitch[1:], self.pivot_m)
        except ValueError:
            return UNKNOWN
        return pose.rotation[0], pose.position[0]


def _resampled(channels: Channels, how: Convolution, at: float) -> Array:
    """Give channels at an instant [s], (K,); NaN where unknown."""
    buffer = channels.buffer
    return how.at_one(buffer.time, buffer.values, at)[channels.columns] * channels.factor


PLATE_UNITS: Final = (*[units.force_in_n] * 3, *[units.moment_in_nm] * 3)


class LiveGround:
    """Plates, accelerometers, belts and platform of a laboratory.

    Of each plate, whose place is known and whose samples do not count, six channels are its Fx Fy
    Fz Mx My Mz in its own axes about the centre of its surface. A ValueError says that a channel or
    platform marker is in no stream, or that the calibration does not fit the streams.
    """

    def __init__(
        self,
        laboratory: Laboratory,
        settings: Settings,
        plates: Sequence[Plate],
        channels: Sequence[Sequence[str]],
        analog: AnalogStreams,
        markers: StreamDescription,
    ) -> None:
        treadmill, frames_hz = laboratory.treadmill, markers.rate_hz
        delays_s = plate_delays_s(plates, laboratory.plates, settings.plate_delay_s)
        self.plates = [analog.find(six, PLATE_UNITS) for six in channels]
        self.resampled = list[tuple[Channels, Convolution, float]]()
        # plates of one stream and delay are resampled together
        with_delays = zip(self.plates, delays_s, strict=True)
        for (_, delay_s), group in groupby(with_delays, lambda of: (of[0].stream, of[1])):
            sent = Channels.joined([channels for channels, _ in group])
            how = Convolution.between(sent.rate_hz, frames_hz)
            self.resampled.append((sent, how, delay_s))
        self.delays_s = np.array(delays_s)
        # as sent -> corrected, in the lab with the platform in neutral
        to_lab = np.array([transform_wrench(np.eye(6), p.rotation, p.center) for p in plates])
        corrections = zip(*(_correction(plate, laboratory) for plate in plates), strict=True)
        self.to_lab, self.offsets = (np.array(parts) @ to_lab for parts in corrections)
        self.upward = [plate.rotation[2] for plate in plates]
        self.at_rest = [deque[Array](maxlen=DRIFT.followed_phases) for _ in plates]
        ahead_s = [0.0, *(delay_s + how.reach_s for _, how, delay_s in self.resampled)]

        self.sensors: InertiaModel | None = None
        if (calibration := laboratory.calibration) is not None:
            sensors, rate_hz = treadmill.accelerometers, round(self.plates[0].rate_hz, 6)
            setup = Setup(tuple(sensors), rate_hz, treadmill.cutoff_hz, filter_method=FILTER)
            models = models_of_plates(calibration, [p.number for p in plates], setup, "live")
            # models of the plates read the same sensors at the same lags; their gains differ
            self.sensors, lags_s = models[0], models[0].lags_s
            self.gains = np.array([model.gain for model in models]) @ to_lab
            names = [name for axes in sensors.values() for name in axes]
            in_si = [units.acceleration_in_mps2] * len(names)
            self.readings = analog.find(names, in_si, treadmill.accelerometer_unit)
            late_s, rate_hz = sensor_delays_s(treadmill, calibration.sensors), self.readings.rate_hz
            self.accelerometers = RealtimeAccelerometers.of(late_s, lags_s, rate_hz, frames_hz)
            # sensors are read on the plates' clock, however late these are to one another
            late = relative_delays_s(plates, laboratory.plates)
            earlier_s = self.delays_s - late
            self.earlier_s, self.of_plate = np.unique(earlier_s, return_inverse=True)
            ahead_s.append(float(max(earlier_s)) + self.accelerometers.ahead_s)

        self.belts: RealtimeBelts | None = None
        if (belts := laboratory.belts) and (belt := treadmill.belt) is not None:
            if len(belts) != (count := len(plates)):
                fitted = f"the belt calibration has {len(belts)}"
                raise ValueError(f"live: {count} plates, but {fitted}")
            speeds = [name for name, _ in zip(cycle(belt.speed_channels), plates, strict=False)]
            self.speeds = analog.find(speeds, [units.speed_in_mps] * count)
            self.belts = RealtimeBelts(belts, self.speeds.rate_hz)
            # the moment of a belt that accelerates acts about the direction across it
            sides = np.array([[np.r_[np.zeros(3), belt_side(plate)]] for plate in plates])
            self.sides = sides @ to_lab
            ahead_s.append(max(delays_s) + self.belts.ahead_s)

        self.platform: MarkedPlatform | CommandedPlatform | None = None
        if (platform := treadmill.platform) is not None:
            commanded = None if platform.markers else CommandedPlatform(platform, analog, frames_hz)
            self.platform = commanded or MarkedPlatform(platform, markers.labels)
            ahead_s.append(self.platform.ahead_s)
        self.ahead_s = max(ahead_s)
        compensated = self.sensors is not None or self.belts is not None
        self.variants = ("measured", "compensated") if compensated else ("measured",)

    def seen(self, position: Array) -> Pose | None:
        """Give the platform's pose as its markers show it among a frame's, (M, 3) [m], if any."""
        return self.platform.pose(position) if isinstance(self.platform, MarkedPlatform) else None

    def at(self, time: float, shown: Pose | None) -> tuple[Array, Pose | None]:
        """Give the plates at a frame's time [s], whose markers show the platform so, or not.

        The wrenches of each variant and plate are in lab axes about the lab origin, unfiltered,
        (V, P, 6) [N, N·m], NaN where unknown; the platform's pose is None where it stands still.
        """
        sent = [_resampled(read, how, time + delay_s) for read, how, delay_s in self.resampled]
        measured = np.concatenate(sent).reshape(-1, 1, 6) @ self.to_lab + self.offsets
        added = [self._inertia(time)] if self.sensors is not None else []
        if self.belts is not None:
            at, samples = [np.array([t]) for t in time + self.delays_s], self.speeds.samples()
            added.append(np.array(self.belts.moments(*samples, at, time))[..., None] * self.sides)
        # what the motion of platform and belts adds is no load of the subject
        variants = [measured, measured - sum(added)] if added else [measured]
        wrenches = np.array(variants)[:, :, 0]
        pose = self.platform.pose(time) if isinstance(self.platform, CommandedPlatform) else shown
        if pose is not None:  # as `transform_wrench`, in a third of its time for one pose
            turned = wrenches.reshape(-1, 2, 3) @ pose[0].T
            turned[:, 1] -= turned[:, 0] @ skew(pose[1])
            wrenches = turned.reshape(wrenches.shape)
        return wrenches, pose

    def follow(self, start_s: float, stop_s: float, empty: Mask) -> None:
        """Take what plates read in a phase in which no foot is on some of them, (P,)."""
        for k in np.flatnonzero(empty):
            samples = self.plates[k].samples(start_s, stop_s)
            read = reading(*samples, self.upward[k], start_s, stop_s)
            if read is not None:
                self.at_rest[k].append(read)
                # subtracted before its correction, which then has no offset
                self.offsets[k] = -latest(np.array(self.at_rest[k])) @ self.to_lab[k]

    def _inertia(self, time: float) -> Array:
        """Give what the platform's motion adds to each plate in the lab, (P, 1, 6)."""
        sensors = self.accelerometers

        def read(at: Array) -> Array:
            return np.array([_resampled(self.readings, sensors.resampling, t) for t in at.tolist()])

        readings = sensors.accelerations(read, time + self.earlier_s)[self.of_plate, None]
        # the model is linear: a gain per reading, and a constant
        return np.asarray(readings @ self.gains[:, :-1] + self.gains[:, -1:])


def _correction(plate: Plate, laboratory: Laboratory) -> tuple[Array, Array]:
    """Give matrix and offset of a plate's correction, which is linear: (6, 6) and (1, 6)."""
    fitted = laboratory.plates.calibrations.of(plate.number) if laboratory.plates else None
    if fitted is None:
        return np.eye(6), np.zeros((1, 6))
    # corrected, nothing gives the offset and one of each component its row of the matrix
    offset, *ones = fitted.correct_in_plate(np.eye(7, 6, -1), plate.rotation, plate.center)
    return ones - offset, offset[None]
