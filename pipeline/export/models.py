"""A body as a model of other programs: OpenSim 4, and URDF for Pinocchio, MuJoCo and ROS."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from hbm.body import Body
from hbm.coordinates import FIXED_TO, LAST_Q, MOVING, PARENT, TREE
from hbm.model import MODEL_NAME, Joint
from hbm.segments import NO_INERTIA, Inertia
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.io.write import write_text

TOKEN_INERTIA: Final = Inertia(1e-12, np.zeros(3), 1e-14 * np.eye(3))
"""Inertia of links without a segment, since MuJoCo refuses moving links below 1e-15."""
TEMPLATES: Final = Environment(
    loader=PackageLoader("pipeline.export"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_osim(body: Body, path: str | Path) -> None:
    """Write a body as an OpenSim 4 model.

    Parameters
    ----------
    body
        The subject.
    path
        Where to write; by custom it ends in ``.osim``.

    Notes
    -----
    Same joints, axes, inertias and markers, and the same 46 coordinates by name, sign and zero, so
    results go from one program to the other unchanged:

    * Ground is the lab: z up, gravity along -z. (OpenSim's own models have y up; a program that
      draws y up shows the subject lying on the right side.)
    * Each segment has one CustomJoint to its parent: translations along axes of the parent, then
      rotations, each about an axis of the frame that the previous ones led to. Rotations that a
      joint lacks are constant.
    * The mid trunk is welded to the thorax.
    * The shoulder points, which translate on the thorax and have the acromion markers, are bodies
      without mass.
    * All coordinates are free, start at zero and are not clamped; their ranges are those of
      the sliders. Those that no marker shows are free as well.
    """
    moving = []
    for name in MOVING:
        parent = f"/bodyset/{PARENT[name]}" if name in PARENT else "/ground"
        joints = [joint for joint in body.joints if joint.segment == name]
        rotations = _axes([joint for joint in joints if not joint.translates])
        translations = _axes([joint for joint in joints if joint.translates])
        moving.append((name, parent, joints, rotations, translations))
    bodies = [(name, body.segments.get(name, NO_INERTIA)) for name in (*MOVING, *FIXED_TO)]
    of_osim = {"bodies": bodies, "moving": moving, "gravity": (0, 0, -GRAVITY_MPS2)}
    write_template("body.osim", path, **of_osim, **_of_both(body))


def _axes(joints: Sequence[Joint]) -> list[tuple[str, Array]]:
    """Give three axes with their coordinates: those of joints, then others without one."""
    axes = np.array([joint.axis for joint in joints]).reshape(-1, 3)
    # rows of the basis beyond the joints' number are perpendicular to their axes
    _, _, basis = np.linalg.svd(axes)
    names = [joint.name for joint in joints] + [""] * (3 - len(joints))
    return list(zip(names, [*axes, *basis[len(joints) :]], strict=True))


def write_urdf(body: Body, path: str | Path) -> None:
    """Write a body as URDF.

    Parameters
    ----------
    body
        The subject.
    path
        Where to write; by custom it ends in ``.urdf``.

    Notes
    -----
    Same joints, axes, inertias and markers, and the same 46 coordinates by name, sign and zero.
    The root link ``ground`` is the lab: z up.

    * URDF's joints have one axis, so there are links without a segment between the coordinates of a
      joint. They and the shoulder points have 1e-12 kg and 1e-14 kg·m², because MuJoCo refuses
      moving links below 1e-15; forces change by some 1e-10 N.
    * Rotations are ``revolute`` within ±100 rad rather than ``continuous``, which Pinocchio would
      describe by sine and cosine; translations are within ±100 m.
    * The mid trunk is a link on a fixed joint, and so are the markers, without mass. MuJoCo keeps
      them because the file asks it to.
    """
    joints = [
        (joint, _name(joint.parent), _name(i), body.segments.get(_name(i), TOKEN_INERTIA))
        for i, joint in enumerate(body.joints)
    ]
    write_template("body.urdf", path, joints=joints, segments=body.segments, **_of_both(body))


def _name(i: int) -> str:
    """Name the link that coordinate ``i`` moves: a segment's name where it is the last to do so."""
    if i < 0:
        return "ground"
    segment = TREE[i].segment
    return segment if i == LAST_Q[segment] else f"{TREE[i].name}_link"


def _of_both(body: Body) -> dict[str, Any]:
    """Give what both templates show: the model's name, fixed segments and markers."""
    markers = [*zip(body.markers, body.marker_segment, body.marker_position, strict=True)]
    return {"model": MODEL_NAME, "fixed": FIXED_TO, "markers": markers}


def write_template(template: str, path: str | Path, **values: Any) -> None:
    """Fill a template of a document and write it."""
    write_text(TEMPLATES.get_template(template).render(values), Path(path))


def _numbers(values: Iterable[float]) -> str:
    """Write numbers as they are in memory."""
    return " ".join(repr(float(x)) for x in values)


TEMPLATES.filters["numbers"] = _numbers
