"""The body: the subject's joints and segments, and both as a Pinocchio model."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from hbm.coordinates import (
    COORDINATES,
    FIXED_TO,
    LAST_Q,
    MOVING,
    RIGID_BODIES,
    SUBJECT_AXES,
    SUBJECT_OFFSETS,
    TREE,
)
from hbm.markers import MarkerSet
from hbm.notes import Note
from hbm.segments import NO_INERTIA, Inertia, Sex
from hbm.spatial import Array, freeze_arrays, read_only

MODEL_NAME: Final = "human_body_model"
"""Name of the body in other programs."""


class Joint(NamedTuple):
    """A single-axis joint of a subject: a coordinate, its place and its axis.

    Attributes
    ----------
    name
        The coordinate.
    segment
        The segment or point that it moves, together with the other coordinates of the same joint.
    parent
        Number of the joint before it in the chain, -1 at the ground.
    translates
        Whether it is a translation along its axis [m] instead of a rotation about it [rad].
    axis
        Axis in the frame before its motion, unit vector (3,).
    offset
        Its place in the frame that the joint before it leads to, (3,) [m].
    """

    name: str
    segment: str
    parent: int
    translates: bool
    axis: Array
    offset: Array


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A subject on the skeleton.

    Attributes
    ----------
    mass, sex, height_m
        Body mass [kg], sex, stature [m] (given, or estimated from the legs).
    marker_set
        The marker set it was built with.
    markers
        Marker names, (K,); ``marker_segment`` is the segment or shoulder point of each,
        ``marker_position`` its position in that frame, (K, 3) [m].
    offsets
        Segment or point -> its joint in the parent's frame, (3,) [m]; for all but the pelvis.
    axes
        Coordinate -> its axis, unit vector (3,), where the subject's landmarks define it.
    segments
        Segment -> mass, centre of mass and moment of inertia in its frame; that of the mid trunk
        is the frame of the thorax, to which it is fixed.
    lengths
        Segment -> distance between the ends that its inertia is scaled to [m].
    locked
        Coordinates that none of the markers depends on; they stay at zero.
    notes
        What was estimated or substituted.
    landmark_rules
        Landmarks without markers, and what replaced each, for texts.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> print(body)
    74.6 kg, 1.78 m, male; markers: 46 of Human Body Model 2, full body, 46 markers
    >>> len(body.segments), f"{body.segments['right_thigh'].mass:.2f} kg"
    (18, '10.56 kg')
    >>> knee = next(joint for joint in body.joints if joint.name == "RKneeFlexion")
    >>> knee.segment, body.joints[knee.parent].segment
    ('right_shank', 'right_thigh')
    >>> body.locked
    ('RToeFlexion', 'LToeFlexion')
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
    segments: Mapping[str, Inertia]
    lengths: Mapping[str, float]
    locked: tuple[str, ...]
    notes: tuple[Note, ...]
    landmark_rules: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze_arrays(self, "body", marker_position=(len(self.markers), 3))
        for name in ("offsets", "axes"):
            vectors = {key: read_only(vector) for key, vector in getattr(self, name).items()}
            object.__setattr__(self, name, vectors)

    def __str__(self) -> str:
        return (
            f"{self.mass:.1f} kg, {self.height_m:.2f} m, {self.sex}; "
            f"markers: {len(self.markers)} of {self.marker_set.title}"
        )

    @property
    def segment_of(self) -> dict[str, str]:
        """Marker -> the segment or shoulder point that it is on."""
        return dict(zip(self.markers, self.marker_segment, strict=True))

    @property
    def joints(self) -> tuple[Joint, ...]:
        """One joint per coordinate, each after its parent."""
        joints = []
        for i, c in enumerate(TREE):
            axis = np.array(self.axes[c.name] if c.axis is None else c.axis, float)
            offset = self.offsets[c.segment] if i in SUBJECT_OFFSETS else np.zeros(3)
            joints.append(Joint(c.name, c.segment, c.parent, c.translates, axis, offset))
        return tuple(joints)

    @property
    def geometry(self) -> Array:
        """The subject's own offsets and axes as one vector, in the order of the kernels."""
        offsets = [self.offsets[TREE[i].segment] for i in SUBJECT_OFFSETS]
        return np.concatenate([*offsets, *(self.axes[COORDINATES[i]] for i in SUBJECT_AXES)])

    @property
    def rigid_bodies(self) -> dict[str, Inertia]:
        """Rigid body -> its inertia together with that of the segments fixed to it."""
        bodies = {s: self.segments[s] for s in RIGID_BODIES}
        for s, carrier in FIXED_TO.items():
            bodies[carrier] += self.segments[s]
        return bodies

    @property
    def inertia_vector(self) -> Array:
        """Mass, centre and inertia (xx yy zz xy xz yz) of the rigid bodies as one vector."""
        parts = list(self.rigid_bodies.values())
        tensors = np.array([part.tensor for part in parts])
        # a symmetric tensor has six numbers
        six = tensors[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        masses, centers = [part.mass for part in parts], [part.center for part in parts]
        return np.column_stack([masses, centers, six]).ravel()

    @property
    def model(self) -> Any:
        """The same body as a `pinocchio.Model` (see `pin_model`)."""
        return pin_model(self)


@lru_cache(maxsize=8)
def pin_model(body: Body) -> Any:
    """Write the body as a Pinocchio model.

    Parameters
    ----------
    body
        The subject.

    Returns
    -------
    pinocchio.Model
        Joint ``i + 1`` is ``body.joints[i]``. Frames carry the 18 segments with their inertias,
        the shoulder points and the markers; a fixed joint leads from the thorax to the mid trunk.

    Raises
    ------
    ImportError
        On Windows, for which Pinocchio has no wheel.
    """
    import pinocchio as pin

    model = pin.Model()
    model.name = MODEL_NAME
    frame: dict[str, int] = {}

    def attach(name: str, kind: Any, to: str, offset: Array, part: Inertia = NO_INERTIA) -> int:
        # Pinocchio counts the universe as joint 0
        place, joint = pin.SE3(np.eye(3), np.array(offset)), LAST_Q[to] + 1
        inertia = pin.Inertia(part.mass, np.array(part.center), np.array(part.tensor))
        return int(model.addFrame(pin.Frame(name, joint, frame[to], place, kind, inertia)))

    for joint in body.joints:
        prismatic, revolute = pin.JointModelPrismaticUnaligned, pin.JointModelRevoluteUnaligned
        kind = (prismatic if joint.translates else revolute)(*joint.axis)
        place = pin.SE3(np.eye(3), np.array(joint.offset))
        number = model.addJoint(joint.parent + 1, kind, place, joint.name)
        frame[joint.segment] = model.addJointFrame(number)
    for s, carrier in FIXED_TO.items():
        frame[s] = attach(f"{s}_joint", pin.FrameType.FIXED_JOINT, carrier, np.zeros(3))
    for s in (*MOVING, *FIXED_TO):
        part = body.segments.get(s, NO_INERTIA)
        frame[s] = attach(s, pin.FrameType.BODY, s, np.zeros(3), part)
    rows = zip(body.markers, body.marker_segment, body.marker_position, strict=True)
    for name, s, position in rows:
        attach(name, pin.FrameType.SENSOR, s, position)
    return model
