"""Joint centres and axes of a subject in the calibration pose, and the measures they depend on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from hbm.notes import Note
from hbm.segments import Sex
from hbm.spatial import Array

HipRule = Literal["harrington", "bell"]
MEDIAL_SIGN: Final = {"right": 1.0, "left": -1.0}
"""Side -> sign of the medial direction, where left is positive."""

MARKER_OFFSET_M: Final = 0.009
"""Distance of a marker's centre from the skin: radius of a 14 mm marker, and a base of 2 mm."""


@dataclass(frozen=True, slots=True)
class LimbMeasures:
    """Measures of one side of a subject, for what its markers do not show; None where unknown [m].

    Attributes
    ----------
    leg_length_m
        From ASIS to medial malleolus.
    knee_width_m, ankle_width_m, elbow_width_m
        Across the epicondyles or malleoli.
    wrist_width_m, hand_thickness_m
        From the back of the wrist or hand to the palm.
    shoulder_offset_m
        From the skin over the acromion to the shoulder's joint centre.
    """

    leg_length_m: float | None = None
    knee_width_m: float | None = None
    ankle_width_m: float | None = None
    elbow_width_m: float | None = None
    wrist_width_m: float | None = None
    hand_thickness_m: float | None = None
    shoulder_offset_m: float | None = None


NOT_MEASURED: Final = LimbMeasures()


@dataclass(frozen=True, slots=True)
class Measures:
    """Properties of a subject that the markers do not show, and the rule for the hips.

    Attributes
    ----------
    sex
        "male", "female" or "unspecified".
    hip
        Hip centre by "harrington" (2007) or "bell" (1990), or functional centres: side -> position
        in the pelvis frame (origin mid-ASIS, x forward, y left, z up), (3,) [m].
    limbs
        Side -> what was measured on it.
    marker_offset_m
        Marker radius plus base plate: distance of a marker's centre from the skin [m].
    """

    sex: Sex = "unspecified"
    hip: HipRule | Mapping[str, Array] = "harrington"
    limbs: Mapping[str, LimbMeasures] = field(default_factory=dict)
    marker_offset_m: float = MARKER_OFFSET_M

    def limb(self, side: str) -> LimbMeasures:
        """Give what was measured on a side."""
        return self.limbs.get(side, NOT_MEASURED)

    def to_center(self, width_m: float | None) -> float | None:
        """Give the distance of a joint's centre from a marker beside it [m]; None if unknown."""
        return None if width_m is None else width_m / 2 + self.marker_offset_m


@dataclass(slots=True)
class Anatomy:
    """Joint centres, axes and segment ends of a subject in the calibration pose.

    Attributes
    ----------
    points
        Positions by name, such as ``right_knee`` or ``neck``, (3,) [m]. Absent for a trunk, head or
        arms without markers.
    axes
        Unit vectors by name, such as ``right_knee``; all point to the subject's left in the
        anatomical position.
    frames
        Orientations of pelvis, thorax and head (columns: forward, left, up), (3, 3). Absent for a
        trunk or head without markers; ``upright`` is how a trunk without markers stands.
    markers
        Landmarks that a device shows in place of their markers, (3,) [m].
    notes
        Rules that replaced missing landmarks.
    """

    points: dict[str, Array] = field(default_factory=dict)
    axes: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)
    markers: dict[str, Array] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


def need(landmarks: Mapping[str, Array], *names: str, purpose: str, instead: str) -> list[Array]:
    """Give landmarks, or raise a ValueError that names the missing and what would replace them."""
    missing = [name for name in names if name not in landmarks]
    if missing:
        raise ValueError(
            f"{purpose} needs the landmark{'s' * (len(missing) > 1)} {', '.join(missing)}, which "
            f"no marker shows in the calibration pose; {instead} would do instead"
        )
    return [landmarks[name] for name in names]
