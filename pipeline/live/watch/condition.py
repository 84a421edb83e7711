"""The residuals of a condition so far: root mean squares, peaks, published limits."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hbm.spatial import Array
from pipeline.live.watch.cycles import LiveCycle
from pipeline.trial.residuals import MAX_FORCE_SHARE, MAX_MOMENT_SHARE


@dataclass(frozen=True, slots=True)
class Limits:
    """Peak residuals beside their published limits (Hicks et al. 2015, J Biomech Eng 137:020905).

    Attributes
    ----------
    force_n, moment_nm
        Largest magnitude of the residual force and moment.
    max_force_n, max_moment_nm
        5 % of the largest ground reaction force, and 1 % of the height of the centre of mass times
        that force.
    """

    force_n: float
    moment_nm: float
    max_force_n: float
    max_moment_nm: float

    @property
    def kept(self) -> bool:
        """Whether both are below their limits."""
        return self.force_n < self.max_force_n and self.moment_nm < self.max_moment_nm


@dataclass(slots=True)
class ConditionSoFar:
    """Summarises the gait cycles of a condition as they end, in memory that does not grow.

    A frame that is in a cycle of either foot counts once; trials count the cycles of one foot.

    Attributes
    ----------
    min_valid_share
        Of a gait cycle's frames in which the plates carry the subject: with less it does not count.
    cycles
        Gait cycles that count, of both sides.
    not_carried
        Gait cycles that do not, since the plates carried the subject in less than
        ``min_valid_share`` of them.
    """

    min_valid_share: float
    cycles: int = 0
    not_carried: int = 0
    _counted_s: float = -np.inf
    _frames: int = 0
    _squares: dict[str, Array] = field(default_factory=dict)
    _peaks: dict[str, Array] = field(default_factory=dict)
    _ground_n: dict[str, float] = field(default_factory=dict)

    def add(self, cycle: LiveCycle) -> None:
        """Take a cycle that has ended."""
        if cycle.carried_share < self.min_valid_share:
            self.not_carried += 1
            return
        if not len(cycle.time):
            return
        self.cycles += 1
        new = cycle.time > self._counted_s
        self._counted_s = max(self._counted_s, float(cycle.time[-1]))
        self._frames += int(np.count_nonzero(new))
        for variant, residual in cycle.residual.items():
            sums = self._squares.setdefault(variant, np.zeros(6))
            sums += (residual[new] ** 2).sum(axis=0)
            size = np.linalg.norm(residual.reshape(-1, 2, 3), axis=2).max(axis=0)
            self._peaks[variant] = np.maximum(self._peaks.get(variant, np.zeros(2)), size)
            largest = max(self._ground_n.get(variant, 0.0), cycle.peak_ground_n[variant])
            self._ground_n[variant] = largest

    @property
    def rms(self) -> Mapping[str, Array]:
        """Variant -> root mean square over all frames of all cycles, (6,) [N, N·m]."""
        return {v: np.sqrt(sums / self._frames) for v, sums in self._squares.items()}

    def limits(self, center_of_mass_m: float) -> Mapping[str, Limits]:
        """Give the peaks beside their limits, by variant.

        Parameters
        ----------
        center_of_mass_m
            Height of the body's centre of mass above the feet (`height_of_mass`) [m].
        """
        return {
            variant: Limits(
                float(force),
                float(moment),
                MAX_FORCE_SHARE * self._ground_n[variant],
                MAX_MOMENT_SHARE * center_of_mass_m * self._ground_n[variant],
            )
            for variant, (force, moment) in self._peaks.items()
        }
