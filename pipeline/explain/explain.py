"""Why a trial's residuals are as large as they are: the causes, their sizes and their shares."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, Mask
from pipeline.explain.budget import Budget, EstimatedCause, GroupShare
from pipeline.explain.cause import OF_PERSON, Cause
from pipeline.explain.causes.body import body_causes, soft_tissue_causes
from pipeline.explain.causes.markers import marker_causes
from pipeline.explain.causes.plates import KnownPlates, known_plates, plate_causes
from pipeline.explain.causes.treadmill import compensation_causes, platform_causes
from pipeline.explain.processing_chain import ProcessingChain, processing_chain
from pipeline.explain.shares import NORMAL_95, indistinct, shares_of_groups
from pipeline.explain.sizes import (
    CycleSeries,
    Posterior,
    cycle_series,
    linearised,
    rms,
    sizes_from_cycles,
)
from pipeline.explain.uncertainty import Intervals, interval
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.quality import settling_s
from pipeline.trial.residuals import windows
from pipeline.trial.result import TrialResult

MAX_FRAMES: Final = 6000
"""Of a long trial, a minute of which tells as much."""
MIN_CYCLES: Final = 4
"""For telling what repeats from what does not, and for judging half of them by the others; of fewer
one half of the frames judges the other."""
HIGHEST_IN_CUTOFFS: Final = 1.1
"""Frequency up to which sizes are estimated, in cut-offs of the filter: above it soft tissue
oscillates in ways that no cause describes well, and delays would be taken for them."""


TRANSPARENT: Final = 4.0
"""Cut-off that passes nearly all of a motion, in cut-offs of the trial: at 6 Hz, 24 Hz."""
HIGHEST: Final = 0.3
"""Of the frame rate: a filter's cut-off has to stay well below half of it."""


def explain_trial(recording: Recording, laboratory: Laboratory, result: TrialResult) -> Budget:
    """Find what the residuals of a trial are made of.

    Parameters
    ----------
    recording
        The trial as read.
    laboratory
        The treadmill and its calibrations, as when it was processed.
    result
        The processed trial.

    Returns
    -------
    Budget
        Of the compensated residuals where there are some.

    Raises
    ------
    ValueError
        If no frame of the trial counts.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.config.schema import Treadmill
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=12.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> budget = explain_trial(walk, Laboratory(Treadmill()), result)
    >>> whole = sum(group.share for group in budget.groups) + budget.unexplained
    >>> whole.round(6).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    part = explained_part(recording, laboratory, result)
    chain, causes, series, counts = part.chain, part.causes, part.series, part.counts
    left = left_by_filter(chain)
    linear = linearised(chain, causes, left, series)

    residual, effects = chain.residual[counts], linear.effects[:, counts]
    whole = rms(residual)
    names = result.subject.id, result.source.name
    intervals = Intervals(chain, causes, linear.as_measured, series.frames, *names)
    uncertain = intervals.of_trial(result)
    low, high = interval(whole, uncertain[-1].deviation)
    groups, unexplained = _shares(linear.posterior, causes, residual, effects, left[counts])
    without = [
        rms(residual - size * effect)
        for size, effect in zip(linear.posterior.size, effects, strict=True)
    ]
    estimated = [
        EstimatedCause(
            name=cause.name,
            group=cause.group,
            unit=cause.prior.unit,
            size=float(size),
            deviation=float(deviation),
            usual=cause.prior.size,
            left=own,
        )
        for cause, size, deviation, own in zip(
            causes, linear.posterior.size, linear.posterior.deviation, without, strict=True
        )
    ]
    return Budget(
        source=result.source,
        compensated=result.compensated is not None,
        rms=whole,
        low=low,
        high=high,
        cycles=len(series) if part.found_cycles else 0,
        found_cycles=part.found_cycles,
        groups=groups,
        unexplained=unexplained,
        causes=tuple(sorted(estimated, key=lambda each: float((each.left / whole).min()))),
        held_out=_held_out(chain.residual - left, linear.effects, causes, part.halves),
        notes=tuple(_notes(part)),
        uncertainty=uncertain,
        of_window=intervals.of_window(result),
        of_cycles=intervals.of_cycles(),
        bands=intervals.bands(),
    )


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
        Its gait cycles; a single stretch where there are none.
    found_cycles
        How many cycles there are; 0 for a stretch of the recording.
    to_hz
        Frequency up to which sizes are estimated [Hz].
    """

    chain: ProcessingChain
    causes: tuple[Cause, ...]
    series: CycleSeries
    found_cycles: int
    to_hz: float

    @property
    def counts(self) -> Mask:
        """Frames that are explained, (T,)."""
        result = np.zeros(len(self.chain.time), bool)
        for cycle in self.series.frames:
            result[cycle] = True
        return result

    @property
    def halves(self) -> tuple[CycleSeries, CycleSeries]:
        """Both halves of the cycles; of fewer than four, of the frames of each."""
        if len(self.series) >= MIN_CYCLES:
            middle = len(self.series) // 2
            return self.series.some(slice(middle)), self.series.some(slice(middle, None))
        time, counts = self.chain.time, self.counts
        bounds = [time[[own[0], own[len(own) // 2], own[-1]]] for own in self.series.frames]
        first, second = (
            cycle_series(time, [(own[half], own[half + 1]) for own in bounds], self.to_hz, counts)
            for half in (0, 1)
        )
        return first, second


def explained_part(
    recording: Recording, laboratory: Laboratory, result: TrialResult
) -> ExplainedPart:
    """Give the part of a trial that is explained; parameters and errors as for `explain_trial`."""
    spans, found = _spans(result)
    frames = _frames(spans, result, laboratory)
    chain = processing_chain(recording, laboratory, result, frames)
    inside = (spans[:, 0] >= chain.time[0]) & (spans[:, 1] <= chain.time[-1])
    to_hz = HIGHEST_IN_CUTOFFS * chain.settings.cutoff_hz
    series = cycle_series(chain.time, spans[inside], to_hz, result.counts[frames])
    known = known_plates(chain, laboratory)
    causes = (
        *plate_causes(chain, known, None if known.delay_is_measured else _delay(result, known)),
        *platform_causes(chain, laboratory.treadmill.platform),
        *compensation_causes(chain),
        *body_causes(chain),
        *marker_causes(chain, spans[inside]),
        *soft_tissue_causes(chain),
    )
    return ExplainedPart(chain, causes, series, found, to_hz)


def left_by_filter(chain: ProcessingChain) -> Array:
    """Compute what the filter leaves in the residual, (T, 6) [N, N·m].

    The equations of motion multiply coordinates with each other and forces with positions, and the
    product of filtered signals is not the filtered product. The residual of signals that hardly
    pass a filter, itself passed through the filter of the trial, has no such part; it is what a
    filter leaves of all other causes. Lab axes about the pelvis origin.

    Parameters
    ----------
    chain
        The trial.

    Returns
    -------
    Array
        Residual of filtered signals less the filtered residual; zero where both are the same.
    """
    cutoff_hz = chain.settings.cutoff_hz
    rate_hz = (len(chain.time) - 1) / (chain.time[-1] - chain.time[0])
    higher_hz = min(TRANSPARENT * cutoff_hz, HIGHEST * rate_hz)
    if higher_hz <= cutoff_hz:
        return chain.residual * 0.0
    settings = chain.settings.model_copy(update={"cutoff_hz": higher_hz, "filter": "zero_phase"})
    return chain.residual - chain.low_pass(chain.changed(settings=settings).residual)


def _notes(part: ExplainedPart) -> Iterator[Note]:
    """Note what could not be told, and why."""
    cycles = part.series.frames
    if not part.found_cycles:
        step_s = float(np.median(np.diff(part.chain.time)))
        duration_s = step_s * sum(map(len, cycles))
        yield Note.of("explained_without_cycles", duration_s=duration_s)
    elif len(cycles) < MIN_CYCLES:
        yield Note.of("explained_few_cycles", cycles=len(cycles), wanted=MIN_CYCLES)


def _delay(result: TrialResult, known: KnownPlates) -> tuple[float, float]:
    """Give the plates' delay that the trial shows, or else the usual one; one deviation [s]."""
    if np.isfinite(result.delay_s):
        return result.delay_s, result.delay_uncertainty_s / NORMAL_95
    return known.delay.mean, known.delay.size


def _spans(result: TrialResult) -> tuple[Array, int]:
    """Give what is explained, (C, 2) [s], and how many gait cycles it is: 0 for other stretches.

    As in `pipeline.trial.residuals`, of the side with the most cycles.
    """
    time, counts = result.motion.time, result.counts
    cycles = () if result.span else max(result.cycles.values(), key=len, default=())
    spans = np.reshape(cycles if len(cycles) else windows(result)[0].spans, (-1, 2))
    some = [counts[(time >= start) & (time < stop)].any() for start, stop in spans]
    if not any(some):
        raise ValueError(
            f"{result.source.name}: no frame counts, so that nothing tells what its residuals are "
            "made of"
        )
    return spans[some], len(cycles)


def _frames(spans: Array, result: TrialResult, laboratory: Laboratory) -> slice:
    """Give the frames of as many cycles one after another as are explained, and around them."""
    time = result.motion.time
    before_s, after_s = settling_s(laboratory.filters(result.settings))
    longest_s = MAX_FRAMES * (time[-1] - time[0]) / (len(time) - 1)
    last = np.searchsorted(spans[:, 1], spans[:, 0] + longest_s, side="right")
    count = last - np.arange(len(spans))
    most = np.flatnonzero(count == count.max())
    first = most[len(most) // 2]
    start, stop = spans[first, 0] - before_s, spans[max(last[first], first + 1) - 1, 1] + after_s
    return slice(*np.searchsorted(time, (start, stop)))


def _shares(
    posterior: Posterior,
    causes: Sequence[Cause],
    residual: Array,
    effects: Array,
    left: Array,
) -> tuple[tuple[GroupShare, ...], Array]:
    """Give the shares of groups of causes and what the filter leaves, and what none describes."""
    names = list(dict.fromkeys(cause.group for cause in causes))
    members = [[k for k, c in enumerate(causes) if c.group == name] for name in names]
    # what the filter leaves is known: a cause of size one
    size = np.append(posterior.size, 1.0)
    covariance = np.pad(posterior.covariance, (0, 1))
    members.append([len(causes)])
    names.append("filter")
    every = np.concatenate([effects, left[None]])
    shares = shares_of_groups(residual, every, size, covariance, members)
    named: dict[str, list[int]] = {}
    for g, name in enumerate(names):
        named.setdefault("person" if name in OF_PERSON else name, []).append(g)
    together = indistinct(shares, list(named.values()))
    joined = shares.joined(together)
    groups = [
        GroupShare(tuple(names[g] for g in own), share, deviation)
        for own, share, deviation in zip(together, joined.share, joined.deviation, strict=True)
    ]
    return tuple(groups), shares.unexplained


def _held_out(
    residual: Array,
    effects: Array,
    causes: Sequence[Cause],
    halves: tuple[CycleSeries, CycleSeries],
) -> Array:
    """Give the share of one half's mean square that causes found in the other half take away."""
    before, after = np.zeros(6), np.zeros(6)
    for own, other in (halves, halves[::-1]):
        size = sizes_from_cycles(residual, effects, causes, own).size
        left = residual - np.tensordot(size, effects, 1)
        for frames in other.frames:
            before += (residual[frames] ** 2).sum(axis=0)
            after += (left[frames] ** 2).sum(axis=0)
    return np.asarray(1 - after / before)
