"""Marker trajectories, and marker sets: the segment and the landmark of each marker.

Sets are tables, shipped with the package or a user's own, and are recognised by their labels.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import groupby
from os.path import commonprefix
from shlex import quote
from typing import Any, Final

import numpy as np

from hbm.coordinates import LIMBS, MOVING, SIDES
from hbm.numbers import read_numbers
from hbm.spatial import Array, frozen, read_only
from hbm.spelling import did_you_mean, listed, no_segment, packaged_toml, parse_toml, short, shown

LIMITS: Final = read_numbers("hbm", "thresholds.toml", "marker_sets")


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
        x, y, z = np.moveaxis(np.isnan(coordinates), 1, 0)
        partly = (x != y) | (y != z)
        if partly.any() or not coordinates.flags.c_contiguous:
            coordinates = np.array(coordinates, order="C")
            np.moveaxis(coordinates, 1, -1)[partly] = np.nan
            frozen(coordinates)
        object.__setattr__(self, "time", read_only(time))
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "position", np.moveaxis(read_only(coordinates), -1, 0))

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]: the median of the time steps."""
        return float(1 / np.median(np.diff(self.time)))


LANDMARKS: Final = (
    *("SACR", "C7", "T2", "T8", "T10", "JN", "XIPH", "THEAD", "GLAB"),
    *(
        side + name
        for side in ("L", "R")
        for name in (
            *("ASIS", "PSIS", "HEAD", "FHEAD", "BHEAD", "MAS"),
            *("GTRO", "LEK", "MEK", "KAX", "KD1", "KD2", "LM", "MM"),
            *("HEE", "MT1", "MT2", "MT5", "MTS", "TOE"),
            *("SHO", "LEE", "MEE", "LW", "MW", "WRA", "WRB", "FIN"),
        )
    ),
)
"""Landmarks that a marker can mark; docs/marker_sets.md says what they are."""


@dataclass(frozen=True, slots=True)
class SetMarker:
    """A marker of a marker set.

    Attributes
    ----------
    labels
        Its label; where laboratories spell it differently, all of its labels.
    segment
        What it is attached to.
    landmark
        What it marks; None if it only tracks its segment.
    optional
        Whether the set is complete without it: a medial marker that only the calibration pose has,
        or one that only some laboratories add.
    """

    labels: tuple[str, ...]
    segment: str
    landmark: str | None = None
    optional: bool = False


@dataclass(frozen=True, slots=True)
class MarkerSet:
    """The segment that each marker is attached to, and the landmark that it marks.

    Attributes
    ----------
    name, title
        Short name and description.
    markers
        Its markers.

    Examples
    --------
    >>> import hbm
    >>> chosen = hbm.marker_sets()["hbm2"]
    >>> chosen.segment["LLTHI"], chosen.landmark["C7"]
    ('left_thigh', 'C7')
    """

    name: str
    title: str
    markers: tuple[SetMarker, ...]

    @property
    def segment(self) -> dict[str, str]:
        """Label -> segment; of several labels of a marker the first."""
        return {marker.labels[0]: marker.segment for marker in self.markers}

    @property
    def landmark(self) -> dict[str, str]:
        """Landmark -> label. Where two markers mark it, the optional one does."""
        by_need = sorted(self.markers, key=lambda marker: marker.optional)
        return {m.landmark: m.labels[0] for m in by_need if m.landmark is not None}

    def present(self, names: Iterable[str]) -> "MarkerSet":
        """Give the markers that a recording has, each by its label there.

        Parameters
        ----------
        names
            Labels in the recording; upper and lower case are the same.

        Returns
        -------
        MarkerSet
            Without the markers that are absent.

        Examples
        --------
        Where the medial knee markers are, in a recording that has them by another label:

        >>> import hbm
        >>> chosen = hbm.marker_sets()["pig"]
        >>> chosen.present(["LKNE", "LMEPI", "LTHI"]).landmark
        {'LLEK': 'LKNE', 'LMEK': 'LMEPI'}
        """
        spelt = _spelling(names)
        shown = [(m, next(filter(None, map(spelt, m.labels)), None)) for m in self.markers]
        markers = (
            m if m.labels == (label,) else replace(m, labels=(label,))
            for m, label in shown
            if label is not None
        )
        return replace(self, markers=tuple(markers))


def _spelling(names: Iterable[str]) -> Callable[[str], str | None]:
    """Give a function: label of a set -> the recording's, which may differ in case, or None."""
    names = list(names)
    exact, folded = set(names), {name.casefold(): name for name in reversed(names)}
    return lambda label: label if label in exact else folded.get(label.casefold())


EITHER_SIDE: Final = "?"
"""In a label: stands for L and R."""


def read_marker_set(text: str, name: str = "own") -> MarkerSet:
    """Read a marker set from TOML.

    Parameters
    ----------
    text
        TOML with a table ``[markers]``: ``LABEL = ["segment"]`` for a tracking marker,
        ``LABEL = ["segment", "LANDMARK"]`` for a landmark. A table ``[optional]`` of the same form
        and ``title`` may be there, and ``extends``, the names of shipped sets that it adds to;
        the head of ``marker_sets.toml`` and docs/marker_sets.md describe them.
    name
        Its name, also in errors.

    Returns
    -------
    MarkerSet
        The checked set.

    Raises
    ------
    ValueError
        If the text is not TOML or has no ``[markers]``, or a segment, landmark or set to extend is
        unknown, or a label or landmark occurs twice; the message lists all such faults.

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
        table = parse_toml(text)
    except ValueError as error:
        raise ValueError(f"marker set {name!r} is not valid TOML: {error}") from error
    if not isinstance(table.get("markers"), dict) or not table["markers"]:
        raise ValueError(f"marker set {name!r} needs a [markers] table with at least one marker")
    return _marker_set(name, table, marker_sets())


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
    hbm2_lower: Human Body Model 2, lower limbs and trunk, 26 markers
    hbm2: Human Body Model 2, full body, 46 markers
    hbm1_lower: Human Body Model 1, lower limbs and trunk, 25 markers
    hbm1: Human Body Model 1, full body, 47 markers
    pig_lower: Plug-in-Gait, lower body, 16 markers
    pig: Plug-in-Gait, full body, 39 markers
    cgm2_lower: CGM2.3 and 2.4, lower body, 24 markers
    cgm2: CGM2.3 to 2.5, full body, 47 markers
    ior_lower: Rizzoli (IOR), lower body, 20 markers
    ior: Rizzoli (IOR), lower body and trunk, 27 markers
    rajagopal_lower: Rajagopal 2015 and Arnold 2013, pelvis and legs, 26 markers
    rajagopal: Rajagopal 2015 and Arnold 2013, full body, 48 markers
    gait2354: OpenSim Gait2354, Gait2392 and Hamner 2010, 43 markers
    opencap: OpenCap, 35 markers
    helen_hayes_lower: Helen Hayes and Cleveland Clinic, pelvis and legs, 15 markers
    helen_hayes: Helen Hayes and Cleveland Clinic, full body, 21 markers
    coda: Codamotion, pelvis and legs, 20 markers
    """
    sets: dict[str, MarkerSet] = {}
    for name, table in packaged_toml("hbm", "marker_sets.toml").items():
        sets[name] = _marker_set(name, table, sets)
    return sets


def _marker_set(name: str, table: Mapping[str, Any], sets: Mapping[str, MarkerSet]) -> MarkerSet:
    faults: list[str] = []
    rows = _markers(table.get("markers", {}), False, faults)
    rows += _markers(table.get("optional", {}), True, faults)
    faults += _repeated(rows)
    if not isinstance(table.get("title", ""), str):
        faults.append(f"title must be a text, got {shown(table['title'])}")
    markers = (*_inherited(table.get("extends", []), rows, sets, faults), *rows)
    if faults:
        raise ValueError(f"marker set {name!r}: " + "; ".join(dict.fromkeys(faults)))
    return MarkerSet(name, table.get("title", name), markers)


def _markers(table: Any, optional: bool, faults: list[str]) -> list[SetMarker]:
    """Read a table of markers. Rows for either side in sequence: all left ones, then the right."""
    if not isinstance(table, dict):
        faults.append(f"[optional] must be a table like [markers], got {shown(table)}")
        return []
    markers = []
    for either, rows in groupby(table.items(), key=lambda row: EITHER_SIDE in row[0]):
        sequence = list(rows)
        for side in reversed(SIDES) if either else ("",):
            read = (_marker(key, entry, side, optional, faults) for key, entry in sequence)
            markers += [marker for marker in read if marker is not None]
    return markers


def _marker(key: str, entry: Any, side: str, optional: bool, faults: list[str]) -> SetMarker | None:
    """Read a row, for one side if it stands for either; None where nothing can be read."""
    words = isinstance(entry, list) and all(isinstance(word, str) for word in entry)
    if not (words and len(entry) in (1, 2)):
        faults.append(f"{short(key)} must be [segment] or [segment, landmark], got {shown(entry)}")
        return None
    letter, (segment, landmark) = SIDES.get(side, ""), (*entry, None)[:2]
    segments = {s.removeprefix(f"{side}_"): s for s in MOVING} | {s: s for s in MOVING}
    landmarks = {name.removeprefix(letter): name for name in LANDMARKS if name.startswith(letter)}
    landmarks |= {name: name for name in LANDMARKS if name not in landmarks}
    if segment not in segments:
        faults.append(f"{short(key)}: {no_segment(segment, segments)}")
    if landmark is not None and landmark not in landmarks:
        hint = did_you_mean(landmark, landmarks)
        faults.append(f"{short(key)}: no landmark {shown(landmark)}{hint}")
    labels = tuple(key.replace(EITHER_SIDE, letter if side else EITHER_SIDE).split("|"))
    return SetMarker(
        labels, segments.get(segment, segment), landmarks.get(landmark or ""), optional
    )


def _repeated(markers: list[SetMarker]) -> list[str]:
    """Find labels that occur twice, and landmarks that two markers of the same need mark."""
    labels = Counter(label for marker in markers for label in marker.labels)
    faults = [f"label {short(label)} occurs twice" for label, count in labels.items() if count > 1]
    first: dict[tuple[str, bool], str] = {}
    for marker in markers:
        if marker.landmark is not None:
            other = first.setdefault((marker.landmark, marker.optional), marker.labels[0])
            if other != marker.labels[0]:
                faults.append(f"{marker.labels[0]} and {other} both mark {marker.landmark}")
    return faults


def _inherited(
    names: Any, rows: list[SetMarker], sets: Mapping[str, MarkerSet], faults: list[str]
) -> list[SetMarker]:
    """Give the markers of the sets that a set extends, where it does not say otherwise itself."""
    names = [names] if isinstance(names, str) else names
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        faults.append(f"extends must be the name of a set or a list of them, got {shown(names)}")
        return []
    for name in names:
        if name not in sets:
            hint = did_you_mean(name, sets) or f", known: {', '.join(sets)}"
            faults.append(f"extends: no marker set {shown(name)}{hint}")
    labels = {label for marker in rows for label in marker.labels}
    needed = {marker.landmark for marker in rows if not marker.optional}
    optional = {marker.landmark for marker in rows if marker.optional}
    inherited: list[SetMarker] = []
    for marker in (m for name in names if name in sets for m in sets[name].markers):
        if labels.isdisjoint(marker.labels) and marker not in inherited:
            taken = needed | optional if marker.optional else needed
            landmark = None if marker.landmark in taken else marker.landmark
            inherited.append(replace(marker, landmark=landmark))
    return inherited


REMEDY: Final = (
    "rename them (--rename OLD=NEW), or write a table of them (--marker-set set.toml, "
    "docs/marker_sets.md)"
)
WORD: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
SIDE_WORDS: Final = {word: word[0] for word in ("l", "lt", "left", "r", "rt", "right")}
"""First or last word of a label -> letter of the side."""

UPPER_PARTS: Final = {"thorax": "trunk", "head": "head"} | {
    segment: "arms" for side in SIDES for segment in LIMBS[f"{side} arm"]
}
"""Segment above the pelvis -> the part of the body that it belongs to."""

LOWER_BODY: Final = "legs"
"""The part that pelvis and legs are."""


def recognise_marker_set(names: Iterable[str]) -> MarkerSet:
    """Find the shipped marker set that a recording's labels belong to.

    Parameters
    ----------
    names
        Labels in the recording.

    Returns
    -------
    MarkerSet
        The set of whose pelvis and legs most markers are present, of equals that of which most are
        present at all, of equals the one with fewer markers. Half of its markers of pelvis and legs
        must be, those that are optional not counted. A trunk, head or arms of which less is present
        are completed by the markers of other sets, and pelvis and legs by landmarks that are not
        marked, if all sets with such a label agree on it; the result is then named after both sets.

    Raises
    ------
    ValueError
        If the labels match no set; the message lists labels and the two nearest sets.
    """
    return _recognised(tuple(names))


@lru_cache
def _recognised(names: tuple[str, ...]) -> MarkerSet:
    """Recognise the set of labels; the files of a study have the same ones."""
    if not names:
        raise ValueError("there are no markers; export the file again with their trajectories")
    sets = marker_sets().values()
    shown = [chosen for chosen in sets if not _short_of(chosen, names)]
    if not shown:
        raise ValueError(_mismatch(names))
    return _completed(_nearest(shown, names), names)


def _legs_shown(chosen: MarkerSet, names: Iterable[str]) -> int:
    """Count the markers of pelvis and legs that are present."""
    return sum(m.segment not in UPPER_PARTS for m in chosen.present(names).markers)


def _nearest(sets: Iterable[MarkerSet], names: Iterable[str]) -> MarkerSet:
    """Give the set of which most is present: of pelvis and legs, then of all; else the smaller."""

    def fit(chosen: MarkerSet) -> tuple[int, int, int]:
        present = len(chosen.present(names).markers)
        return _legs_shown(chosen, names), present, -len(chosen.markers)

    return max(sets, key=fit)


def _needed(chosen: MarkerSet, part: str = LOWER_BODY) -> list[SetMarker]:
    """Give the markers of a part of the body without which the set is not complete."""
    needed = (marker for marker in chosen.markers if not marker.optional)
    return [marker for marker in needed if UPPER_PARTS.get(marker.segment, LOWER_BODY) == part]


def _short_of(chosen: MarkerSet, names: Iterable[str], part: str = LOWER_BODY) -> bool:
    """Whether too few of the markers of a part are present; of none, none are."""
    needed = _needed(chosen, part)
    return len(_absent(needed, names)) > (1 - LIMITS.least_of_part) * len(needed) or not needed


def _mismatch(names: tuple[str, ...]) -> str:
    """Say which labels there are, what the two nearest sets lack, and what to do."""
    sets = [one for one in marker_sets().values() if _legs_shown(one, names)]
    nearest: list[MarkerSet] = []
    # the two nearest, each of another family
    while sets and len(nearest) < 2:
        nearest.append(_nearest(sets, names))
        family = nearest[-1].name.removesuffix("_lower")
        sets = [one for one in sets if one.name.removesuffix("_lower") != family]
    lacking = "; ".join(_lacking(one, names) for one in nearest)
    hint = f"nearest: {lacking}" if nearest else "none of them is of a shipped set"
    # what all labels begin with, letter by letter, may be a person's name
    shared = re.compile(r"[^\W_]*$").sub("", commonprefix(names))  # noqa: RUF071
    bare = [f"{'…' if shared else ''}{name[len(shared) :]}" for name in names]
    text = f"the markers match no shipped set; labels: {listed(bare, 20)}"
    if shared:
        text += " (… is what all begin with; --label-prefix removes it)"
    options = [f"--rename {quote(f'{old}={new}')}" for old, new in renaming(names).items()]
    return f"{text}; {hint}; {' '.join(['try', *options]) if options else REMEDY}"


def _lacking(chosen: MarkerSet, names: Sequence[str]) -> str:
    """Say how many markers of a set's pelvis and legs are there, and which are not."""
    needed = _needed(chosen)
    absent = sorted(marker.labels[0] for marker in _absent(needed, names))
    present = f"{chosen.name} with {len(needed) - len(absent)} of its {len(needed)} markers"
    return f"{present} of pelvis and legs (missing {listed(absent)})"


@lru_cache
def renaming(names: tuple[str, ...]) -> Mapping[str, str]:
    """Give labels to rename, old -> new, if their letters and sides alone make them a set's.

    Empty where they are of a set as they stand, or of none by their letters either.
    """
    sets = marker_sets().values()
    if not all(_short_of(s, names) for s in sets):
        return {}
    spelt = {_letters(name): name for name in names} | {name: name for name in names}
    every = (label for s in sets for m in s.markers for label in m.labels)
    name_of = {label: spelt.get(label, spelt.get(_letters(label))) for label in every}
    alike = {label: name for label, name in name_of.items() if name is not None}
    shown = [s for s in sets if not _short_of(s, alike)]
    if not shown:
        return {}
    labels = _completed(_nearest(shown, list(alike)), list(alike)).present(alike).segment
    return {alike[label]: label for label in labels if alike[label] != label}


def exchange(pairs: Iterable[tuple[str, ...]], file: str, every: bool = False) -> str:
    """Give the options that exchange the labels of (left, right) pairs, or all, in one file.

    Examples
    --------
    >>> exchange([("LASI", "RASI")], "static.c3d")
    '--rename static.c3d:LASI=RASI --rename static.c3d:RASI=LASI'
    """
    pairs = [("L*", "R*")] if every else list(pairs)
    of_file = f"{file}:" if file else ""
    both = (names for a, b in pairs for names in ((a, b), (b, a)))
    return " ".join(f"--rename {quote(f'{of_file}{old}={new}')}" for old, new in both)


def _letters(label: str) -> str:
    """Give letters and digits in lower case, with the side first: "Heel_R", "Right Heel": rheel."""
    words = [word.casefold() for word in WORD.findall(label)] or [label]
    for word in (words[0], words[-1]) if len(words) > 1 else ():
        if word in SIDE_WORDS:
            words.remove(word)
            return SIDE_WORDS[word] + "".join(words)
    return "".join(words)


def _absent(markers: Iterable[SetMarker], names: Iterable[str]) -> list[SetMarker]:
    spelt = _spelling(names)
    return [marker for marker in markers if not any(map(spelt, marker.labels))]


@cache
def _meanings() -> Mapping[str, set[tuple[str, str | None]]]:
    """Give segment and landmark of each label of the shipped sets, in lower case."""
    meanings: dict[str, set[tuple[str, str | None]]] = {}
    for marker in (m for chosen in marker_sets().values() for m in chosen.markers):
        for label in marker.labels:
            meanings.setdefault(label.casefold(), set()).add((marker.segment, marker.landmark))
    return meanings


def usual_landmarks(names: Iterable[str]) -> dict[str, str]:
    """Give landmark -> label of three letters or more, as a set means one with the same letters."""
    marked: dict[str, str] = {}
    for name in names:
        if mark := _landmark_of_letters().get(_letters(name)):
            marked.setdefault(mark, name)
    return marked


@cache
def _landmark_of_letters() -> dict[str, str]:
    """Give the letters of labels -> the landmark that sets mean by them."""
    usual: dict[str, str] = {}
    for label, meanings in _meanings().items():
        for landmark in sorted(mark for _, mark in meanings if mark and len(label) > 2):
            usual.setdefault(_letters(label), landmark)
    return usual


def _completed(chosen: MarkerSet, names: Sequence[str]) -> MarkerSet:
    """Add other sets' markers of trunk, head and arms where the chosen set's are not there."""
    parts = {part for part in UPPER_PARTS.values() if _short_of(chosen, names, part)}
    in_set = {label.casefold() for marker in chosen.markers for label in marker.labels}
    marked = set(chosen.present(names).landmark)
    added: list[SetMarker] = []
    for name in names:
        meant = _meanings().get(name.casefold(), set())
        if name.casefold() not in in_set and len(meant) == 1:
            ((segment, landmark),) = meant
            landmark = None if landmark in marked else landmark
            part = UPPER_PARTS.get(segment, LOWER_BODY)
            if part in parts or (part == LOWER_BODY and landmark):
                marked.add(landmark or "")
                added.append(SetMarker((name,), segment, landmark, optional=True))
    if not added:
        return chosen
    labels = [marker.labels[0] for marker in added]
    other = _nearest((s for s in marker_sets().values() if s.name != chosen.name), labels)
    shown = dict.fromkeys(UPPER_PARTS.get(marker.segment, LOWER_BODY) for marker in added)
    return replace(
        chosen,
        name=f"{chosen.name}+{other.name}",
        title=f"{chosen.title}; {' and '.join(shown)} as in {other.title}",
        markers=(*chosen.markers, *added),
    )
