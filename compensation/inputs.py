"""Checks of samples that every function of this package makes before it computes."""

import numpy as np
from numpy.typing import ArrayLike

from hbm.spatial import Array


def read_table(values: ArrayLike, name: str, columns: int | None = None) -> Array:
    """Give samples as float64, one row per sample, or raise an error that names what is wrong.

    Parameters
    ----------
    values
        Samples, (N, C).
    name
        Their name, with which the error begins.
    columns
        The number of columns C, where it is known.

    Returns
    -------
    Array
        The samples, (N, C), finite, N > 0.

    Raises
    ------
    ValueError
        Wrong shape, no samples, or a value that is not finite.
    """
    table = np.asarray(values, float)
    expected = f"(samples, {columns if columns is not None else 'channels'})"
    if table.ndim != 2 or (columns is not None and table.shape[1] != columns):
        raise ValueError(f"{name} must have shape {expected}, got {table.shape}")
    if table.size == 0:
        raise ValueError(f"{name} has no samples: shape {table.shape}; is the recording empty?")
    refuse_gaps(table, name)
    return table


def read_signal(values: ArrayLike, name: str) -> Array:
    """Give one channel as float64, (N,), under the rules of `read_table`."""
    signal = np.asarray(values, float)
    if signal.ndim != 1:
        raise ValueError(f"{name} must have shape (samples,), got {signal.shape}")
    return read_table(signal[:, None], name, 1)[:, 0]


def refuse_gaps(values: Array, name: str) -> None:
    """Raise a ValueError that says how many samples are not finite and where they begin."""
    finite = np.isfinite(values)
    if not finite.all():
        bad = ~finite.reshape(len(values), -1).all(axis=1)
        edges = np.flatnonzero(np.diff(bad.astype(int), prepend=0, append=0))
        longest = int(np.max(edges[1::2] - edges[::2]))
        raise ValueError(
            f"{name}: {bad.sum()} of {len(values)} samples are not numbers, the first at sample "
            f"{edges[0]}, the longest run {longest} samples; cut or fill the gap first"
        )


def refuse_constant(table: Array, name: str, channels: tuple[str, ...]) -> None:
    """Raise a ValueError that names the channels that never change."""
    constant = [
        c for c, still in zip(channels, (table == table[0]).all(axis=0), strict=True) if still
    ]
    if constant:
        raise ValueError(
            f"{name}: constant in {', '.join(constant)} over all {len(table)} samples; "
            "is the channel connected?"
        )


def refuse_unequal(**tables: Array) -> None:
    """Raise a ValueError where series that belong together differ in their number of samples."""
    lengths = {name: len(table) for name, table in tables.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ValueError(
            f"numbers of samples differ: {listed}; were they recorded at different rates? "
            "Bring them to one time base first"
        )


def read_rate(rate_hz: float) -> float:
    """Give a sampling rate, or raise a ValueError where it is not a positive number of hertz."""
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(f"rate_hz must be a positive number of hertz, got {rate_hz}")
    return float(rate_hz)
