"""Marker sets as tables: those that ship with the package, and a user's own."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files
from itertools import groupby
from typing import Any, Final

from hbm.coordinates import MOVING, SIDES
from hbm.markers.marker_set import LANDMARKS, MarkerSet, SetMarker
from hbm.spelling import did_you_mean, no_segment, short, shown
from hbm.toml_text import parse_toml

EITHER_SIDE: Final = "?"
"""In a label: stands for L and R."""

OR: Final = "|"
"""Between the labels of one marker."""


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
    """
    text = files("hbm").joinpath("marker_sets.toml").read_text(encoding="utf-8")
    sets: dict[str, MarkerSet] = {}
    for name, table in parse_toml(text).items():
        sets[name] = _marker_set(name, table, sets)
    return sets


def _marker_set(name: str, table: Mapping[str, Any], known: Mapping[str, MarkerSet]) -> MarkerSet:
    faults: list[str] = []
    own = _markers(table.get("markers", {}), False, faults)
    own += _markers(table.get("optional", {}), True, faults)
    faults += _repeated(own)
    if not isinstance(table.get("title", ""), str):
        faults.append(f"title must be a text, got {shown(table['title'])}")
    markers = (*_inherited(table.get("extends", []), own, known, faults), *own)
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
    letter = SIDES.get(side, "")
    segments = {s.removeprefix(f"{side}_"): s for s in MOVING} | {s: s for s in MOVING}
    landmarks = {name.removeprefix(letter): name for name in LANDMARKS if name.startswith(letter)}
    landmarks |= {name: name for name in LANDMARKS if name not in landmarks}
    segment, landmark = entry[0], entry[1] if len(entry) == 2 else None
    if segment not in segments:
        faults.append(f"{short(key)}: {no_segment(segment, segments)}")
    if landmark is not None and landmark not in landmarks:
        hint = did_you_mean(landmark, landmarks)
        faults.append(f"{short(key)}: no landmark {shown(landmark)}{hint}")
    labels = tuple(key.replace(EITHER_SIDE, letter if side else EITHER_SIDE).split(OR))
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
    names: Any, own: list[SetMarker], known: Mapping[str, MarkerSet], faults: list[str]
) -> list[SetMarker]:
    """Give the markers of the sets that a set extends, where it does not say otherwise itself."""
    names = [names] if isinstance(names, str) else names
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        faults.append(f"extends must be the name of a set or a list of them, got {shown(names)}")
        return []
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known) or f", known: {', '.join(known)}"
            faults.append(f"extends: no marker set {shown(name)}{hint}")
    labels = {label for marker in own for label in marker.labels}
    needed = {marker.landmark for marker in own if not marker.optional}
    optional = {marker.landmark for marker in own if marker.optional}
    inherited: list[SetMarker] = []
    for marker in (m for name in names if name in known for m in known[name].markers):
        if labels.isdisjoint(marker.labels) and marker not in inherited:
            taken = needed | optional if marker.optional else needed
            landmark = None if marker.landmark in taken else marker.landmark
            inherited.append(replace(marker, landmark=landmark))
    return inherited
