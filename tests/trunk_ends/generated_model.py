"""Pelvis, trunk and head of the generated walk: the model that made it, beside our body."""

from pathlib import Path
from typing import Final
from xml.etree import ElementTree as XML

import numpy as np

from hbm.body import Body
from hbm.coordinates import FIXED_TO, MOVING
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia
from hbm.spatial import Array

AXIAL: Final = ("pelvis", "mid_trunk", "thorax", "head")
HIPS: Final = ("RHJC", "LHJC")
"""The model's hip joint centres, as markers of the recording."""


def true_trunk(model: Path, markers: Markers, frame: int) -> Inertia:
    """Give pelvis and torso of the generating model, about its mid-hip, lab axes.

    Parameters
    ----------
    model
        The ``.osim`` file; its torso includes the head.
    markers
        The recording, with the model's markers on pelvis and torso.
    frame
        Number of the frame.

    Returns
    -------
    Inertia
        In lab axes, its origin at the middle of the model's hip joints.
    """
    root = XML.parse(model).getroot()
    measured = dict(zip(markers.names, markers.position[frame], strict=True))
    total = NO_INERTIA
    for name in ("pelvis", "torso"):
        place = {
            m.get("name"): _numbers(m, "location")
            for m in root.iter("Marker")
            if (m.findtext("socket_parent_frame") or "").endswith("/" + name)
        }
        shown = [n for n in place if n in measured and np.isfinite(measured[n]).all()]
        R, origin = _register(
            np.array([place[n] for n in shown]), np.array([measured[n] for n in shown])
        )
        body = next(b for b in root.iter("Body") if b.get("name") == name)
        tensor = np.diag(_numbers(body, "inertia")[:3])
        center = R @ _numbers(body, "mass_center") + origin
        total += Inertia(float(body.findtext("mass") or "nan"), center, R @ tensor @ R.T)
    return total.in_frame(np.eye(3), mid_hip(markers, frame))


def our_trunk(body: Body, motion: Motion, markers: Markers, frame: int) -> Inertia:
    """Give pelvis, mid trunk, thorax and head of a body, about the model's mid-hip, lab axes."""
    rotation, origin = segment_frames(body, motion.q[frame : frame + 1])
    total = NO_INERTIA
    for name in AXIAL:
        i = MOVING.index(FIXED_TO.get(name, name))
        R, part = rotation[0, i], body.segments[name]
        total += Inertia(part.mass, R @ part.center + origin[0, i], R @ part.tensor @ R.T)
    return total.in_frame(np.eye(3), mid_hip(markers, frame))


def mid_hip(markers: Markers, frame: int) -> Array:
    """Give the middle of the model's hip joints, (3,) [m]."""
    hips = [markers.position[frame, markers.names.index(name)] for name in HIPS]
    return np.asarray(np.mean(hips, axis=0))


def _numbers(element: XML.Element, key: str) -> Array:
    return np.array([float(x) for x in (element.findtext(key) or "").split()])


def _register(local: Array, lab: Array) -> tuple[Array, Array]:
    """Give the rotation and origin that bring points to their lab positions (Kabsch 1976)."""
    a, b = local.mean(axis=0), lab.mean(axis=0)
    u, _, v = np.linalg.svd((local - a).T @ (lab - b))
    R = v.T @ np.diag([1, 1, np.linalg.det(v.T @ u.T)]) @ u.T
    return R, b - R @ a
