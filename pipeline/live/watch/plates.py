"""Plates that drift, that are not zero without load, or that are saturated."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.trial.checks import COMPONENTS, MAX_REST_N, MAX_REST_SHARE, REST_SPREAD_N
from pipeline.trial.subject import TENTH_S

KEPT_S: Final = 300.0
"""Over which drift is looked for."""
JUDGED_S: Final = 10.0
"""Between judgements."""
MIN_SPAN_S: Final = 60.0
"""From the first to the last time without load, so that a slope is of the plate, not of a step."""
MIN_RESTS: Final = 20
"""Tenths of a second without load."""
MIN_DRIFT: Final = 1.0
"""[N/min]: 10 N, a fault, within ten minutes."""
SURE: Final = 3.0
"""Standard errors from zero."""
EXTREME: Final = (100.0, 100.0, 300.0, 20.0, 20.0, 20.0)
"""From here on a component that stays exactly at its extreme is saturated, not at rest [N, N·m]."""
SATURATED_SAMPLES: Final = 5
SATURATED_STEPS: Final = 3
SMALLER: Final = 0.9
"""Of the extreme, between two steps."""


class PlateWatch:
    """Notes what is wrong with one plate.

    Parameters
    ----------
    number
        The plate's.
    mass_kg
        Body mass: what is below a tenth of the weight is no step.
    up
        1 where its z axis points up, -1 where it points down.
    moves
        Whether it is on a platform that moves: what it reads without load is then the platform's
        inertia and weight, and neither drift nor an offset.

    Notes
    -----
    A tenth of a second in which the vertical force is steady and below a tenth of the body weight
    is without load. The slope of their means over the last five minutes is the drift; it is noted
    once it is more than 1 N/min and three standard errors, and a mean of the last ten tenths of
    more than 10 N is noted as not zeroed. Each is noted once a minute at most.
    """

    def __init__(
        self, number: int, mass_kg: float, up: float = 1.0, *, moves: bool = False
    ) -> None:
        self._number, self._max_rest_n = number, MAX_REST_SHARE * mass_kg * GRAVITY_MPS2
        self._up, self._moves = up, moves
        self._rests: deque[tuple[float, float]] = deque()
        self._block: list[tuple[float, float]] = []
        self._judged_s = -np.inf
        self._noted_s: dict[str, float] = {}
        self._extremes = [_Extreme(*each) for each in zip(COMPONENTS, EXTREME, strict=True)]
        self._saturated: set[str] = set()

    def add(self, time: Array, wrench: Array) -> tuple[Note, ...]:
        """Take samples, (N,) [s] and (N, 6) in the plate's axes; give what they show."""
        notes = list(self._saturation(wrench))
        for now, force in zip(time.tolist(), (self._up * wrench[:, 2]).tolist(), strict=True):
            if self._block and now - self._block[0][0] >= TENTH_S:
                self._rest(np.array(self._block))
                self._block.clear()
            self._block.append((now, force))
        if len(time) and time[-1] - self._judged_s >= JUDGED_S:
            self._judged_s = float(time[-1])
            notes += self._judge()
        return tuple(notes)

    def _rest(self, block: Array) -> None:
        """Keep the mean of a tenth of a second without load."""
        force = block[:, 1]
        if not np.isfinite(force).all():
            return
        if abs(force.mean()) < self._max_rest_n and force.std() < REST_SPREAD_N:
            self._rests.append((float(block[0, 0]), float(force.mean())))
            while self._rests[-1][0] - self._rests[0][0] > KEPT_S:
                self._rests.popleft()

    def _judge(self) -> list[Note]:
        if self._moves or len(self._rests) < MIN_RESTS:
            return []
        time, force = np.array(self._rests).T
        rest_n = float(np.median(force[-MIN_RESTS // 2 :]))
        notes = []
        if abs(rest_n) > MAX_REST_N and self._may_note("rest"):
            notes.append(Note.of("live_plate_not_zero", plate=self._number, rest_n=rest_n))
        if time[-1] - time[0] < MIN_SPAN_S:
            return notes
        minutes = (time - time.mean()) / 60
        slope = float(minutes @ force / (minutes @ minutes))
        left = force - force.mean() - slope * minutes
        error = float(np.sqrt(left @ left / (len(time) - 2) / (minutes @ minutes)))
        if abs(slope) > max(MIN_DRIFT, SURE * error) and self._may_note("drift"):
            notes.append(Note.of("live_plate_drifts", plate=self._number, drift_n_per_min=slope))
        return notes

    def _may_note(self, what: str) -> bool:
        if self._judged_s - self._noted_s.get(what, -np.inf) < 60:
            return False
        self._noted_s[what] = self._judged_s
        return True

    def _saturation(self, wrench: Array) -> Iterator[Note]:
        """Find components that stay exactly at their largest value in several steps."""
        for extreme, values in zip(self._extremes, np.abs(wrench).T.tolist(), strict=True):
            for value in values:
                extreme.add(value)
            if extreme.is_limit and extreme.name not in self._saturated:
                self._saturated.add(extreme.name)
                yield Note.of(
                    "live_plate_saturated",
                    plate=self._number,
                    component=extreme.name,
                    value=extreme.value,
                )


@dataclass(slots=True)
class _Extreme:
    """The largest magnitude of a component so far, and how often it stayed exactly there.

    A subject who stands may repeat a value too, so only runs of samples count between which the
    component was clearly smaller: steps that all end at the same limit.
    """

    name: str
    noted_from: float
    value: float = 0.0
    _run: int = 0
    _runs: int = 0
    _was_smaller: bool = True

    def add(self, value: float) -> None:
        """Take a sample's magnitude."""
        if value > self.value:
            self.value, self._run, self._runs, self._was_smaller = value, 0, 0, True
        if value < self.value:
            self._run = 0
            self._was_smaller |= value < SMALLER * self.value
            return
        self._run += 1
        if self._run == SATURATED_SAMPLES and self._was_smaller:
            self._runs, self._was_smaller = self._runs + 1, False

    @property
    def is_limit(self) -> bool:
        """Whether it is the largest value that the plate can show."""
        return self.value >= self.noted_from and self._runs >= SATURATED_STEPS
