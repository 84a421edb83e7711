"""Marker trajectories."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from hbm.spatial import Array, frozen, read_only
from hbm.spelling import listed


@dataclass(frozen=True, slots=True)
class Markers:
    """Marker trajectories in the lab frame.

    Attributes
    ----------
    time
        Sample times, (T,) [s], increasing.
    names
        Marker labels, one per column, unique.
    position
        Positions in lab axes (X forward, Y left, Z up), (T, M, 3) [m]. A gap is NaN.

    Examples
    --------
    Two markers at 100 Hz:

    >>> import hbm, numpy as np
    >>> heels = hbm.Markers(np.arange(50) / 100, ("LHEE", "RHEE"), np.zeros((50, 2, 3)))
    >>> round(heels.rate_hz, 6)
    100.0
    """

    time: Array
    names: tuple[str, ...]
    position: Array

    def __post_init__(self) -> None:
        time, position = np.asarray(self.time, float), np.asarray(self.position, float)
        names = tuple(self.names)
        if position.ndim != 3 or position.shape != (len(time), len(names), 3):
            raise ValueError(
                f"marker positions must have shape ({len(time)}, {len(names)}, 3) "
                f"for {len(time)} times and {len(names)} names, got {position.shape}"
            )
        if len(set(names)) != len(names):
            twice = sorted(name for name, count in Counter(names).items() if count > 1)
            raise ValueError(
                f"marker names must be unique, but these appear twice: {listed(twice)}"
            )
        if len(time) > 1 and not np.all(np.diff(time) > 0):
            raise ValueError("marker times must increase")
        # every coordinate in one piece of memory: most take marker by marker
        coordinates = np.moveaxis(position, 0, -1)
        unknown = np.isnan(position)
        partly = unknown.any(axis=-1) & ~unknown.all(axis=-1)
        if partly.any() or not coordinates.flags.c_contiguous:
            coordinates = np.array(coordinates, order="C")
            np.moveaxis(coordinates, -1, 0)[partly] = np.nan
            frozen(coordinates)
        object.__setattr__(self, "time", read_only(time))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "position", np.moveaxis(read_only(coordinates), -1, 0))

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]: the median of the time steps."""
        return float(1 / np.median(np.diff(self.time)))
