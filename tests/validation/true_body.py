"""A simulated person as the production's body, as far as the person's mechanics allow it."""

from dataclasses import replace

import numpy as np

from hbm.body import Body, build_body
from hbm.coordinates import COORDINATES, PARENT, SEGMENTS, SUBJECT_AXES
from hbm.markers import Markers
from hbm.spatial import Array
from pipeline.virtual_lab.person.body import LINKS, marker_positions
from pipeline.virtual_lab.person.subject import VirtualSubject


def true_body(subject: VirtualSubject) -> Body:
    """Give the production's body with the person's joints and inertias.

    Parameters
    ----------
    subject
        A person. One whose mechanics the production's body cannot have (without ``same_body``)
        gets the body that the true places of the markers on the bones suggest.

    Returns
    -------
    Body
        As `hbm.build_body` makes it.
    """
    skeleton, person = subject.skeleton, subject.person
    time = np.arange(3.0)
    body = build_body(
        Markers(time, skeleton.markers, t_pose_markers(subject)[None].repeat(len(time), axis=0)),
        mass=person.mass_kg,
        sex=person.sex,
        height_m=person.height_m,
        marker_set=subject.marker_set,
    )
    offsets = {s: skeleton.offsets[s] for s in PARENT if s != "thorax"}
    offsets["thorax"] = skeleton.offsets["mid_trunk"]
    for side in ("right", "left"):
        offsets[f"{side}_foot"] = skeleton.offsets[f"{side}_talus"]
    axis_of = {link.name: axis for link, axis in zip(LINKS, skeleton.axes, strict=True)}
    axes = {COORDINATES[i]: axis_of[COORDINATES[i]] for i in SUBJECT_AXES}
    lengths = (skeleton.offsets[s] for s in ("thorax", "right_foot", "left_foot"))
    if any(np.linalg.norm(length) > 0 for length in lengths) or subject.wobbling:
        return body
    return replace(
        body,
        offsets=offsets,
        axes=axes,
        segments={s: skeleton.inertias[s] for s in SEGMENTS},
        marker_position=skeleton.marker_position,
    )


def t_pose_markers(subject: VirtualSubject) -> Array:
    """Give a person's markers in the T-pose, (M, 3) [m]."""
    still = np.zeros(1)
    q = subject.extra_joints.extend(subject.t_pose[:, None], still, still)
    return np.asarray(marker_positions(subject.skeleton, q)[0])
