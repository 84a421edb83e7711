"""What a trial's residuals are made of: types only."""

from dataclasses import dataclass
from pathlib import Path

from hbm.notes import Note
from hbm.spatial import Array


@dataclass(frozen=True, slots=True)
class EstimatedCause:
    """A cause with its size.

    Attributes
    ----------
    name, group, unit
        See `pipeline.explain.cause.Cause`.
    size, deviation
        Its most probable size and one standard deviation of it.
    usual
        One standard deviation before the trial was looked at.
    left
        RMS of each residual without it, (6,) [N, N·m].
    """

    name: str
    group: str
    unit: str
    size: float
    deviation: float
    usual: float
    left: Array

    @property
    def is_certain(self) -> bool:
        """Whether its 95 % interval excludes zero."""
        return abs(self.size) > 1.96 * self.deviation


@dataclass(frozen=True, slots=True)
class GroupShare:
    """What a group of causes, or several that cannot be told apart, make of each residual.

    Attributes
    ----------
    groups
        Its groups, most often one.
    share, deviation
        Share of the mean square and one standard deviation of it, (6,).
    """

    groups: tuple[str, ...]
    share: Array
    deviation: Array


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
        Ends of its 95 % interval of measurement: the RMS if the causes had other sizes, as usual
        as those of the trial.
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
        from the other half, (6,); NaN where there are too few.
    notes
        What could not be told, and why.
    """

    source: Path
    compensated: bool
    rms: Array
    low: Array
    high: Array
    cycles: int
    found_cycles: int
    groups: tuple[GroupShare, ...]
    unexplained: Array
    causes: tuple[EstimatedCause, ...]
    held_out: Array
    notes: tuple[Note, ...]
