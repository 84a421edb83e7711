"""Marker sets: the segment that each marker is attached to, and the landmark that it marks."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

_MIDLINE: Final = {
    "SACR": "sacrum, midway between the posterior superior iliac spines",
    "C7": "spinous process of the 7th cervical vertebra",
    "T2": "spinous process of the 2nd thoracic vertebra",
    "T8": "spine at the lower angles of the shoulder blades, the level of T7 to T8",
    "T10": "spinous process of the 10th thoracic vertebra",
    "JN": "jugular notch of the sternum",
    "XIPH": "xiphoid process",
    "THEAD": "top of the head",
    "GLAB": "glabella, between the eyebrows",
}
_PAIRED: Final = {
    "ASIS": "anterior superior iliac spine",
    "PSIS": "posterior superior iliac spine",
    "HEAD": "side of the head, level with the other one",
    "FHEAD": "front of the head, beside the middle",
    "BHEAD": "back of the head, beside the middle",
    "MAS": "mastoid process",
    "GTRO": "greater trochanter",
    "LEK": "lateral epicondyle of the femur",
    "MEK": "medial epicondyle of the femur",
    "KAX": "knee alignment device, end of its rod along the flexion axis",
    "KD1": "knee alignment device, end of a rod at a right angle to that one",
    "KD2": "knee alignment device, end of the rod at a right angle to both",
    "LM": "lateral malleolus",
    "MM": "medial malleolus",
    "HEE": "back of the heel, at the height of MT2",
    "MT1": "head of the 1st metatarsal",
    "MT2": "head of the 2nd metatarsal",
    "MT5": "head of the 5th metatarsal",
    "TOE": "tip of the second toe",
    "SHO": "acromion",
    "LEE": "lateral epicondyle of the humerus",
    "MEE": "medial epicondyle of the humerus",
    "LW": "ulnar styloid, the little finger's side of the wrist",
    "MW": "radial styloid, the thumb's side of the wrist",
    "WRA": "bar across the back of the wrist, its end on the thumb's side",
    "WRB": "bar across the back of the wrist, its end on the little finger's side",
    "FIN": "head of the 3rd metacarpal, on the back of the hand",
}

LANDMARKS: Final = _MIDLINE | {
    side + name: f"{meaning}, {word}"
    for side, word in (("L", "left"), ("R", "right"))
    for name, meaning in _PAIRED.items()
}
"""Landmark that a marker can mark -> what it is."""


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
            Labels in the recording.

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
        names = set(names)
        shown = [(m, next((n for n in m.labels if n in names), None)) for m in self.markers]
        markers = tuple(replace(m, labels=(label,)) for m, label in shown if label is not None)
        return replace(self, markers=markers)
