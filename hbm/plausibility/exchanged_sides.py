"""Check of marker labels: left and right exchanged throughout a recording."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from hbm.markers import Markers, MarkerSet
from hbm.model import Body
from hbm.notes import Note
from hbm.spatial import Array, distance

CROSSING_SEGMENTS: Final = ("forearm", "hand")
"""Folded arms bring the left one to the right."""
MIN_SEPARATION_M: Final = 0.04
"""Of a pair sideways, for its side to be certain: on average narrow steps bring feet and medial
markers as close together."""
MIN_FORWARD_M: Final = 0.05
"""Horizontal distance from sacrum to front of the pelvis; less when lying, and the way forward is
unknown then."""
MIN_MISFIT_M: Final = 0.03
MAX_MISFIT_M: Final = 0.015
"""Differences of distances from the body's: skin changes those within a segment by 1 to 2 cm."""

MAX_PAIRS_NAMED: Final = 6
"""Pairs of exchanged markers in a note; a whole side has about twenty."""


def sides_exchanged(body: Body, markers: Markers, recording: str) -> tuple[Note, ...]:
    """Find left and right markers that carry each other's labels throughout a recording.

    Parameters
    ----------
    body
        The subject.
    markers
        The trial, or the calibration pose.
    recording
        Its name, for the note.

    Returns
    -------
    tuple of Note
        One ``sides_exchanged``, which names the pairs.

    Notes
    -----
    A pair is exchanged if the left marker is more than 4 cm to the right of the right one (median
    over the recording). The way to the left follows from the vertical and from sacrum and front of
    the pelvis, whose middles do not depend on the sides' labels.

    Where a pair is closer together, and on forearms and hands, which people cross, it is exchanged
    if its distances to the other markers of its segments differ from the body's by more than 3 cm
    as labelled and by less than 1.5 cm exchanged (means of medians).

    Examples
    --------
    With ``body`` from `build_body` and a trial in which knee markers are exchanged:

    >>> import hbm
    >>> knees = {"LLEK": "RLEK", "RLEK": "LLEK"}
    >>> names = tuple(knees.get(name, name) for name in static.names)
    >>> trial = hbm.Markers(static.time, names, static.position)
    >>> for note in sides_exchanged(body, trial, "walk.c3d"):
    ...     print(note.values["pairs"], *note.values["named"])
    1 LLEK/RLEK
    """
    exchanged = []
    to_the_left = _to_the_left(markers, body.marker_set)
    for left, right in counterparts(body.marker_set).items():
        if not {left, right} <= set(markers.names):
            continue
        crosses = body.marker_set.segment[left].endswith(CROSSING_SEGMENTS)
        between = _of(markers, left) - _of(markers, right)
        sideways = np.nan if crosses else _median(np.sum(between * to_the_left, axis=-1))
        certain = abs(sideways) > MIN_SEPARATION_M
        if sideways < 0 if certain else _fit_exchanged(body, markers, left, right):
            exchanged.append(f"{left}/{right}")
    if not exchanged:
        return ()
    return (
        Note.of(
            "sides_exchanged",
            recording=recording,
            pairs=len(exchanged),
            named=first_named(exchanged),
        ),
    )


def counterparts(marker_set: MarkerSet) -> dict[str, str]:
    """Give the pairs of a marker set: label of a left marker -> that of its right counterpart.

    Two markers are a pair if they mark the same landmark of both sides, or if they belong to the
    same segment, or to that of the other side, and their labels differ by one L and R.
    """
    landmark, segment = marker_set.landmark, marker_set.segment
    pairs = {
        landmark[name]: landmark[f"R{name[1:]}"]
        for name in landmark
        if name.startswith("L") and f"R{name[1:]}" in landmark
    }
    for name in segment:
        mirrored = segment[name].replace("left_", "right_")
        for k, letter in enumerate(name):
            opposite = f"{name[:k]}{ {'L': 'R', 'l': 'r'}.get(letter, letter) }{name[k + 1 :]}"
            if opposite != name and segment.get(opposite) == mirrored:
                pairs.setdefault(name, opposite)
    return pairs


def first_named(pairs: Sequence[str]) -> tuple[str, ...]:
    """Give the first few of exchanged pairs, and an ellipsis where there are more."""
    more = len(pairs) > MAX_PAIRS_NAMED
    return (*pairs[:MAX_PAIRS_NAMED], *(["…"] if more else []))


def _fit_exchanged(body: Body, markers: Markers, left: str, right: str) -> bool:
    """Tell whether a pair fits its segments exchanged, and does not as labelled."""
    if not {left, right} <= set(body.markers):
        return False
    labelled = _misfits(body, markers, {left: left, right: right})
    exchanged = _misfits(body, markers, {left: right, right: left})
    if not labelled:
        return False
    return bool(np.mean(labelled) > MIN_MISFIT_M and np.mean(exchanged) < MAX_MISFIT_M)


def _misfits(body: Body, markers: Markers, label: Mapping[str, str]) -> list[float]:
    """Give by how much markers of other labels miss their distances on their segments [m]."""
    on_body = dict(zip(body.markers, body.marker_position, strict=True))
    segment_of = body.segment_of
    misfits = []
    for name, other in label.items():
        for near in body.markers:
            own = segment_of[near] == segment_of[name] and near not in label
            if own and near in markers.names:
                apart = np.linalg.norm(_of(markers, other) - _of(markers, near), axis=-1)
                misfits.append(abs(_median(apart) - distance(on_body[name], on_body[near])))
    return misfits


def _of(markers: Markers, name: str) -> Array:
    return np.asarray(markers.position[:, markers.names.index(name)])


def _to_the_left(markers: Markers, marker_set: MarkerSet) -> Array:
    """Give the horizontal direction to the subject's left, (T, 3); NaN where it is unknown."""
    ends = []
    for choices in ((("LASIS", "RASIS"),), (("LPSIS", "RPSIS"), ("SACR",))):
        labels = [[marker_set.landmark.get(name, "") for name in choice] for choice in choices]
        present = [labels for labels in labels if set(labels) <= set(markers.names)]
        if not present:
            return np.full((len(markers.time), 3), np.nan)
        own = [markers.names.index(label) for label in present[0]]
        ends.append(markers.position[:, own].mean(axis=1))
    forward = (ends[0] - ends[1]) * [1.0, 1.0, 0.0]
    length = np.linalg.norm(forward, axis=1, keepdims=True)
    forward = np.where(length > MIN_FORWARD_M, forward, np.nan) / length
    return np.cross([0.0, 0.0, 1.0], forward)


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
