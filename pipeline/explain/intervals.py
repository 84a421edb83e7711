"""Intervals of measurement of a trial's residuals: over cycles, over time, and by Monte Carlo."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from hbm.dynamics import Dynamics
from hbm.spatial import Array, Indices
from pipeline.explain.budget import Bands, CauseUncertainty, CycleRms, Drawn, RmsUncertainty
from pipeline.explain.cause import Cause
from pipeline.explain.processing_chain import ProcessingChain
from pipeline.explain.shares import NORMAL_95
from pipeline.explain.uncertainty import (
    draw_residuals,
    noise_of_samples,
    rms_uncertainty,
    samples_in_a_frame,
    shared_sizes,
)
from pipeline.trial.residuals import counted, reported
from pipeline.trial.result import TrialResult

DRAWS: Final = 1000
"""Of what trials share: a standard deviation is then sure to 2 %."""
DECIMALS: Final = 3
"""Of draws of an RMS [N, N·m]."""
TAILS: Final = (2.5, 97.5)
"""Percentiles between which 95 % are."""


class Intervals:
    """How sure the residuals of a trial are, from the effects of causes of usual size.

    Parameters
    ----------
    chain
        The trial.
    causes
        What may be wrong with it.
    effects
        What each adds to the residual as it was measured, per unit, (K, T, 6).
    cycles
        Frames of each gait cycle that are explained.
    subject, trial
        Names of them: what trials share is drawn alike in all of them.
    """

    def __init__(
        self,
        chain: ProcessingChain,
        causes: Sequence[Cause],
        effects: Array,
        cycles: Sequence[Indices],
        subject: str = "",
        trial: str = "",
    ) -> None:
        self._chain, self._causes, self._cycles = chain, causes, cycles
        self._usual = np.array([cause.prior.size for cause in causes])[:, None, None] * effects
        self._noise = noise_of_samples(chain)
        self._frames = np.concatenate(cycles)
        self._samples = samples_in_a_frame(chain)
        self._sizes = shared_sizes(causes, subject, trial, DRAWS)

    def bands(self) -> Bands:
        """Give the residuals over time."""
        number = np.repeat(np.arange(len(self._cycles)), [len(own) for own in self._cycles])
        usual = self._usual[:, self._frames]
        return Bands(
            time=self._chain.time[self._frames],
            cycle=number,
            residual=reported(self._chain.residual[self._frames]),
            deviation=np.sqrt((usual**2).sum(axis=0) + self._noise**2),
        )

    def of_trial(self, result: TrialResult) -> tuple[RmsUncertainty, ...]:
        """Give how sure the RMS over all cycles is: as measured, and compensated where it is."""
        return self._over(self._frames, result)

    def of_window(self, result: TrialResult) -> tuple[RmsUncertainty, ...]:
        """Give the same over the part of the cycles that the condition asks for, if it does."""
        if result.part is None:
            return ()
        first = _first(result.motion.time, self._chain.time)
        wanted = self._frames[counted(result)[first + self._frames]]
        return self._over(wanted, result) if len(wanted) else ()

    def _over(self, frames: Indices, result: TrialResult) -> tuple[RmsUncertainty, ...]:
        """Give how sure the RMS over some frames is: as measured, and compensated where it is."""
        if result.compensated is None:
            return (self._of(frames, self._chain.residual, compensated=False),)
        measured = self._of(frames, _at(self._chain.time, result.measured), compensated=False)
        return measured, self._of(frames, self._chain.residual, compensated=True)

    def _of(self, frames: Indices, residual: Array, *, compensated: bool) -> RmsUncertainty:
        """Give how sure an RMS is; without compensation, it adds nothing."""
        own = [k for k, c in enumerate(self._causes) if compensated or c.group != "compensation"]
        sizes = self._sizes[:, [*own, -1]]
        found = rms_uncertainty(
            residual[frames], self._usual[own][:, frames], self._noise, self._samples, sizes
        )
        causes = tuple(
            CauseUncertainty(self._causes[k].name, self._causes[k].group, change, square)
            for k, change, square in zip(own, found.changes, found.squares, strict=True)
        )
        return RmsUncertainty(
            compensated=compensated,
            rms=found.rms,
            mean=found.mean,
            deviation=found.deviation,
            of_noise=found.of_noise,
            causes=causes,
            draws=found.draws.round(DECIMALS),
        )

    def of_cycles(self) -> tuple[CycleRms, ...]:
        """Give the RMS over each cycle."""
        time, residual = self._chain.time, self._chain.residual
        result = []
        for own in self._cycles:
            found = rms_uncertainty(residual[own], self._usual[:, own], self._noise, self._samples)
            low, high = interval(found.rms, found.deviation)
            start, stop = float(time[own[0]]), float(time[own[-1]])
            result.append(CycleRms(start, stop, found.rms, low, high))
        return tuple(result)

    def drawn(self, draws: int) -> Drawn:
        """Draw the RMS over all cycles, through the whole chain."""
        found = np.array(
            [
                np.sqrt((residual[self._frames] ** 2).mean(axis=0))
                for residual in draw_residuals(self._chain, self._causes, draws)
            ]
        )
        low, high = np.percentile(found, TAILS, axis=0)
        return Drawn(draws, found.mean(axis=0), found.std(axis=0, ddof=1), low, high)


def interval(rms: Array, deviation: Array) -> tuple[Array, Array]:
    """Give the ends of a 95 % interval of an RMS, which is not negative."""
    return np.maximum(rms - NORMAL_95 * deviation, 0.0), rms + NORMAL_95 * deviation


def _at(time: Array, dynamics: Dynamics) -> Array:
    """Give the residual at some frames of a trial, (T, 6)."""
    first = _first(dynamics.time, time)
    return dynamics.residual[first : first + len(time)]


def _first(whole: Array, part: Array) -> int:
    """Give the frame of a trial at which a part of it begins."""
    return int(np.searchsorted(whole, part[0]))
