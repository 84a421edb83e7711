"""The wrenches of the plates, frame by frame, as measured and compensated, in the lab."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import Setup
from hbm.signals.resampling import Convolution
from hbm.spatial import Array, transform_wrench
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate
from pipeline.io.units import acceleration_in_mps2, force_in_n, moment_in_nm, speed_in_mps
from pipeline.live.frames.belts import LiveBelts
from pipeline.live.frames.channels import AnalogStreams, Channels
from pipeline.live.frames.platform import CommandedPlatform, MarkedPlatform, Pose
from pipeline.trial.ground.accelerometers import RealtimeAccelerometers
from pipeline.trial.ground.belts import RealtimeBelts, belt_side
from pipeline.trial.ground.corrected_plates import plate_delays_s, relative_delays_s
from pipeline.trial.ground.empty_plates import FILTER
from pipeline.trial.ground.laboratory import Laboratory, models_of_plates

LIVE: Final = "live"
"""What is compensated, in messages."""


@dataclass(frozen=True, slots=True)
class GroundFrame:
    """The plates in one frame.

    Attributes
    ----------
    wrenches
        Of each variant and plate, lab axes about the lab origin, unfiltered, (V, P, 6) [N, N·m];
        NaN where unknown.
    platform
        Rotation, (3, 3), and position, (3,) [m], of the platform, NaN where unknown; None where it
        stands still.
    """

    wrenches: Array
    platform: Pose | None = None

    @property
    def platform_known(self) -> bool:
        """Whether the platform's pose is known, or it stands still."""
        return self.platform is None or not np.isnan(self.platform[1][0])


class LiveGround:
    """Plates, accelerometers, belts and platform of a laboratory.

    Parameters
    ----------
    laboratory
        The treadmill and its calibrations.
    settings
        How trials are processed.
    plates
        Places of the plates, whose samples do not count.
    channels
        Of each plate, in this order: its Fx Fy Fz Mx My Mz, in its own axes about the centre of
        its surface.
    analog
        All analog streams.
    labels, frames_hz
        Of the markers' stream [Hz].

    Raises
    ------
    ValueError
        A channel or platform marker is in no stream, or the calibration does not fit the streams.
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
        each = [_plate_channels(analog, six) for six in channels]
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
            self.readings = analog.find(names, acceleration_in_mps2, unit)
            self.accelerometers = RealtimeAccelerometers.of(
                treadmill,
                laboratory.calibration.sensors,
                models[0].lags_s,
                self.readings.rate_hz,
                frames_hz,
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

    def at(self, time: float, seen: Pose | None) -> GroundFrame:
        """Give the plates at a frame's time [s], whose markers show the platform so, or not."""
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
        if pose is None:
            return GroundFrame(wrenches)
        return GroundFrame(transform_wrench(wrenches, *pose), pose)

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
        found = analog.find(names, speed_in_mps)
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


def _plate_channels(analog: AnalogStreams, six: Sequence[str]) -> Channels:
    forces, moments = (
        analog.find(labels, unit_in_si)
        for labels, unit_in_si in ((six[:3], force_in_n), (six[3:], moment_in_nm))
    )
    if forces.buffer is not moments.buffer:
        raise ValueError(f"the six channels {', '.join(six)} of a plate are not in one stream")
    return Channels(
        forces.buffer,
        np.concatenate([forces.columns, moments.columns]),
        np.concatenate([forces.factor, moments.factor]),
        forces.rate_hz,
    )


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
