"""What accelerating belts add to their plates, as their speeds arrive."""

from collections.abc import Sequence

import numpy as np

from compensation import BeltModel
from hbm.spatial import Array
from pipeline.live.frames.buffer import SampleBuffer
from pipeline.live.frames.channels import Channels
from pipeline.trial.ground.belts import MODEL_RATE_HZ, RealtimeBelts, between_steps

KEPT_STEPS = 50
"""Of the models' output: half a second."""


class LiveBelts:
    """The belts' models, step by step.

    Parameters
    ----------
    models
        Of each plate's belt.
    speeds
        Channels of the speed of each plate's belt.
    first_s
        Time of the first frame [s].
    """

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
