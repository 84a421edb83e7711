"""A body as URDF, for Pinocchio, MuJoCo and ROS."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import numpy as np

from hbm.body import Body
from hbm.coordinates import FIXED_TO, LAST_Q, TREE
from hbm.model import MODEL_NAME
from hbm.segments import Inertia
from hbm.spatial import Array
from pipeline.io.write import whole_file

TOKEN_INERTIA: Final = Inertia(1e-12, np.zeros(3), 1e-14 * np.eye(3))
"""Inertia of links without a segment, since MuJoCo refuses moving links below 1e-15."""
LIMITS: Final = {"lower": "-100", "upper": "100", "effort": "1e6", "velocity": "1e6"}
"""Limits of every joint [rad or m], since URDF requires them: beyond what a trial reaches."""


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
        element = _joint(robot, joint.name, kind, _name(joint.parent), _name(i), joint.offset)
        ET.SubElement(element, "axis", xyz=_numbers(joint.axis))
        ET.SubElement(element, "limit", LIMITS)
    for name, carrier in FIXED_TO.items():
        _link(robot, name, body.segments[name])
        _joint(robot, f"{name}_joint", "fixed", carrier, name, np.zeros(3))
    for name, segment, place in zip(
        body.markers, body.marker_segment, body.marker_position, strict=True
    ):
        ET.SubElement(robot, "link", name=name)
        _joint(robot, f"{name}_joint", "fixed", segment, name, place)
    ET.indent(robot)
    with whole_file(Path(path)) as temporary:
        ET.ElementTree(robot).write(temporary, encoding="UTF-8", xml_declaration=True)


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


def _joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, place: Array
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_numbers(place))
    return joint


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in values)
