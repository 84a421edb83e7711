"""Checks of a trial's markers: positions that are repeated instead of measured."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from hbm.coordinates import PARENT
from hbm.markers import Markers
from hbm.model import Body
from hbm.notes import Note
from hbm.signals.samples import stretches
from hbm.spatial import Array, Mask

MIN_FROZEN_S: Final = 0.05
"""All markers at once repeat a position exactly by chance in a frame or two, where a file rounds
them and the subject stands."""
MAX_FROZEN_SHARE: Final = 0.5
"""Of a trial in which cameras may drop out."""
MIN_CONSTANT_S: Final = 0.5
"""A single marker repeats its position for so long only where its whole segment rests."""
MIN_MOTION_M: Final = 0.01
"""Of the others on its segment meanwhile: skin, noise and rounding move them by less."""

ROUNDING_S: Final = 1e-6
"""Of a time, which a file may store in single precision."""


def frozen_frames(markers: Markers, names: Iterable[str]) -> Mask:
    """Give the frames in which all visible markers repeat their positions exactly.

    Parameters
    ----------
    markers
        A trial.
    names
        Labels to look at.

    Returns
    -------
    Mask
        (T,): frames of stretches of 0.05 s and more. The first frame of a stretch was measured and
        is not among them; frames without markers are not either.

    Examples
    --------
    >>> import hbm, numpy as np
    >>> position = np.random.default_rng(0).normal(size=(50, 3, 3))
    >>> position[20:40] = position[20]
    >>> trial = hbm.Markers(np.arange(50) / 100, ("LHEE", "LTOE", "LANK"), position)
    >>> np.flatnonzero(frozen_frames(trial, trial.names))[[0, -1]].tolist()
    [21, 39]
    """
    wanted = set(names)
    frozen, visible = np.ones(len(markers.time), bool), np.zeros(len(markers.time), bool)
    for name, path in zip(markers.names, np.swapaxes(markers.position, 0, 1), strict=True):
        if name in wanted:
            seen, repeated = _repeated(path)
            frozen &= repeated | ~seen
            visible |= seen
    frozen &= visible
    result: Mask = np.zeros(len(frozen), bool)
    for stretch in _lasting(frozen, markers.time, MIN_FROZEN_S):
        result[stretch] = True
    return result


def without_frozen_frames(markers: Markers, names: Iterable[str]) -> Markers:
    """Turn frozen frames into gaps: their positions were not measured.

    Parameters
    ----------
    markers
        A trial.
    names
        Labels to look at, as for `frozen_frames`.

    Returns
    -------
    Markers
        The same where more than half of the frames are frozen: somebody who is simulated may stand
        without any motion, cameras do not drop out for so long.
    """
    frozen = frozen_frames(markers, names)
    if not frozen.any() or frozen.mean() > MAX_FROZEN_SHARE:
        return markers
    position = np.where(frozen[:, None, None], np.nan, markers.position)
    return Markers(markers.time, markers.names, position)


def repeated_positions(body: Body, markers: Markers) -> tuple[Note, ...]:
    """Find positions that were repeated instead of measured.

    Parameters
    ----------
    body
        The subject; only its markers are looked at.
    markers
        A trial.

    Returns
    -------
    tuple of Note
        ``markers_frozen`` where all repeat their positions at once, for 0.05 s and more;
        ``markers_constant``, those that do so alone, for 0.5 s and more, while another marker of
        the segment, or of the segment before it, moves by more than 1 cm.
    """
    frozen = frozen_frames(markers, body.markers)
    constant_s = _constant_times(body, markers)
    notes = []
    if frozen.any():
        first, last = np.flatnonzero(frozen)[[0, -1]]
        notes.append(
            Note.of(
                "markers_frozen",
                frames=np.count_nonzero(frozen),
                first_s=markers.time[first],
                last_s=markers.time[last],
            )
        )
    if constant_s:
        notes.append(Note.of("markers_constant", constant_s=constant_s))
    return tuple(notes)


def _constant_times(body: Body, markers: Markers) -> dict[str, float]:
    """Give for how long markers alone did not move, while their segments did [s]."""
    segment_of = body.segment_of
    at = {
        name: markers.position[:, markers.names.index(name)]
        for name in body.markers
        if name in markers.names
    }
    constant_s: dict[str, float] = {}
    for name, position in at.items():
        segment = segment_of[name]
        others = [at[o] for o in at if segment_of[o] == segment and o != name]
        others = others or [at[o] for o in at if segment_of[o] == PARENT.get(segment)]
        _, repeated = _repeated(position)
        for stretch in _lasting(repeated, markers.time, MIN_CONSTANT_S):
            if any(_extent(other[stretch]) > MIN_MOTION_M for other in others):
                lasted_s = float(markers.time[stretch.stop - 1] - markers.time[stretch.start - 1])
                constant_s[name] = constant_s.get(name, 0.0) + lasted_s
    return constant_s


def _repeated(position: Array) -> tuple[Mask, Mask]:
    """Give which positions (T, 3) are known, and which equal those of the frame before."""
    seen = np.isfinite(position[:, 0])
    repeated = np.zeros(seen.shape, bool)
    x, y, z = (position[1:] == position[:-1]).T
    repeated[1:] = x & y & z
    return seen, repeated


def _lasting(mask: Mask, time: Array, duration_s: float) -> Iterator[slice]:
    """Find stretches of a mask, (T,), that last so long from the frame before them."""
    for start, stop in stretches(mask):
        if time[stop - 1] - time[start - 1] > duration_s - ROUNDING_S:
            yield slice(start, stop)


def _extent(position: Array) -> float:
    """Give the largest extent of positions, (F, 3), along an axis [m]; 0 where none is known."""
    known = position[np.isfinite(position[:, 0])]
    return float(np.ptp(known, axis=0).max()) if len(known) else 0.0
