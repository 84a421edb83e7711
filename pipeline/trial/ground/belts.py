"""Belts: the pitch moment that their acceleration adds to plates.

Acceleration and moment go through the same zero-phase low-pass, in the fit and in every trial: the
model is fitted and used without delay, so that its estimate can be subtracted from a plate's own
samples.
"""

from collections.abc import Sequence
from itertools import cycle
from typing import Final

import numpy as np

from compensation import BeltModel, belt_acceleration, fit_belt
from hbm.signals.filtering import Method, low_pass
from hbm.signals.resampling import Convolution, interpolate
from hbm.spatial import Array
from pipeline.config.schema import Belt
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import FILTER, belt_speed

MODEL_RATE_HZ: Final = 100.0
"""The belt model's rate: belts accelerate below 10 Hz."""


def belt_axes(plate: Plate) -> Array:
    """Give the directions along a belt, to its side, and up; columns in the plate's axes, (3, 3).

    Along is the longer side of the surface, with the sign of the plate's own axis, so that it does
    not depend on the lab's axes. A ValueError where the plate's corners are unknown.
    """
    if not np.isfinite(plate.corners).all():
        raise ValueError(
            f"plate {plate.number}: its corners are unknown, and so is the direction of its belt; "
            "use a C3D file, which holds them"
        )
    # corners in the plate's own axes
    corners = (plate.corners - plate.center) @ plate.rotation
    # the longer side of the surface
    along = max(np.diff(corners[:3], axis=0), key=lambda side: float(np.linalg.norm(side)))
    along = along / np.linalg.norm(along)
    # with the sign of the plate's axis that it is nearest to
    along = along * np.sign(along[np.argmax(np.abs(along))])
    side = np.cross(plate.rotation[2], along)
    side /= np.linalg.norm(side)
    return np.column_stack([along, side, np.cross(along, side)])


def belt_wrenches(
    recording: Recording,
    models: Sequence[BeltModel],
    belt: Belt,
    times: Sequence[Array],
    method: Method = "zero_phase",
) -> list[Array]:
    """Give what accelerating belts add to each plate of a trial, in its own axes, (T, 6) [N, N·m].

    There is one model per plate; times are per plate on the plates' clock, (T,) [s]. NaN outside
    the recording. With "realtime" nothing waits for later samples, and the speeds pass no low-pass:
    the wrenches pass one afterwards, and the models are linear. A ValueError where there are other
    plates than models, or a channel is missing.
    """
    plates = recording.plates
    if len(models) != len(plates):
        raise ValueError(
            f"{recording.source.name}: {len(plates)} plates, but the belt calibration has "
            f"{len(models)}"
        )
    if method == "realtime":
        assert recording.analog is not None
        clock, channels = (
            recording.analog.time,
            zip(cycle(belt.speed_channels), plates, strict=False),
        )
        speeds = np.column_stack([belt_speed(recording, channel) for channel, _ in channels])
        belts = RealtimeBelts(models, recording.analog.rate_hz)
        moments = belts.moments(clock, speeds, times, float(recording.markers.time[0]))
    else:
        every = zip(models, times, belt_accelerations(recording, belt), strict=True)
        moments = [
            interpolate(model_time, model.predict(acceleration), time)
            for model, time, (_, (model_time, acceleration)) in every
        ]
    return [
        np.hstack([np.zeros((len(moment), 3)), moment[:, None] * belt_side(plate)])
        for moment, plate in zip(moments, plates, strict=True)
    ]


BETWEEN_STEPS: Final = Convolution.between(MODEL_RATE_HZ, MODEL_RATE_HZ)
"""From the belts' moments at steps of their models to instants between."""


class RealtimeBelts:
    """How the moments of accelerating belts follow from the belts' speeds, step by step.

    The models' steps are 10 ms apart, one of them at the time of the first frame. A model begins at
    constant speed, and again after a gap.
    """

    def __init__(self, models: Sequence[BeltModel], rate_hz: float) -> None:
        self.models, self.resampling = models, Convolution.between(rate_hz, MODEL_RATE_HZ)
        self.states, self.known = [model.at_rest for model in models], [0] * len(models)
        self.first_s, self.next_step, self.newest = np.nan, 0, list[list[float]]()

    @property
    def ahead_s(self) -> float:
        """How much later than an instant the last sample is that it needs [s]."""
        to_step_s = self.resampling.step_s + self.resampling.reach_s
        advance = max(model.advance for model in self.models)
        between_s = BETWEEN_STEPS.reach_s + BETWEEN_STEPS.step_s
        return to_step_s + advance / MODEL_RATE_HZ + between_s

    def moments(
        self, time: Array, speeds: Array, at: Sequence[Array], first_s: float
    ) -> list[Array]:
        """Give the moments at instants of each plate, (T,) [N·m] each: of a trial or of a frame.

        From speeds (N, P) [m/s], one column per plate, at times (N,). The first frame is at
        ``first_s``. Frames come in order. NaN where unknown.
        """
        # steps of the models are counted from the first frame
        if np.isnan(self.first_s):
            self.first_s = first_s
            start_s = time[0] - first_s if len(time) else 0.0
            self.next_step = int(np.ceil(start_s * MODEL_RATE_HZ))
        half_s, until_s = self.resampling.step_s, max(float(instants[-1]) for instants in at)
        last = int(np.floor((until_s + self.ahead_s - self.first_s) * MODEL_RATE_HZ))
        for step in range(self.next_step, last + 1):
            at_s = self.first_s + step / MODEL_RATE_HZ
            reached_s = at_s + half_s + self.resampling.reach_s
            if at_s > until_s and (not len(time) or reached_s > time[-1]):
                break
            # central difference over one sample, as of `compensation.belt_acceleration`
            around = np.array([at_s - half_s, at_s + half_s])
            earlier, later = self.resampling.evaluate(time, speeds, around)
            self.newest.append(self._step((later - earlier) / (2 * half_s)))
            self.next_step = step + 1
        steps = np.arange(self.next_step - len(self.newest), self.next_step)
        every, moments = np.reshape(self.newest, (-1, len(self.models))), []
        for k, (model, instants) in enumerate(zip(self.models, at, strict=True)):
            # a model reads ahead: its moment is of so many steps before
            step_times = self.first_s + (steps - model.advance) / MODEL_RATE_HZ
            moments.append(BETWEEN_STEPS.evaluate(step_times, every[:, [k]], instants)[:, 0])
        # half a second is more than the next frame of a live session needs
        del self.newest[:-50]
        return moments

    def _step(self, acceleration: Array) -> list[float]:
        """Give each belt's moment, as many steps ago as its model reads ahead [N·m], or NaN."""
        moments = [np.nan] * len(self.models)
        for k, model in enumerate(self.models):
            # after a gap the belt is taken to run at constant speed
            if np.isnan(acceleration[k]):
                self.states[k], self.known[k] = model.at_rest, 0
                continue
            self.known[k] += 1
            if self.known[k] > model.advance:
                moments[k], self.states[k] = model.step(float(acceleration[k]), self.states[k])
        return moments


def belt_side(plate: Plate) -> Array:
    """Give the direction across a belt, about which its moment acts, in the plate's axes, (3,)."""
    return belt_axes(plate)[:, 1]


def belt_accelerations(recording: Recording, belt: Belt) -> list[tuple[Plate, tuple[Array, Array]]]:
    """Give each plate with the times [s] and accelerations [m/s²] of its belt at 100 Hz."""
    result = []
    for plate, channel in zip(recording.plates, cycle(belt.speed_channels), strict=False):
        speed = belt_speed(recording, channel)
        assert recording.analog is not None
        clock, rate_hz = recording.analog.time, recording.analog.rate_hz
        model_time = np.arange(clock[0], clock[-1], 1 / MODEL_RATE_HZ)
        acceleration = belt_acceleration(speed, rate_hz, belt.cutoff_hz, FILTER)
        result.append((plate, (model_time, interpolate(clock, acceleration, model_time))))
    return result


def fit_belts(recording: Recording, belt: Belt) -> tuple[BeltModel, ...]:
    """Fit what accelerating belts add to their empty plates: one model per plate, at 100 Hz.

    Belts accelerate at random, nobody is on them, and the platform is at rest. A ValueError where a
    channel is missing or the fit is not possible.
    """
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: the belt calibration needs plates: {recording.why_no_plates}"
        )
    models = []
    for plate, (time, acceleration) in belt_accelerations(recording, belt):
        # the moment about the axis across the belt: its acceleration pitches the plate
        pitch_moment = plate.wrench_in_plate[:, 3:] @ belt_side(plate)
        filtered = low_pass(pitch_moment, plate.rate_hz, belt.cutoff_hz, FILTER)
        moment = interpolate(plate.time, filtered, time)
        # without half a second at both ends, where the low-pass has no neighbours
        inside = (time > time[0] + 0.5) & (time < time[-1] - 0.5)
        inside &= np.isfinite(moment)
        try:
            model = fit_belt(acceleration[inside], moment[inside] - moment[inside].mean())
        except ValueError as error:
            raise ValueError(f"{recording.source.name}: plate {plate.number}: {error}") from error
        models.append(model)
    return tuple(models)
