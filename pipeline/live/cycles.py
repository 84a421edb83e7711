"""Gait cycles as they end, and the residuals of each beside their published limits."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.model import Body
from hbm.poses import center_of_mass
from hbm.spatial import Array
from pipeline.live.frame import LiveFrame, Quality
from pipeline.trial.gait.events import SIDES
from pipeline.trial.residuals import MAX_FORCE_SHARE, MAX_MOMENT_SHARE

MIN_SWING_S: Final = 0.1
"""A foot that is off the ground for less has not swung: its plate was loaded lightly."""
MAX_CYCLE_S: Final = 3.0
"""Longer ones are no gait cycles, or events in between were missed."""
KEPT: Final = 10
"""Gait cycles of the running RMS."""
UNKNOWN: Final = Quality.FORCES_UNKNOWN | Quality.PLATFORM_UNKNOWN


@dataclass(frozen=True, slots=True)
class LiveCycle:
    """A gait cycle that has ended.

    Attributes
    ----------
    side
        "left" or "right": whose foot strikes begin and end it.
    start_s, stop_s
        On the streams' clock [s]; forces are not late there, as residuals are.
    rms
        Variant -> RMS of the residuals of its frames that count, reported axes, (6,) [N, N·m].
    peak_force_n, peak_moment_nm
        Variant -> largest residual force and moment, of these frames.
    limit_force_n, limit_moment_nm
        5 % of the largest ground reaction force, and 1 % of it times the height of the centre of
        mass (Hicks et al. 2015, J Biomech Eng 137:020905).
    valid_share
        Of its frames, those that count.
    """

    side: str
    start_s: float
    stop_s: float
    rms: Mapping[str, Array]
    peak_force_n: Mapping[str, float]
    peak_moment_nm: Mapping[str, float]
    limit_force_n: float
    limit_moment_nm: float
    valid_share: float


class LiveCycles:
    """Finds gait cycles in the frames of a chain.

    Parameters
    ----------
    body
        The subject.
    min_valid_share
        Of a gait cycle's frames that have to count; with less it is left out.

    Attributes
    ----------
    last
        The last gait cycles of both feet, `KEPT` of them at most.
    """

    def __init__(self, body: Body, min_valid_share: float) -> None:
        self.body, self.min_valid_share = body, min_valid_share
        self.feet = [_Foot() for _ in SIDES]
        self.last: deque[LiveCycle] = deque(maxlen=KEPT)

    @property
    def running_rms(self) -> dict[str, Array]:
        """RMS over the last gait cycles of each variant, (6,) [N, N·m]; empty before the first."""
        if not self.last:
            return {}
        names = self.last[0].rms
        squares = {name: np.mean([c.rms[name] ** 2 for c in self.last], axis=0) for name in names}
        return {name: np.sqrt(square) for name, square in squares.items()}

    def step(self, frame: LiveFrame) -> list[LiveCycle]:
        """Take the next frame; give the gait cycles that it ends."""
        ended: list[LiveCycle] = []
        if frame.quality & UNKNOWN:
            self.feet = [_Foot() for _ in SIDES]
            return ended
        for side, foot, contact in zip(SIDES, self.feet, frame.contact, strict=True):
            if foot.strikes(frame.time, bool(contact)):
                cycle = self._cycle(side, foot, frame)
                if cycle is not None:
                    ended.append(cycle)
                foot.frames, foot.start_s = [], frame.time
            if foot.start_s is not None:
                foot.frames.append(frame)
                if frame.time - foot.start_s > MAX_CYCLE_S:
                    foot.frames, foot.start_s = [], None
        self.last.extend(ended)
        return ended

    def _cycle(self, side: str, foot: "_Foot", frame: LiveFrame) -> LiveCycle | None:
        """Summarise the frames from a foot's last strike to this one, if enough of them count."""
        counted = [each for each in foot.frames if each.quality.counts]
        share = len(counted) / max(len(foot.frames), 1)
        if foot.start_s is None or not counted or share < self.min_valid_share:
            return None
        best = list(frame.residual)[-1]
        ground = np.array([each.by_foot[best].sum(axis=0)[:3] for each in counted])
        external_n = float(np.linalg.norm(ground, axis=1).max())
        height_m = float(center_of_mass(self.body, counted[-1].q[None])[0, 2])
        values = {name: np.array([c.residual[name] for c in counted]) for name in frame.residual}
        return LiveCycle(
            side,
            foot.start_s,
            frame.time,
            {name: np.sqrt(np.mean(x**2, axis=0)) for name, x in values.items()},
            {name: _largest(x[:, :3]) for name, x in values.items()},
            {name: _largest(x[:, 3:]) for name, x in values.items()},
            MAX_FORCE_SHARE * external_n,
            MAX_MOMENT_SHARE * height_m * external_n,
            share,
        )


class _Foot:
    """One foot since its last strike."""

    def __init__(self) -> None:
        self.start_s: float | None = None
        self.frames: list[LiveFrame] = []
        self.off_since_s: float | None = None

    def strikes(self, time: float, contact: bool) -> bool:
        """Whether a foot that has swung strikes the ground in a frame."""
        off_since_s = self.off_since_s
        if not contact:
            self.off_since_s = time if off_since_s is None else off_since_s
            return False
        self.off_since_s = None
        return off_since_s is not None and time - off_since_s > MIN_SWING_S


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())
