"""Select the gait cycles that count: the first ones of walking, or the perturbed ones."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from pipeline.config.schema import Condition

COUNTED_SIDE: Final = "right"
"""Cycles of walking are counted by one foot, as in the thesis; both feet's cycles overlap. Where it
has none, those of the other foot count."""


def select_cycles(
    cycles: dict[str, Array], condition: Condition, onsets: Array | None
) -> tuple[dict[str, Array], tuple[Note, ...]]:
    """Select the gait cycles of a condition.

    Parameters
    ----------
    cycles
        Side -> start and stop of each cycle, (C, 2) [s].
    condition
        How many, from when (cycles or perturbations before ``skip_s`` do not count), and whether
        only perturbed ones.
    onsets
        Perturbation onsets, (P,) [s]; needed where the condition is perturbed.

    Returns
    -------
    selected
        Side -> cycles. Walking counts cycles of the right foot, or of the left one if the right has
        none, the first ones there are. A
        perturbation counts the cycle whose initial contact came last before it, of either foot;
        two perturbations within one cycle count it once.
    notes
        ``cycles_of_left`` and what is missing: ``cycles_missing``, ``perturbation_without_cycle``.
    """
    notes: tuple[Note, ...] = ()
    if condition.perturbed:
        onsets = np.empty(0) if onsets is None else onsets
        selected, notes = _perturbed(cycles, onsets[onsets >= condition.skip_s])
    else:
        later = {side: spans[spans[:, 0] >= condition.skip_s] for side, spans in cycles.items()}
        side = counted_side({side: len(spans) for side, spans in later.items()})
        selected = {side: later[side]}
        if side != COUNTED_SIDE and len(later[side]):
            notes = (Note.of("cycles_of_left"),)
    found = sum(len(spans) for spans in selected.values())
    wanted = condition.cycles
    if wanted is None:
        return selected, notes
    if found < wanted:
        notes = (*notes, Note.of("cycles_missing", found=found, wanted=wanted))
    return _first(selected, wanted), notes


def counted_side(cycles: Mapping[str, int]) -> str:
    """Give the foot by which walking is counted, from how many cycles each foot has."""
    return COUNTED_SIDE if cycles[COUNTED_SIDE] else max(cycles, key=lambda side: cycles[side])


def _perturbed(
    cycles: dict[str, Array], onsets: Array
) -> tuple[dict[str, Array], tuple[Note, ...]]:
    selected: dict[str, list[Array]] = {side: [] for side in cycles}
    notes = []
    for onset in onsets:
        containing = [
            (span[0], side, span)
            for side, spans in cycles.items()
            for span in spans
            if span[0] <= onset < span[1]
        ]
        if containing:
            _, side, span = max(containing, key=lambda cycle: cycle[0])
            selected[side].append(span)
        else:
            notes.append(Note.of("perturbation_without_cycle", onset_s=onset))
    spans = {
        side: np.unique(np.reshape(found, (-1, 2)), axis=0) for side, found in selected.items()
    }
    return spans, tuple(notes)


def _first(cycles: dict[str, Array], count: int) -> dict[str, Array]:
    """Keep the earliest cycles of both sides together."""
    starts = np.sort(np.concatenate([spans[:, 0] for spans in cycles.values()]))
    if len(starts) <= count:
        return cycles
    last = starts[count - 1]
    return {side: spans[spans[:, 0] <= last] for side, spans in cycles.items()}
