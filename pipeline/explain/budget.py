"""What a trial's residuals are made of: types only."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import PlainSerializer, PlainValidator

from hbm.spatial import Array, read_only
from pipeline.trial.residuals import AXES
from pipeline.trial.summary import StoredNote


def _by_axis(values: Array) -> dict[str, float | None]:
    """Name numbers by their axes; null where one is unknown."""
    known = zip(AXES, values.tolist(), strict=True)
    return {axis: None if np.isnan(value) else value for axis, value in known}


def _of_axes(stored: object) -> Array:
    if isinstance(stored, Mapping):
        if tuple(stored) != AXES:
            raise ValueError(f"expected numbers by axis, {', '.join(AXES)}")
        stored = list(stored.values())
    return read_only(np.array(stored, float))


ByAxis = Annotated[Array, PlainValidator(_of_axes), PlainSerializer(_by_axis)]
"""Numbers of the six axes, (6,); in JSON they are named."""


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
    left: ByAxis

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
    share: ByAxis
    deviation: ByAxis


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
