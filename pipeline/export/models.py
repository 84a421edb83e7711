"""A body as a model of other programs: OpenSim 4, and URDF for Pinocchio, MuJoCo and ROS."""

from collections.abc import Iterable, Iterator
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
    units = {"length_units": "meters", "force_units": "N"}
    model = add(document, "Model", MODEL_NAME, gravity=numbers([0, 0, -GRAVITY_MPS2]), **units)
    bodies, joints, markers = (
        add(add(model, f"{kind}Set", f"{kind.lower()}set"), "objects")
        for kind in ("Body", "Joint", "Marker")
    )
    for name in (*MOVING, *FIXED_TO):
        inertia = body.segments.get(name, NO_INERTIA)
        t = inertia.tensor
        moments = numbers([*np.diag(t), t[0, 1], t[0, 2], t[1, 2]])
        center = numbers(inertia.center)
        add(bodies, "Body", name, mass=numbers([inertia.mass]), mass_center=center, inertia=moments)
    for name in MOVING:
        _custom_joint(joints, name, [joint for joint in body.joints if joint.segment == name])
    for name, carrier in FIXED_TO.items():
        _joint(joints, "WeldJoint", name, f"/bodyset/{carrier}", np.zeros(3))
    for name, segment, place in _markers(body):
        frame = f"/bodyset/{segment}"
        location = numbers(place)
        add(markers, "Marker", name, socket_parent_frame=frame, location=location, fixed="true")
    write_xml(document, path)


def add(parent: ET.Element, tag: str, name: str = "", **texts: str) -> ET.Element:
    """Add an element to one of OpenSim's, with its name and with children that hold texts."""
    element = ET.SubElement(parent, tag, {"name": name} if name else {})
    for child, text in texts.items():
        ET.SubElement(element, child).text = text or None
    return element


def numbers(values: Iterable[float]) -> str:
    """Write numbers as they are in memory."""
    return " ".join(repr(float(x)) for x in values)


def _markers(body: Body) -> Iterator[tuple[str, str, Array]]:
    """Give the name of each marker, its segment and its place on it."""
    return zip(body.markers, body.marker_segment, body.marker_position, strict=True)


def _joint(joints: ET.Element, kind: str, name: str, parent: str, offset: Array) -> ET.Element:
    """Join a body to a place in its parent."""
    child = f"/bodyset/{name}"
    frames = {"socket_parent_frame": "before", "socket_child_frame": child}
    joint = add(joints, kind, f"{name}_joint", **frames)
    place = {"socket_parent": parent, "translation": numbers(offset)}
    add(add(joint, "frames"), "PhysicalOffsetFrame", "before", **place)
    return joint


def _custom_joint(joints: ET.Element, name: str, axes: list[Joint]) -> None:
    """Join a body to its parent by single-axis joints."""
    parent = f"/bodyset/{PARENT[name]}" if name in PARENT else "/ground"
    joint = _joint(joints, "CustomJoint", name, parent, axes[0].offset)
    coordinates = add(joint, "coordinates")
    for axis in axes:
        free = {"range": RANGE[axis.translates], "clamped": "false", "locked": "false"}
        add(coordinates, "Coordinate", axis.name, default_value="0", **free)
    transform = add(joint, "SpatialTransform")
    _axes(transform, "rotation", [axis for axis in axes if not axis.translates])
    _axes(transform, "translation", [axis for axis in axes if axis.translates])


def _axes(transform: ET.Element, kind: str, joints: list[Joint]) -> None:
    """Write three axes: those of joints, then constant ones for those that are lacking."""
    axes = np.array([joint.axis for joint in joints]).reshape(-1, 3)
    _, _, basis = np.linalg.svd(axes)
    for k, axis in enumerate([*axes, *basis[len(joints) :]]):
        moves = joints[k].name if k < len(joints) else ""
        of_axis = {"coordinates": moves, "axis": numbers(axis)}
        element = add(transform, "TransformAxis", f"{kind}{k + 1}", **of_axis)
        if moves:
            add(element, "LinearFunction", "function", coefficients="1 0")
        else:
            add(element, "Constant", "function", value="0")


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
        ET.SubElement(element, "axis", xyz=numbers(joint.axis))
        ET.SubElement(element, "limit", LIMITS)
    for name, carrier in FIXED_TO.items():
        _link(robot, name, body.segments[name])
        _urdf_joint(robot, f"{name}_joint", "fixed", carrier, name, np.zeros(3))
    for name, segment, place in _markers(body):
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
    ET.SubElement(inertial, "origin", xyz=numbers(inertia.center))
    ET.SubElement(inertial, "mass", value=numbers([inertia.mass]))
    moments = {
        f"i{'xyz'[j]}{'xyz'[k]}": numbers([inertia.tensor[j, k]])
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
    ET.SubElement(joint, "origin", xyz=numbers(place))
    return joint
