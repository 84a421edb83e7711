"""Which shipped marker set a recording's labels belong to."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from hbm.markers.marker_set import MarkerSet, SetMarker
from hbm.markers.table import marker_sets
from hbm.spelling import differing_case, listed

MIN_SHARE_OF_PART: Final = 1 / 2
"""Of a part's markers that must be present for a set to show it: other sets share fewer labels."""

MAX_LABELS_LISTED: Final = 8
"""In an error message."""

REMEDY: Final = "rename them (--rename) or give a marker set of your own (--marker-set)"

UPPER_PARTS: Final = {
    "thorax": "trunk",
    "head": "head",
    **{
        f"{side}_{segment}": "arms"
        for side in ("left", "right")
        for segment in ("shoulder", "upper_arm", "forearm", "hand")
    },
}
"""Segment above the pelvis -> the part of the body that it belongs to."""


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
        are completed by the markers of other sets, if all sets with such a label agree on it; the
        result is then named after both sets.

    Raises
    ------
    ValueError
        If the labels match no set; the message names the nearest.
    """
    names = list(names)
    if not names:
        raise ValueError("there are no markers; export the file again with their trajectories")
    sets = marker_sets().values()
    shown = [chosen for chosen in sets if not _short_of(_lower_body(chosen), names)]
    if not shown:
        raise ValueError(_mismatch(_nearest(sets, names), names))
    return _completed(_nearest(shown, names), names)


def _nearest(sets: Iterable[MarkerSet], names: list[str]) -> MarkerSet:
    """Give the set of which most is present: of pelvis and legs, then of all; else the smaller."""

    def fit(chosen: MarkerSet) -> tuple[int, int, int]:
        present = chosen.present(names).markers
        lower = [marker for marker in present if marker.segment not in UPPER_PARTS]
        return len(lower), len(present), -len(chosen.markers)

    return max(sets, key=fit)


def _lower_body(chosen: MarkerSet) -> list[SetMarker]:
    return [m for m in chosen.markers if m.segment not in UPPER_PARTS and not m.optional]


def _short_of(markers: list[SetMarker], names: Iterable[str]) -> bool:
    """Whether too few of a part's markers are present; of none, none are."""
    return len(_absent(markers, names)) > (1 - MIN_SHARE_OF_PART) * len(markers) or not markers


def _mismatch(nearest: MarkerSet, names: list[str]) -> str:
    """Say what the nearest set lacks, and what to do."""
    needed = _lower_body(nearest)
    missing = sorted(marker.labels[0] for marker in _absent(needed, names))
    known = [n for each in marker_sets().values() for m in each.markers for n in m.labels]
    more = ", …" if len(missing) > MAX_LABELS_LISTED else ""
    if len(missing) == len(needed):
        return (
            f"the markers match no known set: none of {listed(names, 4)} is a marker of pelvis or "
            f"legs{differing_case(names, known)}; {REMEDY}"
        )
    return (
        f"the markers match no known set; nearest is {nearest.name!r} with "
        f"{len(needed) - len(missing)} of its {len(needed)} markers of pelvis and legs (missing "
        f"{', '.join(missing[:MAX_LABELS_LISTED])}{more}){differing_case(names, known)}; {REMEDY}"
    )


def _absent(markers: Iterable[SetMarker], names: Iterable[str]) -> list[SetMarker]:
    names = set(names)
    return [marker for marker in markers if names.isdisjoint(marker.labels)]


def _completed(chosen: MarkerSet, names: list[str]) -> MarkerSet:
    """Add other sets' markers of trunk, head and arms where the chosen set's are not there."""
    own: dict[str, list[SetMarker]] = {part: [] for part in UPPER_PARTS.values()}
    for marker in chosen.markers:
        if marker.segment in UPPER_PARTS and not marker.optional:
            own[UPPER_PARTS[marker.segment]].append(marker)
    parts = [part for part, markers in own.items() if _short_of(markers, names)]
    known = {label for marker in chosen.markers for label in marker.labels}
    marked = chosen.present(names).landmark
    added: list[SetMarker] = []
    for name in names:
        meant = {
            (m.segment, m.landmark)
            for s in marker_sets().values()
            for m in s.markers
            if name in m.labels
        }
        if name not in known and len(meant) == 1:
            ((segment, landmark),) = meant
            if UPPER_PARTS.get(segment) in parts:
                landmark = None if landmark in marked else landmark
                added.append(SetMarker((name,), segment, landmark, optional=True))
    if not added:
        return chosen
    labels = [marker.labels[0] for marker in added]
    other = _nearest((s for s in marker_sets().values() if s.name != chosen.name), labels)
    shown = dict.fromkeys(UPPER_PARTS[marker.segment] for marker in added)
    return replace(
        chosen,
        name=f"{chosen.name}+{other.name}",
        title=f"{chosen.title}; {' and '.join(shown)} as in {other.title}",
        markers=(*chosen.markers, *added),
    )
