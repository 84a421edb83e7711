"""The body of a simulated person: a tree of single-axis joints, its segments' poses, and markers.

The coordinates are the 46 of the Human Body Model, then joints that it does not have: one in the
middle of the trunk, and the knee's translation, abduction and rotation. Their coordinates are zero
in a person whose mechanics are those of the Human Body Model.

Arrays have time last, so that every operation runs over contiguous memory: rotations are
``[3, 3, T]``, places ``[3, T]``. Callers go through a trial in chunks that stay in the cache.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
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


CHUNK_FRAMES: Final = 2048
"""Frames that are computed at a time: a segment's rotation with its derivatives then takes 440 kB,
which stays in the second-level cache; fewer frames cost more calls."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A segment's frame over time.

    Attributes
    ----------
    rotation
        Orientation (columns: the segment's axes) and its time derivatives, up to two,
        (3, 3, T) each [1, 1/s, 1/s²].
    origin
        Place of its joint, (3, T) [m].
    acceleration
        Second derivative of that place, (3, T) [m/s²]; empty where only poses are computed.
    """

    rotation: tuple[Array, ...]
    origin: Array
    acceleration: Array

    def point(self, place: Array) -> Array:
        """Give the position of a point of the segment, (3, T) [m]."""
        return self.origin + _times(self.rotation[0], place)

    def point_acceleration(self, place: Array) -> Array:
        """Give the acceleration of a point that is fixed to the segment, (3, T) [m/s²]."""
        return self.acceleration + _times(self.rotation[2], place)


def frames(
    skeleton: Skeleton, motion: tuple[Array, ...], wanted: Iterable[str] = SEGMENTS
) -> dict[str, Frame]:
    """Compute the frames of segments.

    Parameters
    ----------
    skeleton
        The person's.
    motion
        Coordinates, (55, T) [rad and m]; if accelerations are wanted, followed by their first and
        second derivatives.
    wanted
        Segments; what carries them is computed too, and given as well.

    Returns
    -------
    dict of str to Frame
        By segment.

    Notes
    -----
    Rotation matrices are differentiated as such: with the rotation ``A(q)`` of a joint,
    ``R' = R A``, ``Ṙ' = Ṙ A + R Ȧ`` and ``R̈' = R̈ A + 2 Ṙ Ȧ + R Ä``. A point fixed to a segment has
    the acceleration ``ö + R̈ x``.
    """
    orders, count = len(motion), motion[0].shape[1]
    needed = _with_carriers(tuple(wanted))
    identity = np.zeros((3, 3, count))
    identity[[0, 1, 2], [0, 1, 2]] = 1.0
    still = np.zeros((3, count))
    found: dict[str, Frame] = {
        "ground": Frame((identity, *(np.zeros((3, 3, count)),) * (orders - 1)), still, still)
    }
    for k, link in enumerate(LINKS):
        if link.segment not in needed:
            continue
        if link.segment not in found:
            carrier = found[link.parent]
            offset = skeleton.offsets.get(link.segment, np.zeros(3))
            found[link.segment] = placed(carrier, offset) if np.any(offset) else carrier
        q = tuple(values[COLUMN[link.name]] for values in motion)
        if any(np.any(values) for values in q):
            found[link.segment] = moved(found[link.segment], link, skeleton.axes[k], q)
    del found["ground"]
    return found


def moved(frame: Frame, link: Link, axis: Array, q: tuple[Array, ...]) -> Frame:
    """Move a frame by one coordinate, given with its derivatives where the frame has them."""
    return (_translated if link.translates else _rotated)(frame, axis, q)


def placed(frame: Frame, offset: Array) -> Frame:
    """Move a frame's origin to a point of it, (3,) [m]."""
    acceleration = frame.acceleration
    if len(frame.rotation) == 3:
        acceleration = frame.point_acceleration(offset)
    return Frame(frame.rotation, frame.point(offset), acceleration)


def chunks(count: int) -> Iterator[slice]:
    """Divide frames into parts that stay in the cache."""
    return (slice(k, k + CHUNK_FRAMES) for k in range(0, count, CHUNK_FRAMES))


def marker_positions(skeleton: Skeleton, q: Array) -> Array:
    """Give the markers' positions at coordinates (55, T), (T, M, 3) [m]."""
    position = np.empty((q.shape[1], len(skeleton.markers), 3))
    for part in chunks(q.shape[1]):
        found = frames(skeleton, (q[:, part],), dict.fromkeys(skeleton.marker_segment))
        for k, segment in enumerate(skeleton.marker_segment):
            position[part, k] = found[segment].point(skeleton.marker_position[k]).T
    return position


def segment_poses(skeleton: Skeleton, q: Array, names: list[str]) -> list[tuple[Array, Array]]:
    """Give rotation and origin of some segments, (T, 3, 3) and (T, 3) [m] each."""
    rotations = [np.empty((q.shape[1], 3, 3)) for _ in names]
    origins = [np.empty((q.shape[1], 3)) for _ in names]
    for part in chunks(q.shape[1]):
        found = frames(skeleton, (q[:, part],), names)
        for name, rotation, origin in zip(names, rotations, origins, strict=True):
            rotation[part] = np.moveaxis(found[name].rotation[0], 2, 0)
            origin[part] = found[name].origin.T
    return list(zip(rotations, origins, strict=True))


@cache
def _with_carriers(wanted: tuple[str, ...]) -> frozenset[str]:
    needed = set()
    for name in wanted:
        segment: str | None = name
        while segment is not None and segment != "ground":
            needed.add(segment)
            segment = PARENT.get(segment)
    return frozenset(needed)


def _times(rotation: Array, place: Array) -> Array:
    """Apply rotations (3, 3, T) to a constant vector (3,), (3, T)."""
    return np.asarray(place @ rotation)


def _translated(frame: Frame, axis: Array, q: tuple[Array, ...]) -> Frame:
    along = [_times(rotation, axis) for rotation in frame.rotation]
    origin, acceleration = frame.origin + along[0] * q[0], frame.acceleration
    if len(q) == 3:
        acceleration = acceleration + along[2] * q[0] + 2 * along[1] * q[1] + along[0] * q[2]
    return Frame(frame.rotation, origin, acceleration)


def _rotated(frame: Frame, axis: Array, q: tuple[Array, ...]) -> Frame:
    along = np.flatnonzero(axis)
    if len(along) == 1:
        sign = float(axis[along[0]])
        rotation = _about(frame.rotation, int(along[0]), tuple(sign * value for value in q))
        return Frame(rotation, frame.origin, frame.acceleration)
    to_axis = _basis(*axis)
    turned = tuple(np.asarray(to_axis.T @ rotation) for rotation in frame.rotation)
    back = (np.asarray(to_axis @ rotation) for rotation in _about(turned, 2, q))
    return Frame(tuple(back), frame.origin, frame.acceleration)


def _about(rotation: tuple[Array, ...], k: int, q: tuple[Array, ...]) -> tuple[Array, ...]:
    """Turn frames about their own axis ``k``; with derivatives where ``q`` has them."""
    i, j = (k + 1) % 3, (k + 2) % 3
    cosine, sine = np.cos(q[0]), np.sin(q[0])
    pairs = [(rotation[0][:, i], rotation[0][:, j])]
    if len(q) == 3:
        (y, z), rate, second = pairs[0], q[1], q[2]
        y1, z1 = rotation[1][:, i], rotation[1][:, j]
        square, twice = rate * rate, 2 * rate
        pairs.append((y1 + rate * z, z1 - rate * y))
        pairs.append(
            (
                rotation[2][:, i] + twice * z1 + second * z - square * y,
                rotation[2][:, j] - twice * y1 - second * y - square * z,
            )
        )
    turned = []
    for old, (y, z) in zip(rotation, pairs, strict=True):
        new = np.empty_like(old)
        new[:, k] = old[:, k]
        new[:, i] = cosine * y + sine * z
        new[:, j] = cosine * z - sine * y
        turned.append(new)
    return tuple(turned)


@lru_cache(maxsize=256)
def _basis(x: float, y: float, z: float) -> Array:
    """Give a rotation whose third column is a unit vector, (3, 3)."""
    axis = np.array([x, y, z])
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis])
