"""The skeleton of a simulated person: a tree of single-axis joints with segments and markers.

The coordinates are the 46 of the Human Body Model, then joints that it does not have: one in the
middle of the trunk, and the knee's translation, abduction and rotation. Their coordinates are zero
in a person whose mechanics are those of the Human Body Model.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.coordinates import COORDINATES, TREE, Vector
from hbm.segments import Inertia
from hbm.spatial import Array, read_only

SPINE: Final = ("MidTrunkFlexion", "MidTrunkRightBend", "MidTrunkLeftTwist")
"""Of the joint between mid trunk and thorax (T12/L1), in the order of the trunk's own."""
KNEE: Final = ("KneeForward", "KneeAdduction", "KneeInternalRotation")
"""Of a knee, after its flexion: the shank's displacement along its own x axis [m], and rotations
about x and z [rad]; positive as those of the hip."""
EXTRA: Final = (*SPINE, *("R" + name for name in KNEE), *("L" + name for name in KNEE))
ALL_COORDINATES: Final = (*COORDINATES, *EXTRA)
"""Columns of a person's motion."""
COLUMN: Final = {name: k for k, name in enumerate(ALL_COORDINATES)}


@dataclass(frozen=True, slots=True)
class Link:
    """A coordinate's place in the tree.

    Attributes
    ----------
    name
        The coordinate.
    segment, parent
        What it moves, and what carries the joint that it belongs to.
    translates
        Whether it is a translation [m] instead of a rotation [rad].
    axis
        Axis before its motion; None where it is the person's own.
    """

    name: str
    segment: str
    parent: str
    translates: bool
    axis: Vector | None


def _links() -> tuple[Link, ...]:
    links: list[Link] = []
    for row in TREE:
        segment, side = row.segment, row.segment.partition("_")[0]
        if segment == "thorax":
            segment = "mid_trunk"
        elif row.name.endswith("AnklePlantarFlexion"):
            segment = f"{side}_talus"
        parent = "ground" if row.parent < 0 else TREE[row.parent].segment
        if row.name.endswith("FootPronation"):
            parent = f"{side}_talus"
        parent = next((link.parent for link in links if link.segment == segment), parent)
        links.append(Link(row.name, segment, parent, row.translates, row.axis))
        if row.name == "TrunkLeftTwist":
            links += [
                Link(name, "thorax", "mid_trunk", False, link.axis)
                for name, link in zip(SPINE, links[-3:], strict=True)
            ]
        if row.name.endswith("KneeFlexion"):
            letter, inward = row.name[0], 1.0 if row.name[0] == "R" else -1.0
            axes = ((1.0, 0.0, 0.0), (inward, 0.0, 0.0), (0.0, 0.0, inward))
            links += [
                Link(letter + name, segment, parent, name == "KneeForward", axis)
                for name, axis in zip(KNEE, axes, strict=True)
            ]
    return tuple(links)


LINKS: Final = _links()
"""All coordinates, every one after those that carry it."""
SEGMENTS: Final = tuple(dict.fromkeys(link.segment for link in LINKS))
"""What they move, each after its parent; shoulders and tali are massless."""
PARENT: Final = {link.segment: link.parent for link in LINKS if link.segment != "pelvis"}


@dataclass(frozen=True, slots=True, eq=False)
class Skeleton:
    """A person's joints, segments and markers.

    Attributes
    ----------
    axes
        Axis of every coordinate of `LINKS` in the frame before its motion, (55, 3).
    offsets
        Segment -> its joint in the parent's frame, (3,) [m]; for all but the pelvis.
    inertias
        Segment -> mass, centre and tensor in its frame; massless ones are absent.
    markers, marker_segment
        Labels, and the segment of each.
    marker_position
        In that segment's frame, (M, 3) [m].
    """

    axes: Array
    offsets: Mapping[str, Array]
    inertias: Mapping[str, Inertia]
    markers: tuple[str, ...]
    marker_segment: tuple[str, ...]
    marker_position: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", read_only(self.axes))
        object.__setattr__(self, "marker_position", read_only(self.marker_position))

    @property
    def mass(self) -> float:
        """Mass of the whole body [kg]."""
        return float(sum(part.mass for part in self.inertias.values()))

    def axis(self, coordinate: str) -> Array:
        """Give a coordinate's axis, (3,)."""
        return np.asarray(self.axes[_LINK[coordinate]])


_LINK: Final = {link.name: k for k, link in enumerate(LINKS)}
