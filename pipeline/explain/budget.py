"""What a trial's residuals are made of: types only."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator

from compensation.inertia.sensors import QUANTILE_95
from hbm.numbers import read_numbers
from hbm.spatial import Array, Indices, read_only
from pipeline.explain.sizes import Evidence, Stored
from pipeline.trial.residuals import AXES
from pipeline.trial.result import StoredNote


def _by_axis(values: Array) -> dict[str, list[float] | float]:
    """Name numbers by their axes, of which there is one of each or one per draw."""
    return {axis: values[..., k].tolist() for k, axis in enumerate(AXES)}


def _of_axes(stored: object) -> Array:
    """Read numbers by axis; null is unknown."""
    if isinstance(stored, Mapping):
        if tuple(stored) != AXES:
            raise ValueError(f"expected numbers by axis, {', '.join(AXES)}")
        stored = np.transpose(np.array(list(stored.values()), float))
    return read_only(np.array(stored, float))


ByAxis = Annotated[Array, PlainValidator(_of_axes), PlainSerializer(_by_axis)]
"""Numbers of the six axes, (6,), or of N draws, (N, 6); in JSON they are named."""
LIMITS: Final = read_numbers("pipeline.explain", "thresholds.toml", "cause")


@dataclass(frozen=True, slots=True)
class EstimatedCause:
    """A cause with its size.

    Attributes
    ----------
    name, group, unit
        See `pipeline.explain.cause.Cause`.
    size, deviation
        Its size if it is there, and one standard deviation of it.
    usual
        One standard deviation as published.
    chance
        That it is there, where that is as likely as not before the trial is looked at: of faults,
        which are rare; 1 of what is usually there.
    left
        RMS of each residual without it, (6,) [N, N·m].
    in_lab
        What the component of a plate is in the lab, such as "pitch moment"; empty of other causes.
    """

    name: str
    group: str
    unit: str
    size: float
    deviation: float
    usual: float
    chance: float
    left: ByAxis
    in_lab: str = ""

    @property
    def directed(self) -> str:
        """Its direction in the lab in brackets, to follow its name; empty where it has none."""
        return f" ({self.in_lab} in the lab)" if self.in_lab else ""

    @property
    def fault(self) -> str:
        """Its kind alone where it is a plate's, such as "gain of Fx"."""
        return self.name.partition(": ")[2] or self.name

    def falls(self, rms: Array) -> Array:
        """Give by how much each residual of this RMS would fall without it, (6,), as a share."""
        return np.asarray(1 - self.left / rms)

    @property
    def is_told(self) -> bool:
        """Whether the trial or a measurement tells its size."""
        is_fault = self.chance < 1.0
        limit = LIMITS.deviation_of_fault if is_fault else LIMITS.deviation_of_usual
        return bool(self.deviation < limit * self.usual)

    @property
    def is_certain(self) -> bool:
        """Whether it is there, its 95 % interval excludes zero, and the trial tells so."""
        is_sized = abs(self.size) > QUANTILE_95 * self.deviation
        # a delay is measured with an interval of its own, which suffices
        is_narrow = self.is_told or self.group == "delay"
        return self.chance > LIMITS.certain_chance and is_sized and is_narrow


def alike_in_plates(causes: Iterable[EstimatedCause]) -> dict[str, list[EstimatedCause]]:
    """Give gains that all plates have alike, by their names: an error of the body model looks so.

    Gains are compared along a direction of the lab, where plates may have different components. The
    gain of an only plate counts. A common gain of Fz does not: it is an error of the body mass.
    """
    of_direction: dict[str, list[EstimatedCause]] = {}
    for cause in causes:
        if cause.fault.startswith("gain of ") and cause.fault != "gain of Fz":
            of_direction.setdefault(cause.in_lab or cause.fault, []).append(cause)
    alike = [gains for gains in of_direction.values() if _alike(gains)]
    return {gain.name: gains for gains in alike for gain in gains}


def _alike(causes: list[EstimatedCause]) -> bool:
    """Whether each is likely, and the 95 % intervals of all have a part in common."""
    # intervals overlap where the highest of their lower ends is below the lowest of the upper ones
    low = max(cause.size - QUANTILE_95 * cause.deviation for cause in causes)
    high = min(cause.size + QUANTILE_95 * cause.deviation for cause in causes)
    return low <= high and all(cause.chance > LIMITS.likely_chance for cause in causes)


@dataclass(frozen=True, slots=True)
class GroupShare:
    """What a group of causes, or several that cannot be distinguished, make of each residual.

    Attributes
    ----------
    groups
        Its groups, most often one.
    share, deviation
        Share of the mean square and one standard deviation of it, (6,).
    """

    groups: tuple[str, ...]
    share: ByAxis
    deviation: ByAxis


@dataclass(frozen=True, slots=True)
class RmsUncertainty:
    """How sure the RMS of residuals is, if errors of usual size are added to first order.

    Attributes
    ----------
    compensated
        Whether the plates are compensated.
    rms
        As measured, (6,) [N, N·m]; without what segments without markers usually add.
    draws
        The RMS with causes of drawn sizes, (N, 6): the nth draw of a cause has the same size in all
        trials that share it, so that draws tell how residuals of different trials vary together.
    """

    compensated: bool
    rms: ByAxis
    draws: ByAxis

    @property
    def deviation(self) -> Array:
        """Standard deviation of the RMS with these errors, (6,) [N, N·m]."""
        return np.asarray(self.draws.std(axis=0, ddof=1))


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """Residuals over time and how sure they are.

    Attributes
    ----------
    time
        The frames that were explained, (T,) [s].
    cycle
        The gait cycle that each belongs to, (T,): 0 for the first.
    residual
        Reported axes, (T, 6) [N, N·m].
    deviation
        One standard deviation of it, (T, 6): causes of usual size, and noise.
    """

    time: Array
    cycle: Indices
    residual: Array
    deviation: Array


@dataclass(frozen=True, slots=True, eq=False)
class TrialEvidence:
    """What one trial says of its causes, and what each of them does to its residuals.

    Attributes
    ----------
    whole, first, second
        Of all its gait cycles, and of either half of them.
    causes
        K of them, by this trial alone.
    mean, size, found
        The mean and the usual size that the evidence is around; the deviation of a size that was
        found elsewhere, 0 of others, (K,).
    mean_square, frames
        Of the residuals, (6,), and of how many frames they are.
    along, square
        Mean product of the residual with what a cause adds per unit, and its mean square, (K, 6).
    """

    whole: Evidence
    first: Evidence
    second: Evidence
    causes: tuple[EstimatedCause, ...]
    mean: Stored
    size: Stored
    found: Stored
    mean_square: Stored
    frames: int
    along: Stored
    square: Stored


@dataclass(frozen=True, slots=True)
class SharedCause:
    """A cause with one size in some trials of a study.

    Attributes
    ----------
    name
        Its identity: its own name after that of its subject or trial, if it is theirs.
    trials
        Names of the trials.
    cause
        Its size, and the RMS over these trials without it.
    rms
        RMS over these trials as they are, (6,) [N, N·m].
    held_out
        Share of the mean square of one half of the trials or cycles that it takes away with a size
        found in the other half, (6,); NaN where it is not certain.
    """

    name: str
    trials: tuple[str, ...]
    cause: EstimatedCause
    rms: ByAxis
    held_out: ByAxis

    @property
    def axis(self) -> int:
        """The residual that would fall most, as a share of itself."""
        return int(self.cause.falls(self.rms).argmax())

    @property
    def fall(self) -> float:
        """By how much it would fall, as a share of itself."""
        return float(self.cause.falls(self.rms).max())

    @property
    def holds(self) -> bool:
        """Whether it lowers that residual where its size was not found."""
        return bool(self.held_out[self.axis] > 0)


@dataclass(frozen=True, slots=True)
class Budget:
    """What a trial's residuals are made of, and how sure that is.

    Attributes
    ----------
    source
        The recording's file.
    compensated
        Whether they are the residuals with compensated plates.
    rms
        Of each residual over the frames that were explained, reported axes, (6,) [N, N·m].
    low, high
        Ends of its 95 % interval of measurement: what causes of usual size change it by; where
        trunk or arms have no markers, of the RMS that markers on them would show.
    cycles
        How many gait cycles were explained; 0 for a stretch of the recording.
    found_cycles
        How many there are.
    groups
        Shares of groups of causes.
    unexplained
        Share of the mean square that no cause describes, (6,).
    causes
        All causes, the one that explains most first.
    held_out
        Share of the mean square of one half of the cycles that causes take away whose sizes are
        from the other half, (6,); of fewer than four cycles, one half of the frames of each from
        the other.
    notes
        What could not be told, and why.
    uncertainty
        How sure the RMS is: with the plates as measured, and compensated where they are.
    of_window
        The same over the part of the gait cycles that the condition asks for; empty where it asks
        for whole ones.
    bands, evidence
        The residuals over time, and what the trial says of causes that others share; not in files
        of JSON.
    """

    source: Path
    compensated: bool
    rms: ByAxis
    low: ByAxis
    high: ByAxis
    cycles: int
    found_cycles: int
    groups: tuple[GroupShare, ...]
    unexplained: ByAxis
    causes: tuple[EstimatedCause, ...]
    held_out: ByAxis
    notes: tuple[StoredNote, ...]
    uncertainty: tuple[RmsUncertainty, ...] = ()
    of_window: tuple[RmsUncertainty, ...] = ()
    bands: Annotated[Bands | None, PlainValidator(lambda bands: bands), Field(exclude=True)] = None
    evidence: Annotated[
        TrialEvidence | None, PlainValidator(lambda evidence: evidence), Field(exclude=True)
    ] = None
