"""Check of marker labels: two that change places from one frame to the next."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.plausibility.exchanged_sides import first_named
from hbm.plausibility.repeated_positions import frozen_frames
from hbm.spatial import Array, Mask

MIN_JUMP_M: Final = 0.03
"""Of a marker against its own motion: noise and an acceleration of 100 m/s² make 1 cm at 100 Hz."""
MAX_EXCHANGED_SHARE: Final = 1 / 3
"""Of that jump that remains when two markers are exchanged, for their labels to have changed
places."""
MAX_GAP_S: Final = 0.1
"""Over which a marker's motion is extrapolated; labels often change places where one is hidden."""


def labels_exchanged(markers: Markers, names: Iterable[str]) -> tuple[Note, ...]:
    """Find markers whose labels change places from one frame to the next.

    Parameters
    ----------
    markers
        A trial.
    names
        Labels to look at.

    Returns
    -------
    tuple of Note
        One ``labels_exchanged``: pairs that jump at one instant, each to where the other one's
        motion leads, with the times of the first and the last such instant.

    Notes
    -----
    Motion is extrapolated from the last two positions, over gaps of up to 0.1 s, but not from
    positions that were repeated.

    Examples
    --------
    >>> import hbm
    >>> heels = [static.names.index(name) for name in ("LHEE", "RHEE")]
    >>> position = static.position + 1.3 * static.time[:, None, None]
    >>> position[30:60, heels] = position[30:60, heels[::-1]]
    >>> trial = hbm.Markers(static.time, static.names, position)
    >>> for note in labels_exchanged(trial, static.names):
    ...     print(*note.values["named"], note.values["first_s"], note.values["last_s"])
    LHEE/RHEE 0.3 0.6
    """
    names = [name for name in names if name in markers.names]
    if not names:
        return ()
    paths = [markers.position[:, markers.names.index(name)] for name in names]
    jump = np.stack([_jumps(markers.time, path) for path in paths]).T
    jumped: Mask = jump > MIN_JUMP_M
    if jumped.sum(axis=1).max(initial=0) < 2:
        return ()
    expected = [_extrapolated(markers.time, path) for path in paths]
    found: dict[str, list[float]] = {}
    jumped[1:][frozen_frames(markers, names)[:-1]] = False
    for frame in np.flatnonzero(jumped.sum(axis=1) > 1):
        own = np.flatnonzero(jumped[frame])
        here, there = (np.array([each[k][frame] for k in own]) for each in (paths, expected))
        apart = np.linalg.norm(here[:, None] - there, axis=-1)
        nearest = apart.argmin(axis=1)
        for a, b in enumerate(nearest):
            farther = max(apart[a, b], apart[b, a])
            mutual = a < b and nearest[b] == a
            if mutual and farther < MAX_EXCHANGED_SHARE * jump[frame, own[[a, b]]].min():
                pair = f"{names[own[a]]}/{names[own[b]]}"
                found.setdefault(pair, []).append(float(markers.time[frame]))
    if not found:
        return ()
    times = [time for each in found.values() for time in each]
    return (
        Note.of(
            "labels_exchanged",
            pairs=len(found),
            named=first_named(list(found)),
            first_s=min(times),
            last_s=max(times),
        ),
    )


def _extrapolated(time: Array, path: Array) -> Array:
    """Give where a marker (T, 3) would be by its last two positions; NaN where unknown."""
    expected = np.full(path.shape, np.nan)
    frames = np.flatnonzero(np.isfinite(path[:, 0]))
    share, seen = _steps_alike(time[frames]), path[frames]
    expected[frames[2:]] = seen[1:-1] + share[:, None] * (seen[1:-1] - seen[:-2])
    return expected


def _jumps(time: Array, path: Array) -> Array:
    """Give how far a marker (T, 3) is from there, (T,) [m]; NaN where unknown."""
    jump = np.full(len(path), np.nan)
    known = np.isfinite(path[:, 0])
    square, share = 0.0, _steps_alike(time[known])
    for coordinate in path.T:
        steps = np.diff(coordinate[known])
        square = square + (steps[1:] - share * steps[:-1]) ** 2
    jump[np.flatnonzero(known)[2:]] = np.sqrt(square)
    return jump


def _steps_alike(at: Array) -> Array:
    """Give each time step by the one before it, (N - 2,); NaN where both together are too long."""
    steps = np.diff(at)
    return np.where(at[2:] - at[:-2] > MAX_GAP_S, np.nan, steps[1:] / steps[:-1])
