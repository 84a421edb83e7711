"""The body of a simulated person: a tree of single-axis joints, poses, markers, and momentum.

The coordinates are the 46 of the Human Body Model, then joints that it does not have: one in the
middle of the trunk, and the knee's translation, abduction and rotation. Their coordinates are zero
in a person whose mechanics are those of the Human Body Model.

The wrench of the ground is the rate of change of momentum of the segments and of soft tissue; the
true joint moments of legs are what the segments beyond a joint need and the ground does not give.
Newton's and Euler's laws for the person's true body; nothing of it is shared with `hbm.dynamics`.

Arrays have time last, so that every operation runs over contiguous memory: rotations are
``[3, 3, T]``, places ``[3, T]``. Callers go through a trial in chunks that stay in the cache.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hbm.coordinates import COORDINATES, TREE, Vector
from hbm.segments import Inertia
from hbm.spatial import GRAVITY_MPS2, Array

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
        # the Human Body Model's tree, with the trunk split in two and the ankle in two joints
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
        # forward as it is, abduction and rotation inwards on both sides
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

    @property
    def mass(self) -> float:
        """Mass of the whole body [kg]."""
        return float(sum(part.mass for part in self.inertias.values()))


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
    skeleton: Skeleton, motion: tuple[Array, ...], names: Iterable[str] = SEGMENTS
) -> dict[str, Frame]:
    """Compute the frames of segments.

    Parameters
    ----------
    skeleton
        The person's.
    motion
        Coordinates, (55, T) [rad and m]; if accelerations are wanted, followed by their first and
        second derivatives.
    names
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
    needed = _with_carriers(tuple(names))
    identity = np.zeros((3, 3, count))
    identity[[0, 1, 2], [0, 1, 2]] = 1.0
    still = np.zeros((3, count))
    made: dict[str, Frame] = {
        "ground": Frame((identity, *(np.zeros((3, 3, count)),) * (orders - 1)), still, still)
    }
    for k, link in enumerate(LINKS):
        if link.segment not in needed:
            continue
        # a segment begins at its joint in the frame that carries it; each coordinate then moves it
        if link.segment not in made:
            carrier = made[link.parent]
            offset = skeleton.offsets.get(link.segment, np.zeros(3))
            made[link.segment] = placed(carrier, offset) if np.any(offset) else carrier
        q = tuple(values[COLUMN[link.name]] for values in motion)
        if any(np.any(values) for values in q):
            made[link.segment] = moved(made[link.segment], link, skeleton.axes[k], q)
    del made["ground"]
    return made


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
    """Divide frames into parts that stay in the cache.

    A segment's rotation with its derivatives then takes 440 kB, which the second-level cache holds;
    fewer frames cost more calls.
    """
    size = 2048
    return (slice(k, k + size) for k in range(0, count, size))


def marker_positions(skeleton: Skeleton, q: Array) -> Array:
    """Give the markers' positions at coordinates (55, T), (T, M, 3) [m]."""
    position = np.empty((q.shape[1], len(skeleton.markers), 3))
    for part in chunks(q.shape[1]):
        made = frames(skeleton, (q[:, part],), dict.fromkeys(skeleton.marker_segment))
        for k, segment in enumerate(skeleton.marker_segment):
            position[part, k] = made[segment].point(skeleton.marker_position[k]).T
    return position


def segment_poses(skeleton: Skeleton, q: Array, names: list[str]) -> list[tuple[Array, Array]]:
    """Give rotation and origin of some segments, (T, 3, 3) and (T, 3) [m] each."""
    rotations = [np.empty((q.shape[1], 3, 3)) for _ in names]
    origins = [np.empty((q.shape[1], 3)) for _ in names]
    for part in chunks(q.shape[1]):
        made = frames(skeleton, (q[:, part],), names)
        for name, rotation, origin in zip(names, rotations, origins, strict=True):
            rotation[part] = np.moveaxis(made[name].rotation[0], 2, 0)
            origin[part] = made[name].origin.T
    return list(zip(rotations, origins, strict=True))


@cache
def _with_carriers(names: tuple[str, ...]) -> frozenset[str]:
    needed = set()
    for name in names:
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
    # o' = o + R a q, differentiated twice
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
    # an oblique axis: into a frame whose z axis it is, turned about that, and back
    to_axis = _basis(*axis)
    turned = tuple(np.asarray(to_axis.T @ rotation) for rotation in frame.rotation)
    back = (np.asarray(to_axis @ rotation) for rotation in _about(turned, 2, q))
    return Frame(tuple(back), frame.origin, frame.acceleration)


def _about(rotation: tuple[Array, ...], k: int, q: tuple[Array, ...]) -> tuple[Array, ...]:
    """Turn frames about their own axis ``k``; with derivatives where ``q`` has them."""
    i, j = (k + 1) % 3, (k + 2) % 3
    # both columns beside the axis turn into each other; by the product rule the angle's rate and
    # acceleration enter before the columns are turned
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


@dataclass(frozen=True, slots=True)
class WobblingMass:
    """A point mass on springs in a segment.

    Attributes
    ----------
    segment
        What carries it.
    mass_kg
        Its mass, part of the segment's.
    place
        Where it is in the T-pose: the segment's centre of mass, (3,) [m], segment frame.
    frequency_hz, damping
        Natural frequency and damping ratio, equal in all directions.
    """

    segment: str
    mass_kg: float
    place: Array
    frequency_hz: float
    damping: float


class Oscillator:
    """Integrates a wobbling mass through a trial, chunk by chunk.

    Notes
    -----
    ``d̈ + 2 ζ ω ḋ + ω² d = -Rᵀ (a - g)`` in the segment's frame, with the acceleration ``a`` of the
    place in which the mass rests, relative to its value at the start. Solved exactly for a right
    side that is linear between samples.
    """

    def __init__(self, wobbling: WobblingMass, rate_hz: float) -> None:
        self.mass = wobbling
        self._omega = 2 * np.pi * wobbling.frequency_hz
        denominator = np.array([1.0, 2 * wobbling.damping * self._omega, self._omega**2])
        self._filters = [
            cont2discrete((np.array(numerator), denominator), 1 / rate_hz, method="foh")[:2]
            for numerator in ([1.0], [1.0, 0.0])
        ]
        self._states = [np.zeros((3, 2)), np.zeros((3, 2))]
        self._start: Array | None = None

    def add_reaction(self, wrench: Array, frame: Frame) -> None:
        """Add to a ground wrench (6, T) what the mass changes by not moving with the bone."""
        rotation, first, second = frame.rotation
        place = self.mass.place
        # -Rᵀ (a - g) of its place, less that at the start, drives the mass relative to the bone
        rest, at_rest = frame.point(place), frame.point_acceleration(place)
        at_rest[2] += GRAVITY_MPS2
        drive = -np.einsum("ijt,it->jt", rotation, at_rest)
        if self._start is None:
            self._start = drive[:, :1].copy()
        drive -= self._start
        shift, speed = (self._step(k, drive) for k in range(2))
        # d̈, and from it the acceleration of R d in the lab, with that of the turning frame
        pull = drive - 2 * self.mass.damping * self._omega * speed - self._omega**2 * shift
        away = _turned(rotation, shift)
        more = _turned(second, shift) + 2 * _turned(first, speed) + _turned(rotation, pull)
        # the extra force acts in the place of rest, and the whole force away from it by R d
        force, extra = self.mass.mass_kg * (at_rest + more), self.mass.mass_kg * more
        add_force(wrench, extra, rest)
        wrench[3:] += np.cross(away, force, axis=0)

    def _step(self, k: int, drive: Array) -> Array:
        numerator, denominator = (np.ravel(row) for row in self._filters[k])
        out, self._states[k] = lfilter(numerator, denominator, drive, axis=1, zi=self._states[k])
        return np.asarray(out)


def _turned(rotation: Array, vectors: Array) -> Array:
    """Apply rotations (3, 3, T) to vectors (3, T)."""
    return np.asarray(np.einsum("ijt,jt->it", rotation, vectors))


def ground_wrench(
    skeleton: Skeleton, motion: tuple[Array, Array, Array], oscillators: Sequence[Oscillator] = ()
) -> Array:
    """Give the wrench that the ground must exert on a person.

    Parameters
    ----------
    skeleton
        The person's.
    motion
        Coordinates and their first and second derivatives, (55, T) each [rad and m, s].
    oscillators
        Wobbling masses, which the motion at equal intervals drives from rest.

    Returns
    -------
    Array
        In lab axes about the lab origin, (T, 6) [N, N·m].

    Notes
    -----
    Newton's and Euler's laws for the whole body: the wrench is the sum over all mass of
    ``(p̈ - g) dm`` and ``p × (p̈ - g) dm``. With ``p = o + R x`` in each segment both integrals
    depend on its mass, its centre and ``J = ∫ x xᵀ dm`` alone: the moment of ``R x × R̈ x`` is the
    antisymmetric part of ``R J R̈ᵀ``.
    """
    count = motion[0].shape[1]
    wrench = np.zeros((6, count))
    parts = [(name, part, second_moment(part)) for name, part in skeleton.inertias.items()]
    for chunk in chunks(count):
        made = frames(skeleton, tuple(values[:, chunk] for values in motion))
        in_chunk = wrench[:, chunk]  # a view, to which all segments add
        for name, part, moment in parts:
            add_segment(in_chunk, made[name], part, moment)
        for oscillator in oscillators:
            oscillator.add_reaction(in_chunk, made[oscillator.mass.segment])
    return wrench.T


def center_of_mass(skeleton: Skeleton, q: Array) -> Array:
    """Give the centre of mass at coordinates (55, T), (T, 3) [m]."""
    center = np.zeros((3, q.shape[1]))
    for chunk in chunks(q.shape[1]):
        made = frames(skeleton, (q[:, chunk],))
        for name, part in skeleton.inertias.items():
            center[:, chunk] += part.mass * made[name].point(part.center)
    return center.T / skeleton.mass


def second_moment(part: Inertia) -> Array:
    """Give ``∫ x xᵀ dm`` of a segment about its frame's origin, (3, 3) [kg·m²]."""
    # the tensor is ∫ (|x|² 1 - x xᵀ) dm, its trace 2 ∫ |x|² dm; then about the frame's origin
    about_center = np.trace(part.tensor) / 2 * np.eye(3) - part.tensor
    return np.asarray(about_center + part.mass * np.outer(part.center, part.center))


def add_force(wrench: Array, force: Array, place: Array) -> None:
    """Add a force (3, T) [N] that acts at a place (3, T) [m] to a wrench (6, T)."""
    wrench[:3] += force
    wrench[3:] += np.cross(place, force, axis=0)


def add_segment(wrench: Array, frame: Frame, part: Inertia, moment: Array) -> None:
    """Add what a segment with a `second_moment` needs to a wrench (6, T) about the lab origin."""
    # ∫ (ö - g + R̈ x) dm acts with the moment o × that, and ∫ R x × (ö - g) dm is beside it
    rotation, _, second = frame.rotation
    first = part.mass * part.center
    arm, inertial = first @ rotation, first @ second
    upward = frame.acceleration.copy()
    upward[2] += GRAVITY_MPS2
    add_force(wrench, part.mass * upward + inertial, frame.origin)
    # ∫ R x × R̈ x dm: the antisymmetric part of R J R̈ᵀ
    turned = np.asarray(moment @ rotation)
    spin = [
        (turned[j] * second[k]).sum(axis=0) - (turned[k] * second[j]).sum(axis=0)
        for j, k in ((1, 2), (2, 0), (0, 1))
    ]
    wrench[3:] += np.cross(arm, upward, axis=0) + spin


LEG_JOINTS: Final = {
    "toes": (),
    "foot": ("FootPronation",),
    "talus": ("AnklePlantarFlexion",),
    "shank": ("KneeFlexion",),
    "thigh": ("HipFlexion", "HipAbduction", "HipInternalRotation"),
}
"""Segments of a leg from its tip on -> coordinates of the joint that carries each."""
LEG_COORDINATES: Final = tuple(
    letter + name for letter in "RL" for names in LEG_JOINTS.values() for name in names
)


def moments_of(
    skeleton: Skeleton,
    state: tuple[Array, ...],
    feet: Mapping[str, Array],
    oscillators: Sequence[Oscillator],
) -> Array:
    """Give the moments of `LEG_COORDINATES`, (12, T), in a state (55, T) with feet under (T, 6)."""
    made = frames(skeleton, state, [f"{side}_{part}" for side in feet for part in LEG_JOINTS])
    moments = dict[str, Array]()
    for side, wrench in feet.items():
        # what a joint has to give: all that the segments beyond it need, less what the ground gives
        need = -wrench.T
        for part in LEG_JOINTS:
            segment = f"{side}_{part}"
            if segment in skeleton.inertias:
                inertia = skeleton.inertias[segment]
                add_segment(need, made[segment], inertia, second_moment(inertia))
            for oscillator in oscillators:
                if oscillator.mass.segment == segment:
                    oscillator.add_reaction(need, made[segment])
            # about the axes of the joint's coordinates, each where those before it have turned it
            carrier = made[PARENT[segment]]
            frame = Frame(carrier.rotation[:1], carrier.origin, carrier.acceleration)
            frame = placed(frame, skeleton.offsets.get(segment, np.zeros(3)))
            for link, axis in zip(LINKS, skeleton.axes, strict=True):
                if link.segment == segment:
                    about = need[3:] - np.cross(frame.origin, need[:3], axis=0)
                    moments[link.name] = np.sum((axis @ frame.rotation[0]) * about, axis=0)
                    frame = moved(frame, link, axis, (state[0][COLUMN[link.name]],))
    return np.stack([moments[name] for name in LEG_COORDINATES])
