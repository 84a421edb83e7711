"""Belts: the pitch moment that their acceleration adds to plates.

Acceleration and moment go through the same zero-phase low-pass, in the fit and in every trial: the
model is fitted and used without delay, so that its estimate can be subtracted from a plate's own
samples.
"""

from collections.abc import Sequence
from itertools import cycle
from typing import Final

import numpy as np

from compensation import BeltModel, belt_acceleration
from hbm.signals.filtering import Method
from hbm.signals.resampling import Convolution, interpolate
from hbm.spatial import Array
from pipeline.config.schema import Belt
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import belt_speed
from pipeline.trial.ground.calibration_recording import FILTER

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
    corners = (plate.corners - plate.center) @ plate.rotation
    along = max(np.diff(corners[:3], axis=0), key=lambda side: float(np.linalg.norm(side)))
    along = along / np.linalg.norm(along)
    if along[np.argmax(np.abs(along))] < 0:
        along = -along
    up = plate.rotation[2]
    side = np.cross(up, along)
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
        channels = [name for name, _ in zip(cycle(belt.speed_channels), plates, strict=False)]
        speeds = np.column_stack([belt_speed(recording, name) for name in channels])
        assert recording.analog is not None
        first_s = float(recording.markers.time[0])
        belts = RealtimeBelts(models, recording.analog.rate_hz, first_s)
        moments = belts.moments(recording.analog.time, speeds, times)
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


class RealtimeBelts:
    """How the moments of accelerating belts follow from the belts' speeds, step by step.

    The models' steps are 10 ms apart, one of them at ``first_s``, the time of the first frame. A
    model begins at constant speed, and again after a gap.
    """

    def __init__(self, models: Sequence[BeltModel], rate_hz: float, first_s: float = 0.0) -> None:
        self.models, self.first_s = models, first_s
        self.resampling = Convolution.between(rate_hz, MODEL_RATE_HZ)
        self.states = [model.at_rest for model in models]
        self.known = [0] * len(models)

    @property
    def ahead_s(self) -> float:
        """How much later than an instant the last sample is that it needs [s]."""
        to_step_s = self.resampling.step_s + self.resampling.reach_s
        between = Convolution.between(MODEL_RATE_HZ, MODEL_RATE_HZ)
        advance = max(model.advance for model in self.models)
        return to_step_s + advance / MODEL_RATE_HZ + between.reach_s + between.step_s

    def accelerations(self, time: Array, speeds: Array, steps: Array) -> Array:
        """Give the belts' accelerations at steps, (G,), from speeds, (N, P) [m/s]: (G, P) [m/s²].

        They are central differences over one sample, as of `compensation.belt_acceleration`; NaN
        where unknown.
        """
        at, half_s = self.first_s + steps / MODEL_RATE_HZ, self.resampling.step_s
        later, earlier = (self.resampling.evaluate(time, speeds, at + s) for s in (half_s, -half_s))
        return np.asarray((later - earlier) / (2 * half_s))

    def step(self, acceleration: Array) -> list[float]:
        """Give each belt's moment, as many steps ago as its model reads ahead [N·m], or NaN."""
        moments = []
        for k, model in enumerate(self.models):
            moment = np.nan
            if np.isnan(acceleration[k]):
                self.states[k], self.known[k] = model.at_rest, 0
            else:
                self.known[k] += 1
                if self.known[k] > model.advance:
                    moment, self.states[k] = model.step(float(acceleration[k]), self.states[k])
            moments.append(moment)
        return moments

    def moments(self, time: Array, speeds: Array, at: Sequence[Array]) -> list[Array]:
        """Give the moments of a whole trial at instants of each plate, (T,) [N·m] each.

        From speeds (N, P) [m/s], one column per plate, at times (N,). NaN where unknown.
        """
        first, last = ((t - self.first_s) * MODEL_RATE_HZ for t in (time[0], time[-1]))
        steps = np.arange(np.ceil(first), np.floor(last) + 1)
        accelerations = self.accelerations(time, speeds, steps)
        moments = np.array([self.step(each) for each in accelerations])
        found = []
        for model, own, instants in zip(self.models, moments.T, at, strict=True):
            step_times = self.first_s + (steps - model.advance) / MODEL_RATE_HZ
            found.append(between_steps(step_times, own[:, None], instants)[:, 0])
        return found


def between_steps(step_times: Array, moments: Array, at: Array) -> Array:
    """Give the belts' moments, (G, P) at steps of their models, at instants between: (T, P)."""
    return Convolution.between(MODEL_RATE_HZ, MODEL_RATE_HZ).evaluate(step_times, moments, at)


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
