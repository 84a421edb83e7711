"""The body: a subject's geometry, inertias and markers on the skeleton's 46 coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pinocchio as pin

from hbm.calibration import calibration_frames
from hbm.coordinates import COORDINATES, FIRST, LAST, MOVING, SEGMENTS, TREE, support
from hbm.landmarks import HipRule, Measures, locate_anatomy
from hbm.markers import Markers, MarkerSet, marker_sets, recognise_marker_set
from hbm.segments import NOTHING, Inertia, Sex, proportions, segment_inertia
from hbm.shape import Shape, average, shape_of
from hbm.skeleton import OFFSETS, OWN_AXES
from hbm.spatial import Array

PARTS: Final = {
    "pelvis": ("lower_trunk",),
    "trunk": ("mid_trunk", "upper_trunk"),
    "head": ("head",),
    **{
        f"{side}_{part}": (f"{side}_{part}",)
        for side in ("right", "left")
        for part in ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
    },
}
TOES_KG: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Body:
    """A subject on the skeleton.

    Attributes
    ----------
    mass, sex, height_m
        Body mass [kg], sex, stature [m] (given, or estimated from the legs).
    marker_set
        The marker set it was built with.
    markers
        Marker names, (K,); ``marker_segment`` the segment of each, ``marker_position`` its place in
        that segment's frame, (K, 3) [m].
    offsets
        Segment -> its proximal joint in the parent's frame, (3,) [m].
    axes
        Coordinate -> hinge axis, (3,), for the hinges that the subject's landmarks define.
    inertias
        Moving segment -> mass, centre of mass and inertia in its frame.
    locked
        Coordinates that no marker of the set can ever show; they stay at zero.
    notes
        What was estimated, substituted or looks implausible, as sentences.
    model
        The same body as a Pinocchio model: 46 single-axis joints in the order of
        `hbm.coordinates.COORDINATES`, a frame for every marker and segment.
    """

    mass: float
    sex: Sex
    height_m: float
    marker_set: MarkerSet
    markers: tuple[str, ...]
    marker_segment: tuple[str, ...]
    marker_position: Array
    offsets: Mapping[str, Array]
    axes: Mapping[str, Array]
    inertias: Mapping[str, Inertia]
    locked: tuple[str, ...]
    notes: tuple[str, ...]
    model: Any

    @property
    def geometry(self) -> Array:
        """Offsets and hinge axes as one vector, in the order the kernels take them."""
        axes = [self.axes[COORDINATES[i]] for i in OWN_AXES]
        return np.concatenate([*(self.offsets[s] for s in OFFSETS), *axes])

    @property
    def inertia_vector(self) -> Array:
        """Mass, centre and inertia (xx yy zz xy xz yz) of the moving segments as one vector."""
        rows = []
        for s in MOVING:
            i, t = self.inertias[s], self.inertias[s].tensor
            products = [t[0, 1], t[0, 2], t[1, 2]]
            rows.append([i.mass, *i.center, *np.diag(t), *products])
        return np.concatenate(rows)


def build_body(
    static_markers: Markers,
    *,
    mass: float,
    sex: Sex = "unspecified",
    marker_set: str | MarkerSet | None = None,
    height_m: float | None = None,
    window_s: tuple[float, float] | None = None,
    hip: HipRule | Mapping[str, Array] = "harrington",
    knee_width_m: float | None = None,
    ankle_width_m: float | None = None,
    marker_offset_m: float = 0.009,
) -> Body:
    """Build a subject's body from a calibration pose.

    Parameters
    ----------
    static_markers
        A T-pose, A-pose, quiet standing, or any stretch of walking; lab axes, facing anywhere.
    mass
        Body mass [kg].
    sex
        Which column of de Leva's table: "male", "female", or "unspecified" for the mean.
    marker_set
        Name of a shipped set or a set of one's own; by default recognised from the labels.
    height_m
        Stature [m], for parts that no marker shows; by default estimated from the legs.
    window_s
        Start and end of the calibration pose [s]; by default the quietest second.
    hip
        "harrington", "bell", or functional centres (see `hbm.landmarks.Measures`).
    knee_width_m, ankle_width_m, marker_offset_m
        See `hbm.landmarks.Measures`.

    Returns
    -------
    Body
        Geometry averaged over the window, inertias by de Leva (1996).

    Raises
    ------
    ValueError
        If mass or stature is implausible, no marker set fits, or a landmark is missing that
        nothing can stand in for.
    """
    if not 10 <= mass <= 400:
        hint = "; that looks like grams, give kilograms" if mass > 1000 else ""
        raise ValueError(f"body mass must be between 10 and 400 kg, got {mass:g}{hint}")
    if height_m is not None and not 0.5 <= height_m <= 2.6:
        raise ValueError(f"stature must be between 0.5 and 2.6 m, got {height_m:g}")
    chosen = _choose(marker_set, static_markers)
    measures = Measures(sex, hip, knee_width_m, ankle_width_m, marker_offset_m)
    table = proportions(sex)

    used = [name for name in static_markers.names if name in chosen.segment]
    columns = [static_markers.names.index(name) for name in used]
    frames, said = calibration_frames(static_markers, used, window_s)
    anatomies = []
    for f in frames:
        position = static_markers.position[f, columns]
        at = {n: p for n, p in zip(used, position, strict=True) if not np.isnan(p[0])}
        landmarks = {mark: at[name] for mark, name in chosen.landmark.items() if name in at}
        anatomies.append((at, locate_anatomy(landmarks, measures)))
    notes = [said, *dict.fromkeys(note for _, a in anatomies for note in a.notes)]
    if height_m is None:
        height_m = float(np.mean([_stature(a.points, table) for _, a in anatomies]))
        notes.append(f"stature estimated from the legs: {height_m:.2f} m")
    height = height_m
    shape = average([shape_of(a, table, height, at, chosen.segment) for at, a in anatomies])

    share = {
        p: table[p.split("_", 1)[1] if p.startswith(("right_", "left_")) else p] for p in shape.ends
    }
    inertias = {s: NOTHING for s in MOVING}
    for s, parts in PARTS.items():
        for part in parts:
            inertias[s] += segment_inertia(share[part], mass, *shape.ends[part])
    for side in ("right", "left"):
        foot = inertias[f"{side}_foot"]
        inertias[f"{side}_foot"] = replace(foot, mass=foot.mass - TOES_KG)
        inertias[f"{side}_toes"] = Inertia(TOES_KG, np.zeros(3), TOES_KG * 1e-4 * np.eye(3))
    markers = tuple(name for name in used if name in shape.markers)
    segments = tuple(chosen.segment[name] for name in markers)
    position = np.array([shape.markers[name] for name in markers])
    position.setflags(write=False)
    locked = _unseen(set(segments))
    return Body(
        mass=float(mass),
        sex=sex,
        height_m=height_m,
        marker_set=chosen,
        markers=markers,
        marker_segment=segments,
        marker_position=position,
        offsets=MappingProxyType(shape.offsets),
        axes=MappingProxyType(shape.axes),
        inertias=MappingProxyType(inertias),
        locked=locked,
        notes=tuple(notes),
        model=pin_model(shape, inertias, dict(zip(markers, segments, strict=True))),
    )


def _choose(marker_set: str | MarkerSet | None, markers: Markers) -> MarkerSet:
    if marker_set is None:
        return recognise_marker_set(markers.names)
    if isinstance(marker_set, MarkerSet):
        return marker_set
    if marker_set not in marker_sets():
        raise ValueError(f"no marker set {marker_set!r}; known: {', '.join(marker_sets())}")
    return marker_sets()[marker_set]


def _stature(points: Mapping[str, Array], table: Mapping[str, Any]) -> float:
    """Stature from the length of both legs by de Leva's mean proportions."""
    legs = [
        np.linalg.norm(points[f"{side}_{a}"] - points[f"{side}_{b}"])
        for side in ("right", "left")
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    return float(np.sum(legs) / (2 * (table["thigh"].length + table["shank"].length)))


def _unseen(seen: set[str]) -> tuple[str, ...]:
    """Coordinates beyond which no marker rides."""
    shown = {i for s in seen for i in support(LAST[s])}
    return tuple(name for i, name in enumerate(COORDINATES) if i not in shown)


def pin_model(shape: Shape, inertias: Mapping[str, Inertia], segment: Mapping[str, str]) -> Any:
    """Write the body as a Pinocchio model.

    Parameters
    ----------
    shape
        Offsets, hinge axes and marker positions in segment frames.
    inertias
        Moving segment -> inertia.
    segment
        Marker -> segment.

    Returns
    -------
    pinocchio.Model
        Joint ``i + 1`` is coordinate ``i``; operational frames carry the markers and segments.
    """
    model = pin.Model()
    model.name = "human_body_model"
    for i, c in enumerate(TREE):
        axis = np.array(shape.axes[c.name] if c.axis is None else c.axis)
        first = i == FIRST[c.segment] and c.segment in shape.offsets
        offset = shape.offsets[c.segment] if first else np.zeros(3)
        kind = pin.JointModelPrismaticUnaligned if c.translates else pin.JointModelRevoluteUnaligned
        model.addJoint(c.parent + 1, kind(*axis), pin.SE3(np.eye(3), offset), c.name)
    for s, part in inertias.items():
        inertia = pin.Inertia(part.mass, np.array(part.center), np.array(part.tensor))
        model.appendBodyToJoint(LAST[s] + 1, inertia, pin.SE3.Identity())
    for s in SEGMENTS:
        model.addFrame(pin.Frame(s, LAST[s] + 1, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    for name, s in segment.items():
        place = pin.SE3(np.eye(3), shape.markers[name])
        model.addFrame(pin.Frame(name, LAST[s] + 1, 0, place, pin.FrameType.SENSOR))
    return model
