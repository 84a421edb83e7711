"""True sizes of what is wrong with the body: as it is assumed, less as the virtual person is."""

from typing import Final

import numpy as np

from hbm.coordinates import MOVING, SIDES
from hbm.model import Body
from hbm.poses import segment_frames
from hbm.spatial import Array
from pipeline.virtual_lab.person.body import frames
from pipeline.virtual_lab.person.walk import Walk

PARTS: Final = {
    "pelvis": ("pelvis",),
    "trunk": ("thorax", "mid_trunk"),
    "head": ("head",),
    "thighs": ("right_thigh", "left_thigh"),
    "shanks": ("right_shank", "left_shank"),
    "feet": ("right_foot", "left_foot", "right_toes", "left_toes"),
    "arms": tuple(f"{s}_{part}" for s in SIDES for part in ("upper_arm", "forearm", "hand")),
}
JOINTS: Final = {"hip": ("pelvis", "thigh"), "knee": ("thigh", "shank"), "ankle": ("shank", "foot")}
"""Joint of a leg -> the segment in whose axes its place is stated, and the one that it carries."""
POSE: Final = slice(20, 80)
"""Frames of the T-pose."""


def body_sizes(body: Body, q: Array, walk: Walk) -> dict[str, float]:
    """Give true sizes by the names of causes.

    Parameters
    ----------
    body
        As it is assumed.
    q
        Its coordinates, (T, 46) [rad, m].
    walk
        How the person really moved.
    """
    assumed = {name: part.mass for name, part in body.segments.items()}
    true = {name: part.mass for name, part in walk.subject.skeleton.inertias.items()}
    total, really = sum(assumed.values()), sum(true.values())
    sizes = {"body mass": total / really - 1}
    for name, segments in PARTS.items():
        share = sum(assumed.get(each, 0.0) for each in segments) / total
        own = sum(true.get(each, 0.0) for each in segments) / really
        sizes[f"{name}: mass"] = share / own - 1

    time = np.arange(len(q))[POSE] / 100
    seen, origins = segment_frames(body, q[POSE])
    there = frames(walk.subject.skeleton, (walk.motion.at(time).T,))
    joints = {"lumbar joint": ("pelvis", "thorax", "mid_trunk")}
    for side in SIDES:
        for joint, (parent, segment) in JOINTS.items():
            carrier = "pelvis" if parent == "pelvis" else f"{side}_{parent}"
            carried = f"{side}_talus" if joint == "ankle" else f"{side}_{segment}"
            joints[f"{side} {joint}"] = (carrier, f"{side}_{segment}", carried)
    for name, (carrier, segment, really_carried) in joints.items():
        away = origins[:, MOVING.index(segment)] - there[really_carried].origin.T
        axes = seen[:, MOVING.index(carrier)]
        own_axes = np.einsum("tij,ti->tj", axes, away).mean(axis=0)
        for k, letter in enumerate("xyz"):
            sizes[f"{name}: centre along {letter}"] = float(own_axes[k])
    return sizes
