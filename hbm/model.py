"""The body, and its form for the kernels and for Pinocchio."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hbm.coordinates import (
    COORDINATES,
    FIRST_Q,
    LAST_Q,
    SEGMENTS,
    SEGMENTS_WITH_MASS,
    TREE,
)
from hbm.kernels.skeleton import JOINTED_SEGMENTS, SUBJECT_AXES
from hbm.markers import MarkerSet
from hbm.notes import Note
from hbm.segments import Inertia, Sex
from hbm.spatial import Array, read_only


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
        Marker names, (K,); ``marker_segment`` is the segment of each, ``marker_position`` its
        position in that segment's frame, (K, 3) [m].
    offsets
        Segment -> its proximal joint in the parent's frame, (3,) [m].
    axes
        Coordinate -> hinge axis, (3,), for the hinges that the subject's landmarks define.
    inertias
        Segment with mass -> mass, centre of mass and moment of inertia in its frame.
    lengths
        Inertial part of de Leva's table, with its side -> distance between its ends [m].
    locked
        Coordinates that none of the markers depends on; they stay at zero.
    notes
        What was estimated or substituted.

    Examples
    --------
    With ``body`` from `build_body`:

    >>> print(body)
    74.6 kg, 1.78 m, male; markers: 46 of Human Body Model 2, full body, 46 markers
    >>> f"{body.inertias['right_thigh'].mass:.2f} kg"
    '10.56 kg'
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
    inertias: Mapping[str, Inertia]
    lengths: Mapping[str, float]
    locked: tuple[str, ...]
    notes: tuple[Note, ...]

    def __post_init__(self) -> None:
        expected = (len(self.markers), 3)
        if np.shape(self.marker_position) != expected:
            raise ValueError(
                f"body: marker_position must have shape {expected}, "
                f"got {np.shape(self.marker_position)}"
            )
        object.__setattr__(self, "marker_position", read_only(self.marker_position))
        for name in ("offsets", "axes"):
            vectors = {key: read_only(v) for key, v in getattr(self, name).items()}
            object.__setattr__(self, name, vectors)

    def __str__(self) -> str:
        return (
            f"{self.mass:.1f} kg, {self.height_m:.2f} m, {self.sex}; "
            f"markers: {len(self.markers)} of {self.marker_set.title}"
        )

    @property
    def model(self) -> Any:
        """The same body as a `pinocchio.Model` (see `pin_model`)."""
        return pin_model(self)

    @property
    def geometry(self) -> Array:
        """Offsets and hinge axes as one vector, in the order of the kernels."""
        axes = [self.axes[COORDINATES[i]] for i in SUBJECT_AXES]
        return np.concatenate([*(self.offsets[s] for s in JOINTED_SEGMENTS), *axes])

    @property
    def inertia_vector(self) -> Array:
        """Mass, centre and inertia (xx yy zz xy xz yz) of the segments with mass as one vector."""
        rows = []
        for s in SEGMENTS_WITH_MASS:
            i, t = self.inertias[s], self.inertias[s].tensor
            products = [t[0, 1], t[0, 2], t[1, 2]]
            rows.append([i.mass, *i.center, *np.diag(t), *products])
        return np.concatenate(rows)


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
        46 single-axis joints: joint ``i + 1`` is coordinate ``i`` of `hbm.coordinates.COORDINATES`;
        operational frames carry the segments and markers.

    Raises
    ------
    ModuleNotFoundError
        On Windows, for which Pinocchio has no wheel; nothing else of the package needs it.
    """
    import pinocchio as pin

    model = pin.Model()
    model.name = "human_body_model"
    for i, c in enumerate(TREE):
        axis = np.array(body.axes[c.name] if c.axis is None else c.axis)
        first = i == FIRST_Q[c.segment] and c.segment in body.offsets
        offset = np.array(body.offsets[c.segment]) if first else np.zeros(3)
        kind = pin.JointModelPrismaticUnaligned if c.translates else pin.JointModelRevoluteUnaligned
        model.addJoint(c.parent + 1, kind(*axis), pin.SE3(np.eye(3), offset), c.name)
    for s, part in body.inertias.items():
        inertia = pin.Inertia(part.mass, np.array(part.center), np.array(part.tensor))
        model.appendBodyToJoint(LAST_Q[s] + 1, inertia, pin.SE3.Identity())
    for s in SEGMENTS:
        model.addFrame(pin.Frame(s, LAST_Q[s] + 1, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    rows = zip(body.markers, body.marker_segment, body.marker_position, strict=True)
    for name, s, position in rows:
        pose = pin.SE3(np.eye(3), np.array(position))
        model.addFrame(pin.Frame(name, LAST_Q[s] + 1, 0, pose, pin.FrameType.SENSOR))
    return model
