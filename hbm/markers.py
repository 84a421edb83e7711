"""Marker trajectories, and marker sets: the segment and the landmark of each marker."""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np

from hbm.coordinates import MOVING
from hbm.spatial import Array, read_only
from hbm.spelling import did_you_mean, no_segment

LANDMARKS: Final = (
    *("LASIS", "RASIS", "LPSIS", "RPSIS", "SACR", "C7", "T10", "JN", "XIPH"),
    *("LHEAD", "RHEAD", "THEAD"),
    *(f"{side}{name}" for side in "LR" for name in ("GTRO", "LEK", "MEK", "LM", "MM")),
    *(f"{side}{name}" for side in "LR" for name in ("HEE", "MT2", "MT5", "TOE")),
    *(f"{side}{name}" for side in "LR" for name in ("SHO", "LEE", "MEE", "LW", "MW", "FIN")),
)
"""Anatomical landmarks that a marker can mark; ``marker_sets.toml`` explains their names."""

MIN_SHARE_OF_SET: Final = 2 / 3
"""Of a marker set's labels that must be present for a trial to be recognised as using it."""

MAX_LABELS_LISTED: Final = 8
"""In an error message."""


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
        time, position = np.asarray(self.time, float), np.array(self.position, float)
        names = tuple(self.names)
        if position.ndim != 3 or position.shape != (len(time), len(names), 3):
            raise ValueError(
                f"marker positions must have shape ({len(time)}, {len(names)}, 3) "
                f"for {len(time)} times and {len(names)} names, got {position.shape}"
            )
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise ValueError(f"marker names must be unique, but these appear twice: {twice}")
        if len(time) > 1 and not np.all(np.diff(time) > 0):
            raise ValueError("marker times must increase")
        position[np.isnan(position).any(axis=-1)] = np.nan
        object.__setattr__(self, "time", read_only(time))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "position", read_only(position))

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]: the median of the time steps."""
        return float(1 / np.median(np.diff(self.time)))


@dataclass(frozen=True, slots=True)
class MarkerSet:
    """The segment that each marker is attached to, and the landmark that it marks.

    Attributes
    ----------
    name, title
        Short name and description.
    segment
        Marker -> segment.
    landmark
        Landmark -> marker. A marker without a landmark only tracks its segment.

    Examples
    --------
    >>> import hbm
    >>> chosen = hbm.marker_sets()["hbm2"]
    >>> chosen.segment["LLTHI"], chosen.landmark["C7"]
    ('left_thigh', 'C7')
    """

    name: str
    title: str
    segment: Mapping[str, str]
    landmark: Mapping[str, str]


def read_marker_set(text: str, name: str = "own") -> MarkerSet:
    """Read a marker set from TOML.

    Parameters
    ----------
    text
        TOML with a table ``[markers]``: ``LABEL = ["segment"]`` for a tracking marker,
        ``LABEL = ["segment", "LANDMARK"]`` for a landmark. An optional ``title``.
    name
        Its name, also in errors.

    Returns
    -------
    MarkerSet
        The checked set.

    Raises
    ------
    ValueError
        If the text is not TOML or has no ``[markers]``, or a segment or landmark is unknown or
        marked twice; the message lists all such faults.

    Examples
    --------
    >>> import hbm
    >>> lab = hbm.read_marker_set('''
    ... [markers]
    ... LASI = ["pelvis", "LASIS"]
    ... LPEL = ["pelvis"]
    ... ''', name="lab")
    >>> lab.segment
    {'LASI': 'pelvis', 'LPEL': 'pelvis'}
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"marker set {name!r} is not valid TOML: {error}") from error
    if not isinstance(table.get("markers"), dict) or not table["markers"]:
        raise ValueError(f"marker set {name!r} needs a [markers] table with at least one marker")
    return _marker_set(name, table)


def _marker_set(name: str, table: dict[str, Any]) -> MarkerSet:
    segment: dict[str, str] = {}
    landmark: dict[str, str] = {}
    faults = []
    for marker, entry in table["markers"].items():
        words = isinstance(entry, list) and all(isinstance(word, str) for word in entry)
        if not (words and len(entry) in (1, 2)):
            faults.append(f"{marker} must be [segment] or [segment, landmark], got {entry!r}")
            continue
        segment[marker] = entry[0]
        if entry[0] not in MOVING:
            faults.append(f"{marker}: {no_segment(entry[0], MOVING)}")
        if len(entry) == 2:
            if entry[1] not in LANDMARKS:
                hint = did_you_mean(entry[1], LANDMARKS)
                faults.append(f"{marker}: no landmark {entry[1]!r}{hint}")
            elif entry[1] in landmark:
                faults.append(f"{marker} and {landmark[entry[1]]} both mark {entry[1]}")
            landmark[entry[1]] = marker
    if faults:
        raise ValueError(f"marker set {name!r}: " + "; ".join(faults))
    title = str(table.get("title", name))
    return MarkerSet(name, title, segment, landmark)


@cache
def marker_sets() -> Mapping[str, MarkerSet]:
    """Give the marker sets that ship with the package, by name.

    Returns
    -------
    Mapping[str, MarkerSet]
        Name -> set.

    Examples
    --------
    >>> import hbm
    >>> for name, chosen in hbm.marker_sets().items():
    ...     print(f"{name}: {chosen.title}")
    hbm2: Human Body Model 2, full body, 46 markers
    hbm2_lower: Human Body Model 2, lower limbs and trunk, 26 markers
    hbm1: Human Body Model 1, full body, 47 markers
    hbm1_lower: Human Body Model 1, lower limbs and trunk, 25 markers
    """
    text = files("hbm").joinpath("marker_sets.toml").read_text(encoding="utf-8")
    return {name: _marker_set(name, table) for name, table in tomllib.loads(text).items()}


def recognise_marker_set(names: Iterable[str]) -> MarkerSet:
    """Find the shipped marker set that a trial's labels belong to.

    Parameters
    ----------
    names
        Marker labels of the trial.

    Returns
    -------
    MarkerSet
        The set of which most labels are present; of equals the smaller. At least two thirds of
        its labels must be.

    Raises
    ------
    ValueError
        If the labels match no set; the message names the nearest.
    """
    present = set(names)
    found = {s.name: len(present & set(s.segment)) for s in marker_sets().values()}
    best = max(marker_sets().values(), key=lambda s: (found[s.name], -len(s.segment)))
    if found[best.name] < MIN_SHARE_OF_SET * len(best.segment):
        missing = sorted(set(best.segment) - present)
        more = ", …" if len(missing) > MAX_LABELS_LISTED else ""
        raise ValueError(
            f"the markers match no known set; nearest is {best.name!r} with {found[best.name]} of "
            f"{len(best.segment)} present (missing {', '.join(missing[:MAX_LABELS_LISTED])}{more})"
            f"{_other_case(names)}; rename them or give a marker set of your own"
        )
    return best


def _other_case(names: Iterable[str]) -> str:
    """Say which labels differ from known ones only in upper and lower case."""
    known = {name.casefold(): name for each in marker_sets().values() for name in each.segment}
    pairs = [(name, known[name.casefold()]) for name in names if name.casefold() in known]
    differ = [f"{name!r} for {label}" for name, label in pairs if name != label]
    return f"; {len(differ)} differ in case only, such as {differ[0]}" if differ else ""
