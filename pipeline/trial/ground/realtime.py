"""The ground as it is known while a trial is measured: nothing of it waits for the trial's end.

Plates, accelerometers and belts are brought to the markers' times by a convolution of short reach
(`hbm.signals.convolution`) and nothing else: compensation is linear, so that the real-time filter
through which the difference passes afterwards does the same as one on plates and accelerometers
before. All of it takes whole trials and single frames alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation import BeltModel, Sensor
from hbm.signals.convolution import Convolution
from hbm.signals.samples import stretches
from hbm.spatial import Array
from pipeline.config.schema import Treadmill

MODEL_RATE_HZ: Final = 100.0
"""The belt model's rate: belts accelerate below 10 Hz."""


def in_real_time(time: Array, values: Array, at: Array) -> Array:
    """Bring a recorded signal to the markers' times as if it had been live.

    Parameters
    ----------
    time
        Sample times, (N,) [s].
    values
        Samples, (N, ...).
    at
        Wanted times, (T,) [s].

    Returns
    -------
    Array
        (T, ...); NaN where the samples around it are not all known.
    """
    resampling = Convolution.between(_rate_hz(time), _rate_hz(at))
    found = resampling.evaluate(time, values.reshape(len(time), -1), at)
    return found.reshape(len(at), *values.shape[1:])


@dataclass(frozen=True, slots=True)
class RealtimeAccelerometers:
    """How what accelerometers felt follows from their samples.

    Attributes
    ----------
    resampling
        From their clock to the frames'.
    delays_s
        How much later each sensor is than the plates [s].
    scale
        Reading by true acceleration of each channel, (k,).
    lags_s
        Of a dynamic model's differences [s].
    """

    resampling: Convolution
    delays_s: tuple[float, ...]
    scale: Array
    lags_s: tuple[float, ...] = ()

    @classmethod
    def of(
        cls,
        treadmill: Treadmill,
        sensors: Sequence[Sensor],
        lags_s: Sequence[float],
        rate_hz: float,
        frames_hz: float,
    ) -> "RealtimeAccelerometers":
        """Give it for sensors as a calibration found them, or as stated where it found none."""
        stated = [treadmill.accelerometer_delay_s or 0.0] * len(treadmill.accelerometers)
        resampling = Convolution.between(rate_hz, frames_hz)
        samples = [max(round(lag_s / resampling.step_s), 1) for lag_s in lags_s]
        return cls(
            resampling,
            tuple(s.correction_s for s in sensors) or tuple(stated),
            np.repeat([s.scale for s in sensors] or np.ones(len(stated)), 3),
            tuple(count * resampling.step_s for count in samples),
        )

    @property
    def ahead_s(self) -> float:
        """How much later than an instant the last sample is that it needs [s]."""
        return max(self.delays_s) + max(self.lags_s, default=0.0) + self.resampling.reach_s

    @property
    def behind_s(self) -> float:
        """How much earlier than an instant the first sample is that it needs [s]."""
        return max(self.lags_s, default=0.0) + self.resampling.reach_s - min(self.delays_s)

    def felt(self, time: Array, readings: Array, at: Array) -> Array:
        """Give what they felt, as an inertia model takes it.

        Parameters
        ----------
        time
            Sample times, (N,) [s].
        readings
            Three columns per sensor, (N, k) [m/s²].
        at
            Instants on the plates' clock, (T,) [s].

        Returns
        -------
        Array
            (T, k (1 + lags)) [m/s²]; NaN where unknown.
        """
        now = self._readings(time, readings, at)
        kinds = [now]
        for lag_s in self.lags_s:
            later, earlier = (self._readings(time, readings, at + s) for s in (lag_s, -lag_s))
            kinds.append(later - 2 * now + earlier)
        return np.hstack(kinds) if self.lags_s else now

    def _readings(self, time: Array, readings: Array, at: Array) -> Array:
        evaluate, delays_s = self.resampling.evaluate, self.delays_s
        if len(set(delays_s)) == 1:
            found = evaluate(time, readings, at + delays_s[0])
        else:
            each = [
                evaluate(time, readings[:, 3 * k : 3 * k + 3], at + delay_s)
                for k, delay_s in enumerate(delays_s)
            ]
            found = np.concatenate(each, axis=1)
        return np.asarray(found / self.scale)


@dataclass(frozen=True, slots=True)
class RealtimeBelts:
    """How the moments of accelerating belts follow from the belts' speeds.

    Attributes
    ----------
    models
        Of each plate's belt.
    first_s
        A time of the models' steps: that of the first frame [s].
    resampling
        From the speeds' clock to the models' steps.
    """

    models: Sequence[BeltModel]
    first_s: float
    resampling: Convolution

    @classmethod
    def of(cls, models: Sequence[BeltModel], rate_hz: float, first_s: float) -> "RealtimeBelts":
        """Give it for speeds sampled at a rate [Hz]."""
        return cls(models, first_s, Convolution.between(rate_hz, MODEL_RATE_HZ))

    @property
    def advance(self) -> int:
        """Steps by which the model that reads farthest ahead does so."""
        return max(model.advance for model in self.models)

    @property
    def ahead_s(self) -> float:
        """How much later than an instant the last sample is that it needs [s]."""
        to_step_s = self.resampling.step_s + self.resampling.reach_s
        between = Convolution.between(MODEL_RATE_HZ, MODEL_RATE_HZ)
        return to_step_s + self.advance / MODEL_RATE_HZ + between.reach_s + between.step_s

    def accelerations(self, time: Array, speeds: Array, steps: Array) -> Array:
        """Give the belts' accelerations at steps of the models.

        Parameters
        ----------
        time
            Sample times, (N,) [s].
        speeds
            One column per plate, (N, P) [m/s].
        steps
            Numbers of the steps from that of the first frame, (G,).

        Returns
        -------
        Array
            (G, P) [m/s²]: central differences over one sample, as of
            `compensation.belt_acceleration`; NaN where unknown.
        """
        at, half_s = self.first_s + steps / MODEL_RATE_HZ, self.resampling.step_s
        later, earlier = (self.resampling.evaluate(time, speeds, at + s) for s in (half_s, -half_s))
        return np.asarray((later - earlier) / (2 * half_s))

    def moments(self, time: Array, speeds: Array, at: Sequence[Array]) -> list[Array]:
        """Give the moments of a whole trial.

        Parameters
        ----------
        time
            Sample times, (N,) [s].
        speeds
            One column per plate, (N, P) [m/s].
        at
            Per plate the wanted instants, (T,) [s].

        Returns
        -------
        list of Array
            Per plate, (T,) [N·m]; NaN where unknown. A model begins at constant speed.
        """
        first, last = ((t - self.first_s) * MODEL_RATE_HZ for t in (time[0], time[-1]))
        steps = np.arange(np.ceil(first), np.floor(last) + 1)
        acceleration = self.accelerations(time, speeds, steps)
        step_times, found = self.first_s + steps / MODEL_RATE_HZ, []
        for model, own, instants in zip(self.models, acceleration.T, at, strict=True):
            moment = np.full(len(own), np.nan)
            for start, stop in stretches(np.isfinite(own)):
                if stop - start > model.advance:
                    predicted = model.predict(own[start:stop])
                    moment[start : stop - model.advance] = predicted[: stop - start - model.advance]
            found.append(between_steps(step_times, moment[:, None], instants)[:, 0])
        return found


def between_steps(step_times: Array, moments: Array, at: Array) -> Array:
    """Give the belts' moments, (G, P) at steps of their models, at instants between: (T, P)."""
    return Convolution.between(MODEL_RATE_HZ, MODEL_RATE_HZ).evaluate(step_times, moments, at)


def _rate_hz(time: Array) -> float:
    return (len(time) - 1) / float(time[-1] - time[0])
