"""The residuals of every gait cycle by itself, as a long table."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hbm.spatial import Array, Mask

COLUMNS: Final = (
    *("compensated", "side", "cycle", "start_s", "stop_s"),
    *("axis", "unit", "rms", "peak", "valid_share"),
)


def cycle_table(
    time: Array,
    counts: Mask,
    residuals: Mapping[bool, Array],
    cycles: Mapping[str, ArrayLike],
    units: Mapping[str, str],
) -> pd.DataFrame:
    """Summarise the residuals of every gait cycle.

    Parameters
    ----------
    time
        (T,) [s].
    counts
        Whether each frame counts, (T,).
    residuals
        Compensated or not -> residuals in the reported axes, (T, K) [N, N·m].
    cycles
        Side -> start and stop of each gait cycle that counts, half-open, (C, 2) [s].
    units
        Axis -> unit, in the order of the residuals' K columns.

    Returns
    -------
    pandas.DataFrame
        compensated, side, cycle (from 1 for each side), start_s, stop_s, axis, unit, rms and peak
        (largest magnitude) over the frames of the cycle that count, and their share of its frames;
        NaN where none counts.

    Examples
    --------
    >>> time, cycles = np.arange(4) / 10, {"left": [[0.1, 0.4]]}
    >>> residual = np.array([[9.0], [1.0], [-7.0], [9.0]])
    >>> counts = np.array([True, True, True, False])
    >>> table = cycle_table(time, counts, {False: residual}, cycles, {"Fx": "N"})
    >>> table[["cycle", "rms", "peak", "valid_share"]].round(2).to_numpy().tolist()
    [[1.0, 5.0, 7.0, 0.67]]
    """
    rows: list[tuple[object, ...]] = []
    for compensated, residual in residuals.items():
        for side, spans in cycles.items():
            for number, (start, stop) in enumerate(np.reshape(spans, (-1, 2)).tolist(), start=1):
                inside = (time >= start) & (time < stop)
                own = inside & counts
                share = float(np.mean(counts[inside])) if inside.any() else 0.0
                cycle = compensated, side, number, start, stop
                measures = zip(units, units.values(), *_rms_and_peak(residual[own]), strict=True)
                rows += [(*cycle, *measure, share) for measure in measures]
    return pd.DataFrame(rows, columns=COLUMNS)


def _rms_and_peak(residual: Array) -> tuple[Sequence[float], Sequence[float]]:
    if not len(residual):
        unknown = [np.nan] * residual.shape[1]
        return unknown, unknown
    return np.sqrt(np.mean(residual**2, axis=0)).tolist(), np.abs(residual).max(axis=0).tolist()
