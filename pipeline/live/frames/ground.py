"""The wrenches of the plates and the platform's pose, frame by frame."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from compensation import BeltModel, Setup, commanded_pose, fit_pose, neutral_markers
from compensation.platform import MAX_DISTANCE_M
from hbm.signals.resampling import Convolution
from hbm.spatial import Array, fit_rotation, transform_wrench
from pipeline.config.schema import Platform, Settings
from pipeline.io.recording import Plate
from pipeline.io.units import (
    acceleration_in_mps2,
    angle_in_rad,
    force_in_n,
    length_in_m,
    moment_in_nm,
    speed_in_mps,
)
from pipeline.live.frames.channels import AnalogStreams, Channels, SampleBuffer
from pipeline.trial.ground.accelerometers import RealtimeAccelerometers, sensor_delays_s
from pipeline.trial.ground.belts import MODEL_RATE_HZ, RealtimeBelts, belt_side, between_steps
from pipeline.trial.ground.calibration_recording import FILTER
from pipeline.trial.ground.corrected_plates import plate_delays_s, relative_delays_s
from pipeline.trial.ground.laboratory import Laboratory, models_of_plates
from pipeline.trial.ground.platform import MAX_MARKER_ERROR_M, NEUTRAL_FRAMES

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
        self.columns = [list(labels).index(name) for name in platform.markers]
        self.first = list[Array]()
        self.neutral: Array | None = None

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
        except ValueError:
            return UNKNOWN
        return pose.rotation[0], pose.position[0]

    def _find_neutral(self) -> None:
        try:
            neutral = neutral_markers(np.array(self.first))
            fit_pose(neutral[None], neutral, MAX_MARKER_ERROR_M)  # refuses markers in a line
            self.neutral = neutral
            self.neutral_center = neutral.mean(axis=0)
            self.centered = neutral - self.neutral_center
        except ValueError:
            del self.first[0]


class CommandedPlatform:
    """The pose as commanded."""

    def __init__(self, platform: Platform, analog: AnalogStreams, frames_hz: float) -> None:
        self.pivot_m, self.delay_s = platform.pivot_m, platform.delay_s
        self.commands = list[tuple[Channels, Convolution] | None]()
        channels = (platform.sway_channel, length_in_m), (platform.pitch_channel, angle_in_rad)
        for channel, unit_in_si in channels:
            found = None
            if channel is not None:
                stream = analog.find([channel], [unit_in_si])
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
        except ValueError:
            return UNKNOWN
        return pose.rotation[0], pose.position[0]


KEPT_STEPS = 50
"""Of the models' output: half a second."""


class LiveBelts:
    """The models of each plate's belt, step by step from the belts' speeds."""

    def __init__(self, models: Sequence[BeltModel], speeds: Channels, first_s: float) -> None:
        self.speeds, self.belts = speeds, RealtimeBelts.of(models, speeds.rate_hz, first_s)
        self.states = [model.at_rest for model in models]
        self.known = [0] * len(models)
        self.moments = [SampleBuffer(1, KEPT_STEPS) for _ in models]
        known = speeds.buffer.time
        start_s = float(known[0]) if len(known) else first_s
        self.next_step = int(np.ceil((start_s - first_s) * MODEL_RATE_HZ))

    def moments_at(self, at: Sequence[float]) -> Array:
        """Give the moment of each belt at an instant of its own [s], (P,) [N·m]; NaN if unknown."""
        self._advance(max(at))
        return np.array(
            [
                between_steps(moments.time, moments.values, np.array([instant]))[0, 0]
                for moments, instant in zip(self.moments, at, strict=True)
            ]
        )

    def _advance(self, until_s: float) -> None:
        """Run the models as far as an instant needs."""
        belts, ahead_s = self.belts, self.belts.ahead_s
        last = int(np.floor((until_s + ahead_s - belts.first_s) * MODEL_RATE_HZ))
        reach_s = belts.resampling.step_s + belts.resampling.reach_s
        newest_s = self.speeds.buffer.newest_s
        for step in range(self.next_step, last + 1):
            at = belts.first_s + step / MODEL_RATE_HZ
            if at + reach_s > newest_s and at > until_s:
                break
            time, speeds = self.speeds.samples(at - reach_s, at + reach_s)
            acceleration = belts.accelerations(time, speeds, np.array([float(step)]))[0]
            self._step(step, acceleration)
            self.next_step = step + 1

    def _step(self, step: int, acceleration: Array) -> None:
        for k, model in enumerate(self.belts.models):
            moment = np.nan
            if np.isnan(acceleration[k]):
                self.states[k], self.known[k] = model.at_rest, 0
            else:
                self.known[k] += 1
                if self.known[k] > model.advance:
                    found, self.states[k] = model.step(float(acceleration[k]), self.states[k])
                    moment = found
            at = self.belts.first_s + (step - model.advance) / MODEL_RATE_HZ
            self.moments[k].append(np.array([at]), np.array([[moment]]))


PLATE_UNITS: Final = (*[force_in_n] * 3, *[moment_in_nm] * 3)
LIVE: Final = "live"
"""What is compensated, in messages."""


class LiveGround:
    """Plates, accelerometers, belts and platform of a laboratory.

    Of each plate, whose place is known and whose samples do not count, six channels are its Fx Fy
    Fz Mx My Mz in its own axes about the centre of its surface. Labels and rate are those of the
    markers' stream. A ValueError says that a channel or platform marker is in no stream, or that
    the calibration does not fit the streams.
    """

    def __init__(
        self,
        laboratory: Laboratory,
        settings: Settings,
        plates: Sequence[Plate],
        channels: Sequence[Sequence[str]],
        analog: AnalogStreams,
        labels: Sequence[str],
        frames_hz: float,
    ) -> None:
        treadmill = laboratory.treadmill
        self.plates, self.laboratory = plates, laboratory
        self.delays_s = plate_delays_s(plates, laboratory.plates, settings.plate_delay_s)
        each = [analog.find(six, PLATE_UNITS) for six in channels]
        self.groups = _grouped(each, self.delays_s, frames_hz)
        corrections = [_correction(plate, laboratory) for plate in plates]
        self.corrections, self.offsets = map(np.array, zip(*corrections, strict=True))
        self.to_lab = np.array([transform_wrench(np.eye(6), p.rotation, p.center) for p in plates])
        self.ahead_s = [delay_s + how.reach_s for _, _, how, delay_s in self.groups]
        self.gains = list[tuple[Array, Array]]()
        if laboratory.calibration is not None:
            sensors, rate_hz = treadmill.accelerometers, round(each[0].rate_hz, 6)
            setup = Setup(tuple(sensors), rate_hz, treadmill.cutoff_hz, filter_method=FILTER)
            numbers = [plate.number for plate in plates]
            models = models_of_plates(laboratory.calibration, numbers, setup, LIVE)
            self.gains = [(model.gain[:-1], model.gain[-1]) for model in models]
            names = [name for axes in sensors.values() for name in axes]
            unit = treadmill.accelerometer_unit
            self.readings = analog.find(names, [acceleration_in_mps2] * len(names), unit)
            delays_s = sensor_delays_s(treadmill, laboratory.calibration.sensors)
            self.accelerometers = RealtimeAccelerometers.of(
                delays_s, models[0].lags_s, self.readings.rate_hz, frames_hz
            )
            late = relative_delays_s(plates, laboratory.plates)
            self.earlier_s = [d - late_s for d, late_s in zip(self.delays_s, late, strict=True)]
            self.ahead_s.append(max(self.earlier_s) + self.accelerometers.ahead_s)
        self.belts: LiveBelts | None = None
        self.speeds = self._belt_speeds(analog)
        self.platform = _platform(laboratory, analog, labels, frames_hz)
        self.ahead_s.append(self.platform.ahead_s if self.platform is not None else 0.0)

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of what it gives, that of the wrenches nearest to the truth last."""
        compensated = self.gains or self.speeds is not None
        return ("measured", "compensated") if compensated else ("measured",)

    def seen(self, position: Array) -> Pose | None:
        """Give the platform's pose as its markers show it among a frame's, (M, 3) [m], if any."""
        if not isinstance(self.platform, MarkedPlatform):
            return None
        return self.platform.pose(position)

    def at(self, time: float, seen: Pose | None) -> tuple[Array, Pose | None]:
        """Give the plates at a frame's time [s], whose markers show the platform so, or not.

        The wrenches of each variant and plate are in lab axes about the lab origin, unfiltered,
        (V, P, 6) [N, N·m], NaN where unknown; the platform's pose is None where it stands still.
        """
        variants = [self._measured(time)]
        if len(self.variants) > 1:
            compensated = variants[0].copy()
            if self.gains:
                compensated -= self._inertia(time)
            if self.speeds is not None:
                compensated -= self._belts(time, self.speeds)
            variants.append(compensated)
        wrenches = (np.array(variants)[:, :, None] @ self.to_lab)[:, :, 0]
        pose = self.platform.pose(time) if isinstance(self.platform, CommandedPlatform) else seen
        return wrenches if pose is None else transform_wrench(wrenches, *pose), pose

    def _measured(self, time: float) -> Array:
        """Give each plate's own wrench, corrected, (P, 6)."""
        found = np.empty((len(self.plates), 6))
        for plates, channels, resampling, delay_s in self.groups:
            at = time + delay_s
            samples = channels.samples(at - resampling.reach_s, at + resampling.reach_s)
            found[plates] = resampling.evaluate(*samples, np.array([at])).reshape(-1, 6)
        return np.asarray((found[:, None] @ self.corrections)[:, 0] + self.offsets)

    def _inertia(self, time: float) -> Array:
        """Give what the platform's motion adds to each plate, (P, 6)."""
        sensors, felt = self.accelerometers, dict[float, Array]()
        for earlier_s in self.earlier_s:
            if earlier_s not in felt:
                at = time + earlier_s
                samples = self.readings.samples(at - sensors.behind_s, at + sensors.ahead_s)
                felt[earlier_s] = sensors.felt(*samples, np.array([at]))[0]
        return np.array(
            [
                felt[earlier_s] @ gain + offset
                for earlier_s, (gain, offset) in zip(self.earlier_s, self.gains, strict=True)
            ]
        )

    def _belt_speeds(self, analog: AnalogStreams) -> Channels | None:
        belt, models = self.laboratory.treadmill.belt, self.laboratory.belts
        if not models or belt is None:
            return None
        if len(models) != len(self.plates):
            raise ValueError(
                f"{LIVE}: {len(self.plates)} plates, but the belt calibration has {len(models)}"
            )
        count = len(belt.speed_channels)
        names = [belt.speed_channels[k % count] for k in range(len(self.plates))]
        found = analog.find(names, [speed_in_mps] * len(names))
        belts = RealtimeBelts.of(models, found.rate_hz, 0.0)
        self.ahead_s.append(max(self.delays_s) + belts.ahead_s)
        self.sides = np.array([np.r_[np.zeros(3), belt_side(plate)] for plate in self.plates])
        return found

    def _belts(self, time: float, speeds: Channels) -> Array:
        """Give what accelerating belts add to each plate, (P, 6)."""
        if self.belts is None:
            self.belts = LiveBelts(self.laboratory.belts, speeds, time)
        moments = self.belts.moments_at([time + delay_s for delay_s in self.delays_s])
        return np.asarray(moments[:, None] * self.sides)


Group = tuple[list[int], Channels, Convolution, float]
"""Plates of one stream that are equally late: which, their channels, and how they are resampled."""


def _grouped(each: Sequence[Channels], delays_s: Sequence[float], frames_hz: float) -> list[Group]:
    """Put plates together that are resampled alike."""
    together: dict[tuple[int, float], list[int]] = {}
    for k, (channels, delay_s) in enumerate(zip(each, delays_s, strict=True)):
        together.setdefault((id(channels.buffer), delay_s), []).append(k)
    groups = []
    for (_, delay_s), plates in together.items():
        own = [each[k] for k in plates]
        columns = np.concatenate([channels.columns for channels in own])
        factor = np.concatenate([channels.factor for channels in own])
        of_all = Channels(own[0].buffer, columns, factor, own[0].rate_hz)
        how = Convolution.between(own[0].rate_hz, frames_hz)
        groups.append((plates, of_all, how, delay_s))
    return groups


def _correction(plate: Plate, laboratory: Laboratory) -> tuple[Array, Array]:
    """Give matrix and offset of a plate's correction, which is linear: (6, 6) and (6,)."""
    found = laboratory.plates.calibrations.of(plate.number) if laboratory.plates else None
    if found is None:
        return np.eye(6), np.zeros(6)
    offset = found.correct_in_plate(np.zeros(6), plate.rotation, plate.center)
    return found.correct_in_plate(np.eye(6), plate.rotation, plate.center) - offset, offset


def _platform(
    laboratory: Laboratory, analog: AnalogStreams, labels: Sequence[str], frames_hz: float
) -> MarkedPlatform | CommandedPlatform | None:
    platform = laboratory.treadmill.platform
    if platform is None:
        return None
    if platform.markers:
        return MarkedPlatform(platform, labels)
    if not platform.channels:
        raise ValueError("the platform's pose needs its markers, or its sway or pitch channel")
    return CommandedPlatform(platform, analog, frames_hz)
