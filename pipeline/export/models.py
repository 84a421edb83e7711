"""A body as a model of other programs: OpenSim 4, and URDF for Pinocchio, MuJoCo and ROS."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from hbm.body import Body
from hbm.coordinates import FIXED_TO, LAST_Q, MOVING, PARENT, TREE
from hbm.model import MODEL_NAME, Joint
from hbm.segments import NO_INERTIA, Inertia
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.io.write import whole_file

FORMAT: Final = "40000"
"""Format version in OpenSim 4.0 files."""
RANGE: Final = {True: "-10 10", False: "-6.2831853 6.2831853"}
"""Whether a coordinate translates -> the range of its slider [m or rad]."""
TOKEN_INERTIA: Final = Inertia(1e-12, np.zeros(3), 1e-14 * np.eye(3))
"""Inertia of links without a segment, since MuJoCo refuses moving links below 1e-15."""
LIMITS: Final = {"lower": "-100", "upper": "100", "effort": "1e6", "velocity": "1e6"}
"""Limits of every joint [rad or m], since URDF requires them: beyond what a trial reaches."""


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
    document = ET.Element("OpenSimDocument", Version=FORMAT)
    model = _add(document, "Model", name=MODEL_NAME)
    _add(model, "gravity", _numbers([0, 0, -GRAVITY_MPS2]))
    _add(model, "length_units", "meters")
    _add(model, "force_units", "N")
    bodies = _add(_add(model, "BodySet", name="bodyset"), "objects")
    joints = _add(_add(model, "JointSet", name="jointset"), "objects")
    markers = _add(_add(model, "MarkerSet", name="markerset"), "objects")
    for name in (*MOVING, *FIXED_TO):
        _body(bodies, name, body.segments.get(name, NO_INERTIA))
    for name in MOVING:
        own = [joint for joint in body.joints if joint.segment == name]
        _custom_joint(joints, name, own)
    for name, carrier in FIXED_TO.items():
        _joint(joints, "WeldJoint", name, f"/bodyset/{carrier}", np.zeros(3))
    for name, segment, place in zip(
        body.markers, body.marker_segment, body.marker_position, strict=True
    ):
        marker = _add(markers, "Marker", name=name)
        _add(marker, "socket_parent_frame", f"/bodyset/{segment}")
        _add(marker, "location", _numbers(place))
        _add(marker, "fixed", "true")
    write_xml(document, path)


def _add(parent: ET.Element, tag: str, text: str = "", **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text or None
    return element


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in values)


def _body(bodies: ET.Element, name: str, inertia: Inertia) -> None:
    t = inertia.tensor
    element = _add(bodies, "Body", name=name)
    _add(element, "mass", _numbers([inertia.mass]))
    _add(element, "mass_center", _numbers(inertia.center))
    _add(element, "inertia", _numbers([*np.diag(t), t[0, 1], t[0, 2], t[1, 2]]))


def _joint(joints: ET.Element, kind: str, name: str, parent: str, offset: Array) -> ET.Element:
    """Join a body to a place in its parent."""
    joint = _add(joints, kind, name=f"{name}_joint")
    _add(joint, "socket_parent_frame", "before")
    _add(joint, "socket_child_frame", f"/bodyset/{name}")
    frame = _add(_add(joint, "frames"), "PhysicalOffsetFrame", name="before")
    _add(frame, "socket_parent", parent)
    _add(frame, "translation", _numbers(offset))
    return joint


def _custom_joint(joints: ET.Element, name: str, own: list[Joint]) -> None:
    """Join a body to its parent by single-axis joints."""
    parent = f"/bodyset/{PARENT[name]}" if name in PARENT else "/ground"
    joint = _joint(joints, "CustomJoint", name, parent, own[0].offset)
    coordinates = _add(joint, "coordinates")
    for c in own:
        coordinate = _add(coordinates, "Coordinate", name=c.name)
        for name, value in (("default_value", "0"), ("range", RANGE[c.translates])):
            _add(coordinate, name, value)
        for name in ("clamped", "locked"):
            _add(coordinate, name, "false")
    transform = _add(joint, "SpatialTransform")
    _axes(transform, "rotation", [c for c in own if not c.translates])
    _axes(transform, "translation", [c for c in own if c.translates])


def _axes(transform: ET.Element, kind: str, own: list[Joint]) -> None:
    """Write three axes: the joint's own, then constant ones for those that it lacks."""
    axes = np.array([joint.axis for joint in own]).reshape(-1, 3)
    _, _, basis = np.linalg.svd(axes)
    axes = np.vstack([axes, basis[len(own) :]])
    for k, axis in enumerate(axes):
        element = _add(transform, "TransformAxis", name=f"{kind}{k + 1}")
        _add(element, "coordinates", own[k].name if k < len(own) else "")
        _add(element, "axis", _numbers(axis))
        if k < len(own):
            _add(_add(element, "LinearFunction", name="function"), "coefficients", "1 0")
        else:
            _add(_add(element, "Constant", name="function"), "value", "0")


def write_xml(root: ET.Element, path: str | Path) -> None:
    """Write a document, indented."""
    ET.indent(root)
    with whole_file(Path(path)) as temporary:
        ET.ElementTree(root).write(temporary, encoding="UTF-8", xml_declaration=True)


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
    robot = ET.Element("robot", name=MODEL_NAME)
    ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler", fusestatic="false")
    ET.SubElement(robot, "link", name="ground")
    for i, joint in enumerate(body.joints):
        _link(robot, _name(i), body.segments.get(_name(i), TOKEN_INERTIA))
        kind = "prismatic" if joint.translates else "revolute"
        element = _urdf_joint(robot, joint.name, kind, _name(joint.parent), _name(i), joint.offset)
        ET.SubElement(element, "axis", xyz=_numbers(joint.axis))
        ET.SubElement(element, "limit", LIMITS)
    for name, carrier in FIXED_TO.items():
        _link(robot, name, body.segments[name])
        _urdf_joint(robot, f"{name}_joint", "fixed", carrier, name, np.zeros(3))
    for name, segment, place in zip(
        body.markers, body.marker_segment, body.marker_position, strict=True
    ):
        ET.SubElement(robot, "link", name=name)
        _urdf_joint(robot, f"{name}_joint", "fixed", segment, name, place)
    write_xml(robot, path)


def _name(i: int) -> str:
    """Name the link that coordinate ``i`` moves: a segment's name where it is the last to do so."""
    if i < 0:
        return "ground"
    segment = TREE[i].segment
    return segment if i == LAST_Q[segment] else f"{TREE[i].name}_link"


def _link(robot: ET.Element, name: str, inertia: Inertia) -> None:
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(inertia.center))
    ET.SubElement(inertial, "mass", value=_numbers([inertia.mass]))
    moments = {
        f"i{'xyz'[j]}{'xyz'[k]}": _numbers([inertia.tensor[j, k]])
        for j in range(3)
        for k in range(j, 3)
    }
    ET.SubElement(inertial, "inertia", moments)


def _urdf_joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, place: Array
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_numbers(place))
    return joint
