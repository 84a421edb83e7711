"""Checks of a trial's markers before inverse kinematics: positions, labels, sides, distances."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import compress
from typing import Any, Final, NamedTuple

import numpy as np

from hbm.coordinates import MOVING, PARENT
from hbm.markers import Markers, MarkerSet, exchange
from hbm.model import Body
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.samples import medians_of_known, stretches
from hbm.spatial import Array, Mask, distance
from hbm.spelling import listed

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "labels")

FROZEN: Final = read_numbers("hbm", "thresholds.toml", "frozen")


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
    labels = set(names)
    columns = [k for k, name in enumerate(markers.names) if name in labels]
    measured, repeated = _repeated(markers.position[:, columns])
    frozen: Mask = np.asarray((repeated | ~measured).all(axis=1) & measured.any(axis=1))
    result = np.zeros(len(frozen), bool)
    for stretch in _lasting(frozen, markers.time, FROZEN.shortest):
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
    if not frozen.any() or frozen.mean() > FROZEN.most_of_trial:
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
    notes, frozen_s = [], markers.time[frozen_frames(markers, body.markers)]
    if len(frozen_s):
        ends = {"first_s": frozen_s[0], "last_s": frozen_s[-1]}
        notes.append(Note.of("markers_frozen", frames=len(frozen_s), **ends))
    # for how long markers alone did not move, while their segments did
    segment_of = body.segment_of
    at = {name: k for k, name in enumerate(markers.names) if name in segment_of}
    _, repeated = _repeated(markers.position)
    constant_s: dict[str, float] = {}
    for name in (name for name in body.markers if name in at):
        segment = segment_of[name]
        for stretch in _lasting(repeated[:, at[name]], markers.time, FROZEN.shortest_alone):
            # a marker may rest with its segment: another one there, or before it, has to move
            others = [at[o] for o in at if segment_of[o] == segment and o != name]
            others = others or [at[o] for o in at if segment_of[o] == PARENT.get(segment)]
            if any(_extent(markers.position[stretch, k]) > FROZEN.least_motion for k in others):
                lasted_s = float(markers.time[stretch.stop - 1] - markers.time[stretch.start - 1])
                constant_s[name] = constant_s.get(name, 0.0) + lasted_s
    if constant_s:
        notes.append(Note.of("markers_constant", constant_s=constant_s))
    return tuple(notes)


def _repeated(position: Array) -> tuple[Mask, Mask]:
    """Give which positions, (T, ..., 3), are known, and which equal those of the frame before."""
    repeated = np.zeros(position.shape[:-1], bool)
    repeated[1:] = (position[1:] == position[:-1]).all(axis=-1)
    return np.isfinite(position[..., 0]), repeated


def _lasting(mask: Mask, time: Array, duration_s: float) -> Iterator[slice]:
    """Find stretches of a mask, (T,), that last so long from the frame before them."""
    for start, stop in stretches(mask):
        if time[stop - 1] - time[start - 1] > duration_s - ROUNDING_S:
            yield slice(start, stop)


def _extent(position: Array) -> float:
    """Give the largest extent of positions, (F, 3), along an axis [m]; 0 where none is known."""
    measured = position[np.isfinite(position[:, 0])]
    return float(np.ptp(measured, axis=0).max()) if len(measured) else 0.0


CROSSING_SEGMENTS: Final = ("forearm", "hand")
"""Folded arms bring the left one to the right."""


class ExchangedSides(NamedTuple):
    """Left and right markers that carry each other's labels throughout a recording.

    Attributes
    ----------
    recording
        Its name.
    pairs
        Labels, left and right.
    rename
        The options that exchange them.
    """

    recording: str
    pairs: tuple[tuple[str, str], ...]
    rename: str

    @property
    def note(self) -> Note:
        """What to tell people."""
        pairs = listed(map("/".join, self.pairs))
        return Note.of("sides_exchanged", recording=self.recording, pairs=pairs, rename=self.rename)


def sides_exchanged(
    marker_set: MarkerSet, markers: Markers, recording: str
) -> ExchangedSides | None:
    """Find left and right markers that carry each other's labels throughout a recording.

    Parameters
    ----------
    marker_set
        The set that the labels are of.
    markers
        The trial, or the calibration pose.
    recording
        Its name.

    Returns
    -------
    ExchangedSides or None
        The pairs; None without any.

    Notes
    -----
    The markers of a landmark on both sides are exchanged if the left one is more than 4 cm to the
    right of the right one (median over the recording). The way to the left follows from the
    vertical and from sacrum and front of the pelvis, whose middles do not depend on the sides'
    labels.

    Other pairs, those that are closer together and those of forearms and hands, which people cross,
    are not judged: `changed_distances` finds them by their distances to other markers.

    Examples
    --------
    A trial in which knee markers are exchanged:

    >>> import hbm
    >>> knees = {"LLEK": "RLEK", "RLEK": "LLEK"}
    >>> names = tuple(knees.get(name, name) for name in static.names)
    >>> trial = hbm.Markers(static.time, names, static.position)
    >>> sides_exchanged(hbm.marker_sets()["hbm2"], trial, "walk.c3d").pairs
    (('LLEK', 'RLEK'),)
    """
    chosen = marker_set.present(markers.names)
    landmark, segment = chosen.landmark, chosen.segment
    to_the_left = _to_the_left(markers, landmark)
    judged = [
        (left, right)
        for name, left in landmark.items()
        if name.startswith("L") and (right := landmark.get(f"R{name[1:]}"))
        if not segment[left].endswith(CROSSING_SEGMENTS)
    ]
    # left marker minus right marker along the way to the left: negative when exchanged
    leftward_m = medians_of_known((_between(markers, judged) * to_the_left).sum(axis=1))
    exchanged = leftward_m < -LIMITS.least_separation
    if not exchanged.any():
        return None
    pairs, every = [*compress(judged, exchanged)], not (leftward_m > LIMITS.least_separation).any()
    return ExchangedSides(recording, tuple(pairs), exchange(pairs, recording, every))


def _between(markers: Markers, pairs: Sequence[tuple[str, str]]) -> Array:
    """Give the vectors to the first marker of each pair from the second, (P, 3, T) [m].

    NaN where one is not seen, or not in the recording.
    """
    column = {name: k for k, name in enumerate(markers.names)}
    columns = np.array([[column.get(name, -1) for name in pair] for pair in pairs], int)
    first, second = columns.reshape(-1, 2).T
    position = np.moveaxis(markers.position, 0, -1)
    vectors: Array = position[first] - position[second]
    vectors[(first < 0) | (second < 0)] = np.nan
    return vectors


def _to_the_left(markers: Markers, landmark: Mapping[str, str]) -> Array:
    """Give the horizontal direction to the subject's left, (3, T); NaN where it is unknown."""
    # middles of left and right markers are the same with exchanged labels
    front, back = ([landmark.get(side + name, "") for side in "LR"] for name in ("ASIS", "PSIS"))
    if not set(back) <= set(markers.names):
        back = 2 * [landmark.get("SACR", "")]
    forward = _between(markers, [*zip(front, back, strict=True)]).mean(axis=0)
    length = np.hypot(forward[0], forward[1])
    # forward turned by 90° about the vertical
    left = np.stack([-forward[1], forward[0], 0 * length])
    return np.asarray(np.where(length > LIMITS.least_forward, left, np.nan) / length)


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
    ...     print(note.values["pairs"], note.values["first_s"], note.values["last_s"])
    LHEE/RHEE 0.3 0.6
    """
    names = [name for name in names if name in markers.names]
    columns = [markers.names.index(name) for name in names]
    paths = np.moveaxis(markers.position, 0, -1)[columns]
    expected = np.empty(paths.shape)
    whole = np.isfinite(paths[:, 0]).all(axis=-1)
    for part in (whole, *np.flatnonzero(~whole)):  # at once where nothing is missing
        expected[part] = _extrapolated(markers.time, paths[part])
    jump = np.linalg.norm(paths - expected, axis=1)
    jumped: Mask = jump > LIMITS.least_jump
    # after positions that were repeated every marker jumps
    jumped[:, 1:][:, frozen_frames(markers, names)[:-1]] = False
    # all that jumped, in the order of time, and of them pairs at one instant
    frame, marker = np.nonzero(jumped.T)
    here, there, away = paths[marker, :, frame], expected[marker, :, frame], jump[marker, frame]
    changes: list[tuple[int, int]] = []
    for step in range(1, jumped.sum(axis=0).max(initial=0)):
        one = np.flatnonzero(frame[step:] == frame[:-step])
        other = one + step
        # both labels are where the other one's motion leads
        apart = np.maximum(distance(here[one], there[other]), distance(here[other], there[one]))
        near = apart < LIMITS.most_left * np.minimum(away[one], away[other])
        changes += zip(one[near].tolist(), other[near].tolist(), strict=True)
    times_s: dict[str, list[float]] = {}
    for a, b in sorted(changes):
        together = np.flatnonzero(frame == frame[a])
        # each is the nearest to the other one's place of all that jumped at that instant
        if [together[distance(here[k], there[together]).argmin()] for k in (a, b)] == [b, a]:
            pair = f"{names[marker[a]]}/{names[marker[b]]}"
            times_s.setdefault(pair, []).append(float(markers.time[frame[a]]))
    if not times_s:
        return ()
    ends = {"first_s": min(map(min, times_s.values())), "last_s": max(map(max, times_s.values()))}
    return (Note.of("labels_exchanged", pairs=listed(times_s), **ends),)


def _extrapolated(time: Array, path: Array) -> Array:
    """Give where markers, (..., T), would be by their last two positions; NaN where unknown."""
    expected = np.full(path.shape, np.nan)
    frames = np.flatnonzero(np.isfinite(path).reshape(-1, len(time)).all(axis=0))
    at, position = time[frames], path[..., frames]
    steps = np.diff(at)
    # to the same velocity over a step of another length; not over long gaps
    ratio = np.where(at[2:] - at[:-2] > LIMITS.longest_gap, np.nan, steps[1:] / steps[:-1])
    step = position[..., 1:-1] - position[..., :-2]
    expected[..., frames[2:]] = position[..., 1:-1] + ratio * step
    return expected


def changed_distances(body: Body, markers: Markers) -> tuple[Note, ...]:
    """Find markers of one segment whose distances differ from those on the body.

    Parameters
    ----------
    body
        The subject, from the calibration pose.
    markers
        A trial.

    Returns
    -------
    tuple of Note
        One ``marker_distances_changed`` per segment: pairs whose median distance in the trial
        differs by more than 3 cm, because a marker has moved, is swapped with another or carries
        the wrong label.

    Examples
    --------
    With ``body`` from `build_body` and a trial in which a marker has moved by 8 cm:

    >>> import hbm
    >>> position = static.position.copy()
    >>> position[:, static.names.index("RLTHI"), 2] += 0.08
    >>> trial = hbm.Markers(static.time, static.names, position)
    >>> for note in changed_distances(body, trial):
    ...     print(note.values["segment"], *note.values["largest_m"])
    right_thigh RLEK–RLTHI RMEK–RLTHI
    """
    segments = np.array(body.marker_segment)
    first, second = np.triu_indices(len(segments), 1)
    together = segments[first] == segments[second]
    first, second = first[together], second[together]
    pairs = [(body.markers[a], body.markers[b]) for a, b in zip(first, second, strict=True)]
    there = distance(body.marker_position[first], body.marker_position[second])
    # medians: skin moves markers about where they are in the calibration pose
    change = median_distances(markers, pairs) - there
    large = np.abs(change) > LIMITS.distance_change
    notes = []
    for segment in MOVING:
        here = np.flatnonzero(large & (segments[first] == segment))
        largest = here[np.argsort(-np.abs(change[here]), kind="stable")][: LIMITS.distances_named]
        largest_m = {"–".join(pairs[k]): change[k] for k in largest}
        values: dict[str, Any] = {"limit_m": LIMITS.distance_change, "largest_m": largest_m}
        if largest_m:
            notes.append(Note.of("marker_distances_changed", segment=segment, **values))
    return tuple(notes)


def median_distances(markers: Markers, pairs: Sequence[tuple[str, str]]) -> Array:
    """Give the median distance of each pair [m], (P,); NaN where they are never seen together."""
    return medians_of_known(np.linalg.norm(_between(markers, pairs), axis=1))
