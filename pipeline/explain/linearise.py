"""The part of a trial that is explained, its causes, and what each of them adds to the residual."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from compensation.inertia.sensors import QUANTILE_95
from hbm.numbers import read_numbers
from hbm.segments import SegmentOverride
from hbm.signals.samples import mean_rate_hz, stretches
from hbm.spatial import Array, Mask
from pipeline.explain.cause import Cause, corrected
from pipeline.explain.causes.body import body_causes, soft_tissue_causes
from pipeline.explain.causes.markers import marker_causes
from pipeline.explain.causes.plates import plate_causes
from pipeline.explain.causes.treadmill import compensation_causes, platform_causes
from pipeline.explain.series import CycleSeries, cycle_series, stretch_series
from pipeline.explain.sizes import FAULT, Evidence, Posterior, find_faults, with_others
from pipeline.io.recording import Recording
from pipeline.trial.chain import Chain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.inputs import Inputs
from pipeline.trial.quality import frames_within, settling_s
from pipeline.trial.result import TrialResult

LIMITS: Final = read_numbers("pipeline.explain", "thresholds.toml", "frames")
CYCLE_S: Final = 1.1
"""Of a gait cycle where none is known: what skin does takes so long."""
MIN_VARIANCE: Final = 1e-10
"""So that nothing is divided by zero."""


@dataclass(frozen=True, slots=True, eq=False)
class ExplainedPart:
    """The part of a trial whose residuals are explained, and the causes that may explain them.

    Attributes
    ----------
    chain
        Its frames, and those around them in which the filters settle.
    causes
        What may be wrong with it.
    series
        Its gait cycles, or all stretches of frames as one.
    found_cycles
        How many cycles there are; 0 where stretches are explained.
    """

    chain: Chain
    causes: tuple[Cause, ...]
    series: CycleSeries
    found_cycles: int

    @property
    def counts(self) -> Mask:
        """Frames that are explained, (T,)."""
        result = np.zeros(len(self.chain.time), bool)
        result[np.concatenate(self.series.frames)] = True
        return result

    @property
    def halves(self) -> tuple[CycleSeries, CycleSeries]:
        """Both halves of the cycles; of fewer than four or of stretches, of the frames of each."""
        if len(self.series) >= LIMITS.fewest_cycles:
            middle = len(self.series) // 2
            return self.series.some(slice(middle)), self.series.some(slice(middle, None))
        # too few cycles to be halved: the first and the last half of each stretch
        first, last = stretches(self.counts).T
        bounds = np.linspace(first, last, 3).astype(int)
        time, to_hz = self.chain.time, highest_hz(self.chain)
        return stretch_series(time, bounds[:2].T, to_hz), stretch_series(time, bounds[1:].T, to_hz)


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """The residual of a part of a trial, and what its causes add to it.

    Attributes
    ----------
    part
        Of the trial, with K causes.
    residual
        Without what the filter leaves, (T, 6) [N, N·m].
    effects
        What each cause adds per unit of its size, (K, T, 6).
    noise
        Root mean square of the noise of samples in each axis, (6,), of which differences between
        cycles tell where there are some.
    """

    part: ExplainedPart
    residual: Array
    effects: Array
    noise: Array | float

    @property
    def expected(self) -> tuple[Array, Array, Array]:
        """Mean and usual size of each cause, and the deviation of those found elsewhere, else 0."""
        mean, size, found_deviation = np.array([cause.expected for cause in self.part.causes]).T
        return mean, size, found_deviation

    def evidence(self, series: CycleSeries, subject: str = "", trial: str = "") -> Evidence:
        """Give what some gait cycles say of the causes.

        Around the sizes that are expected.

        What the model misses of a person changes with a slope or a push too, so that cycles that
        differ by them are no independent evidence. The causes that follow the platform vary over
        cycles in a few patterns, their principal components; the part of the residual in each of
        them is treated as the mean cycle is, with a size of its own of what no cause describes.
        What is left beside all patterns shows the variance between cycles. Coefficients of
        different frequencies and axes are independent given the causes: noise is coloured.
        """
        mean, prior, _ = self.expected
        around = self.residual - np.tensordot(mean, self.effects, 1)
        residual, effects = series.coefficients(around), series.coefficients(self.effects)
        follow, cycles = np.array([cause.of_platform for cause in self.part.causes]), len(residual)
        # the mean cycle, and what follows the platform about it
        repeated = effects.mean(axis=1)
        moving = (effects - repeated[:, None]) * follow[:, None, None, None]
        pattern = _patterns(moving[follow] * prior[follow, None, None, None], residual)
        along = np.tensordot(pattern, residual, 1)
        added = np.einsum("pc,kcbx->kpbx", pattern, moving)
        # the first pattern is constant, of length one: it gives √C times the mean over cycles
        added[:, 0] = np.sqrt(cycles) * repeated
        # what is left beside the patterns
        rest = np.tensordot(np.eye(cycles) - pattern.T @ pattern, residual, 1)
        # white noise spreads evenly over the coefficients; from two cycles on they show their own
        between = np.zeros_like(rest[0]) + np.square(self.noise) / len(rest[0])
        if cycles > 1:
            between = _by_frequency((rest**2).sum(axis=0) / max(cycles - len(pattern), 1))
        owner = {"trial": f"{trial}: ", "subject": f"{subject}: ", "laboratory": ""}
        causes = self.part.causes
        return Evidence(
            values=along.ravel(),
            noise=np.broadcast_to(between + MIN_VARIANCE, along.shape).ravel(),
            axis=np.broadcast_to(np.arange(6 * len(along)).reshape(-1, 1, 6), along.shape).ravel(),
            effects=prior[:, None] * added.reshape(len(prior), -1),
            names=tuple(owner[cause.within] + cause.name for cause in causes),
            levels=tuple(FAULT if cause.is_rare else cause.within for cause in causes),
            subject=subject,
        )

    def sizes(self, series: CycleSeries) -> Posterior:
        """Estimate the sizes of the causes from some gait cycles.

        Those whose size was found elsewhere keep it, and the others are as unsure as that makes
        them.
        """
        trial, (mean, prior, uncertainty) = self.evidence(series), self.expected
        posterior = with_others(trial, find_faults([trial]))
        # from usual sizes to units
        covariance = posterior.covariance * np.outer(prior, prior)
        if_there = posterior.if_there * prior
        # the others follow a size that was found elsewhere by their regression on it
        for k in np.flatnonzero(uncertainty):
            follow = uncertainty[k] * covariance[:, k] / covariance[k, k]
            covariance = covariance + np.outer(follow, follow)
            if_there[1] = np.hypot(if_there[1], follow)
        if_there[0] += mean
        size = posterior.size * prior + mean
        return replace(posterior, size=size, covariance=covariance, if_there=if_there)


def _patterns(moving: Array, residual: Array) -> Array:
    """Give how effects vary over cycles, as orthonormal rows after that of their mean, (P, C)."""
    cycles = len(residual)
    constant = np.full((1, cycles), cycles**-0.5)
    # by the residual's RMS, so that forces and moments count alike; a row for each cycle
    rms = np.sqrt(np.mean(residual**2, axis=(0, 1)) + MIN_VARIANCE)
    table = np.moveaxis(moving / rms, 1, 0).reshape(cycles, -1)
    if not table.any():
        return constant
    rows, sizes, _ = np.linalg.svd(table, full_matrices=False)
    # as few as have 99 % of what follows the platform; half of the cycles stay to show the noise
    explained = np.cumsum(sizes**2) / np.sum(sizes**2)
    count = min(int(np.searchsorted(explained, 0.99)) + 1, 10)
    return np.vstack([constant, rows[:, : min(count, (cycles - 1) // 2)].T])


def _by_frequency(variance: Array) -> Array:
    """Take the mean of sine's and cosine's variance, (B, 6)."""
    # the phase of noise is arbitrary: both have one variance at each frequency
    of_both = variance[1:].reshape(-1, 2, variance.shape[1]).mean(axis=1)
    return np.vstack([variance[:1], np.repeat(of_both, 2, axis=0)])


def result_chain(recording: Recording, laboratory: Laboratory, result: TrialResult) -> Chain:
    """Give the chain of a processed trial: its recording as read, with the body that it had."""
    segments = {name: SegmentOverride() for name in result.overridden_segments}
    inputs = Inputs(
        recording=recording, subject=result.subject, laboratory=laboratory, segments=segments
    )
    return Chain(inputs, result.settings).changed(body=result.body)


def explained_part(
    recording: Recording, laboratory: Laboratory, result: TrialResult
) -> ExplainedPart:
    """Give the part of a trial that is explained.

    Parameters and errors are those of `pipeline.explain.explain.explain_trial`. The cycles are
    those of the side with the most; without any, or where plates carry only steps of them, all
    stretches of frames that count are explained.
    """
    time, counts = result.motion.time, result.counts
    cycles = np.reshape(max(result.cycles.values(), key=len, default=()), (-1, 2))
    inside = frames_within(time, cycles)
    by_cycles = not result.span and len(cycles) and np.mean(counts[inside]) >= LIMITS.counting
    spans = cycles if by_cycles else _stretches(result)
    spans = spans[[counts[(time >= start) & (time < stop)].any() for start, stop in spans]]
    if not len(spans):
        raise ValueError(
            f"{result.source.name}: no stretch of used frames of {LIMITS.shortest_stretch:g} s, so "
            "that causes of its residuals cannot be estimated"
        )
    frames = _frames(spans, result, laboratory)
    chain = result_chain(recording, laboratory, result).of_frames(frames)
    spans = spans[(spans[:, 0] >= chain.time[0]) & (spans[:, 1] <= chain.time[-1])]
    # skin moves with the gait cycle even where stretches are explained
    phases = spans if by_cycles or result.span else cycles
    if not len(phases):
        phases = np.array([[spans[0, 0], spans[0, 0] + CYCLE_S]])
    causes = (
        *plate_causes(chain, (result.delay_s, result.delay_uncertainty_s / QUANTILE_95)),
        *platform_causes(chain),
        *compensation_causes(chain),
        *body_causes(chain),
        *marker_causes(chain, phases),
        *soft_tissue_causes(chain),
    )
    if by_cycles:
        series = cycle_series(chain.time, spans, highest_hz(chain), counts[frames])
        return ExplainedPart(chain, causes, series, len(cycles))
    bounds = np.searchsorted(chain.time, spans)
    return ExplainedPart(chain, causes, stretch_series(chain.time, bounds, highest_hz(chain)), 0)


def _stretches(result: TrialResult) -> Array:
    """Give the stretches of frames that count, as long as they tell more, (N, 2) [s]."""
    time, spans, remaining_s = result.motion.time, [], LIMITS.longest_stretches
    counts = result.counted if result.span else result.counts
    for first, after in stretches(counts):
        start, stop = time[first], min(time[after - 1], time[first] + remaining_s)
        if stop - start >= LIMITS.shortest_stretch:
            spans.append((start, stop))
            remaining_s -= stop - start
    return np.reshape(spans, (-1, 2))


def highest_hz(chain: Chain) -> float:
    """Give the frequency up to which sizes are estimated [Hz]."""
    # higher, soft tissue oscillates as no cause describes well, and delays would be taken for it
    return 1.1 * chain.settings.cutoff_hz


def _frames(spans: Array, result: TrialResult, laboratory: Laboratory) -> slice:
    """Give the frames of as many cycles one after another as are explained, and around them."""
    time = result.motion.time
    before_s, after_s = settling_s(laboratory.filters(result.settings))
    # 6,000 frames at most, a minute at 100 Hz, which tell as much as all
    longest_s = 6000 / mean_rate_hz(time)
    last = np.searchsorted(spans[:, 1], spans[:, 0] + longest_s, side="right")
    # the middle one of the runs with the most cycles
    count = last - np.arange(len(spans))
    most = np.flatnonzero(count == count.max())
    first = most[len(most) // 2]
    start, stop = spans[first, 0] - before_s, spans[max(last[first], first + 1) - 1, 1] + after_s
    return slice(*np.searchsorted(time, (start, stop)))


def left_by_filter(chain: Chain) -> Array:
    """Compute what the filter leaves in the residual, (T, 6) [N, N·m].

    The equations of motion multiply coordinates with each other and forces with positions, and the
    product of filtered signals is not the filtered product. The residual of signals that hardly
    pass a filter, itself passed through the filter of the trial, has no such part; it is what a
    filter leaves of all other causes. Lab axes about the pelvis origin; zero where both are the
    same.
    """
    cutoff_hz = chain.settings.cutoff_hz
    # 24 Hz instead of 6 pass nearly all of a motion; filters need cut-offs well below half the rate
    higher_hz = min(4.0 * cutoff_hz, 0.3 * mean_rate_hz(chain.time))
    if higher_hz <= cutoff_hz:
        return chain.residual * 0.0
    settings = chain.settings.model_copy(update={"cutoff_hz": higher_hz, "filter": "zero_phase"})
    return chain.residual - chain.low_pass(chain.changed(settings=settings).residual)


def linearised(
    part: ExplainedPart, filtered_out: Array, noise: Array | float = 0.0
) -> tuple[Array, Linearised, Posterior]:
    """Estimate the sizes of causes, again around the sizes found until that changes nothing.

    Parameters
    ----------
    part
        The part of a trial, and what may be wrong with it.
    filtered_out
        What the filter leaves, (T, 6), which needs no cause.
    noise
        Of samples, in each axis, (6,).

    Returns
    -------
    as_measured
        What each cause adds per unit to the trial as it was measured, (K, T, 6).
    model
        The residual, and the same where the causes explain the trial.
    posterior
        Sizes of the causes.
    """
    chain, causes = part.chain, part.causes
    frames, rounds = np.concatenate(part.series.frames), list[Array]()
    without, size, before = chain, np.zeros(len(causes)), rms(chain.residual[frames])
    for _ in range(3):
        measured = without.residual - filtered_out  # first: chains with effects keep its steps
        effects = np.nan_to_num([cause.effect(without) for cause in causes])
        rounds.append(effects)
        # sizes are of the trial as measured: what was taken away is put back, to first order
        model = Linearised(part, measured + np.tensordot(size, effects, 1), effects, noise)
        posterior = model.sizes(part.series)
        size = posterior.size
        expected = model.residual - np.tensordot(size, effects, 1)
        without = corrected(chain, causes, size)
        # linear enough: all causes together do what the sum of their effects does, but for 5 %
        missed = rms((without.residual - filtered_out - expected)[frames])
        if (missed < 0.05 * before).all():
            break
    return rounds[0], replace(model, residual=chain.residual - filtered_out), posterior


def rms(residual: Array) -> Array:
    """Give the root mean square of each axis, (T, 6) to (6,)."""
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))
