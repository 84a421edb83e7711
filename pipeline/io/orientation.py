"""How a subject stands in the axes of a file, as its markers show: up, left and forward."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.markers import MarkerSet, recognise_marker_set
from hbm.spatial import Array

PELVIS_AND_SHOULDERS: Final = ("ASIS", "PSIS", "SHO")
HEELS: Final = ("HEE",)
TOES: Final = ("TOE", "MT2", "MT5")
ANKLES: Final = ("LM", "MM")
"""Landmarks without their side."""
USUAL_LABELS: Final = {
    "ASIS": ("ASI", "ASIS"),
    "PSIS": ("PSI", "PSIS"),
    "SHO": ("SHO", "ACR", "ACROMIUM", "ACROMION"),
    "HEE": ("HEE", "HEEL", "CAL"),
    "TOE": ("TOE", "TOETIP", "MT1"),
    "MT2": ("MT2",),
    "MT5": ("MT5",),
    "LM": ("ANK", "LM"),
    "MM": ("MM",),
}
"""Landmark -> how laboratories label its marker, after the letter of the side."""
MAX_LENGTH_RATIO: Final = 5.0
"""Of a vector between two markers to its median: no joint changes it so much, a damaged number or a
mislabelled frame does."""

Pair = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Sites:
    """Columns of the markers that show how a subject stands.

    Attributes
    ----------
    high, low
        Markers of pelvis and shoulders, and of the feet.
    across
        (right, left) markers, by their labels "left/right"; of pelvis and shoulders where there
        are any.
    on_trunk
        Whether those are of pelvis and shoulders.
    feet
        (heel, toe) markers of one foot.
    """

    high: tuple[int, ...]
    low: tuple[int, ...]
    across: Mapping[str, Pair]
    on_trunk: bool
    feet: tuple[Pair, ...]


def find_sites(names: Sequence[str], marker_set: MarkerSet | None = None) -> Sites:
    """Find the markers that show how a subject stands.

    Parameters
    ----------
    names
        Marker labels.
    marker_set
        The set that they are of, whose landmarks they mark; by default the shipped set that the
        labels belong to. What neither shows is judged by usual labels.

    Returns
    -------
    Sites
        Their columns.
    """
    column = {name: k for k, name in enumerate(names)}
    known = marker_set or _recognised(names)
    marked = known.present(names).landmark if known is not None else {}
    of_set = {landmark: column[marker] for landmark, marker in marked.items()}
    of_labels = _by_usual_labels(column)
    sources = (of_set, of_labels)
    trunk = next(filter(None, (_sides(s, PELVIS_AND_SHOULDERS) for s in sources)), [])
    across = trunk or _sides(of_set) or _sides(column)
    feet = next(filter(None, map(_feet, sources)), [])
    return Sites(
        high=next(filter(None, (_of(s, PELVIS_AND_SHOULDERS) for s in sources)), ()),
        low=next(filter(None, (_of(s, (*HEELS, *TOES, *ANKLES)) for s in sources)), ()),
        across={f"{names[left]}/{names[right]}": (right, left) for right, left in across},
        on_trunk=bool(trunk),
        feet=tuple(feet),
    )


def rise(position: Array, sites: Sites) -> Array | None:
    """Give the vector from feet to pelvis and shoulders, (3,); None where it is not seen."""
    high, low = (_middle(position[:, list(columns)]) for columns in (sites.high, sites.low))
    vector = typical(high - low)
    return vector if np.isfinite(vector).all() else None


def between(position: Array, pairs: Iterable[Pair]) -> Array:
    """Give the vectors from the first to the second marker of each pair, (T, pairs, 3)."""
    start, end = np.reshape(np.array([*pairs], int), (-1, 2)).T
    return np.asarray(position[:, end] - position[:, start])


def typical(vectors: Array) -> Array:
    """Give the mean of vectors, (N, 3), without gaps and those far longer than most."""
    known = vectors[np.isfinite(vectors).all(axis=-1)]
    if not len(known):
        return np.full(3, np.nan)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(known, axis=-1)
    return np.asarray(known[length <= MAX_LENGTH_RATIO * np.median(length)].mean(axis=0))


def _recognised(names: Sequence[str]) -> MarkerSet | None:
    try:
        return recognise_marker_set(names)
    except ValueError:
        return None


def _by_usual_labels(column: Mapping[str, int]) -> dict[str, int]:
    landmarks = {label: site for site, labels in USUAL_LABELS.items() for label in labels}
    found: dict[str, int] = {}
    for name, k in column.items():
        plain = name.replace(".", "").replace("_", "").upper()
        if plain[:1] in ("L", "R") and plain[1:] in landmarks:
            found.setdefault(plain[0] + landmarks[plain[1:]], k)
    return found


def _sides(columns: Mapping[str, int], sites: Sequence[str] | None = None) -> list[Pair]:
    """Give (right, left) columns of the landmarks or labels that differ by their side only."""
    opposite = {"L": "R", "l": "r"}
    return [
        (columns[other], k)
        for name, k in columns.items()
        if name[:1] in opposite
        and (other := opposite[name[0]] + name[1:]) in columns
        and (sites is None or name[1:] in sites)
    ]


def _of(columns: Mapping[str, int], sites: Sequence[str]) -> tuple[int, ...]:
    return tuple(k for name, k in columns.items() if name[1:] in sites)


def _feet(columns: Mapping[str, int]) -> list[Pair]:
    return [
        (columns[side + heel], columns[side + toe])
        for side in "LR"
        for heel in HEELS
        for toe in TOES
        if side + heel in columns and side + toe in columns
    ]


def _middle(points: Array) -> Array:
    """Give the mean of the points seen in each frame, (T, 3); NaN where none is."""
    seen = np.isfinite(points).all(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.where(seen, points, 0.0).sum(axis=1) / seen.sum(axis=1))
