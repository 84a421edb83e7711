"""Checks of samples that every function of this package makes before it computes."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array

LIMITS: Final = read_numbers("compensation", "thresholds.toml", "inputs")


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


def refuse_other_units(a: Array, sensors: tuple[str, ...]) -> None:
    """Raise a ValueError where an accelerometer does not measure gravity, about 9.81 m/s²."""
    for name, reading in zip(sensors, np.split(a, len(sensors), axis=1), strict=True):
        size = float(np.median(np.sqrt(np.vecdot(reading, reading))))
        if not GRAVITY_MPS2 / LIMITS.gravity_factor < size < LIMITS.gravity_factor * GRAVITY_MPS2:
            raise ValueError(
                f"accelerometer {name} reads {size:.3g} m/s² in the median, expected gravity "
                f"({GRAVITY_MPS2}); is it dead, tared, or in another unit (g, mm/s², V)?"
            )


def refuse_still_platform(a: Array) -> None:
    """Raise a ValueError where a calibration trial contains no motion."""
    largest = float(np.max(np.std(a, axis=0)))
    if largest < LIMITS.least_motion:
        raise ValueError(
            f"the platform hardly moved: accelerations vary by {largest:.2g} m/s² at most; "
            "fit on a calibration trial with pitch and sway"
        )


def refuse_other_wrench_units(a: Array, w: Array) -> None:
    """Raise a ValueError where force by acceleration is no mass, or moment by force no lever."""
    force, moment = (np.linalg.norm(np.std(part, axis=0)) for part in (w[:, :3], w[:, 3:]))
    motion = np.linalg.norm(np.std(a.reshape(len(a), -1, 3).mean(axis=1), axis=0))
    # force by acceleration is a mass [kg], moment by force a lever [m]: units show in both
    mass, arm = force / motion, moment / force
    if not LIMITS.least_mass < mass < LIMITS.largest_mass:
        raise ValueError(
            f"wrench: forces correspond to a moving mass of {mass:.3g} kg, expected a belt "
            f"assembly of {LIMITS.least_mass:g} to {LIMITS.largest_mass:g} kg; forces must be in N "
            "and accelerations in m/s²"
        )
    if not LIMITS.least_lever < arm < LIMITS.largest_lever:
        raise ValueError(
            f"wrench: moments correspond to a lever arm of {arm:.3g} m, expected "
            f"{LIMITS.least_lever:g} to {LIMITS.largest_lever:g} m; moments must be in N·m"
        )
