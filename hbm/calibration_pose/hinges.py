"""Centres and axes of hinge joints from the markers beside them."""

from collections.abc import Mapping

import numpy as np

from hbm.calibration_pose.anatomy import MEDIAL_SIGN, Anatomy, need
from hbm.notes import Note
from hbm.spatial import Array, distance, perpendicular, unit


def locate_hinge(
    anatomy: Anatomy,
    landmarks: Mapping[str, Array],
    joint: str,
    names: tuple[str, str],
    *,
    proximal: Array,
    medial: Array,
    half_width: float | None,
    instead: str,
) -> None:
    """Find a joint's centre midway between two markers, or medial to the lateral one.

    Midway: Dumas et al. 2007 (J Biomech 40:543). Medial: `chord`, with the plane that ``medial``
    gives.
    """
    lateral, other = names
    sign = MEDIAL_SIGN[joint.split("_", maxsplit=1)[0]]
    if other in landmarks or half_width is None:
        outer, inner = need(landmarks, *names, purpose=f"the {joint}", instead=instead)
        center = (outer + inner) / 2
    else:
        (outer,) = need(landmarks, lateral, purpose=f"the {joint}", instead=other)
        center = chord(outer, proximal, medial, half_width, joint)
        anatomy.notes.append(
            Note.of("joint_center_from_width", marker=other, joint=joint, lateral=lateral)
        )
    anatomy.points[joint] = center
    anatomy.axes[joint] = sign * unit(center - outer)


def chord(marker: Array, proximal: Array, medial: Array, offset: float, joint: str) -> Array:
    """Give a joint's centre: at a given distance from a marker, at a right angle to the bone.

    Parameters
    ----------
    marker
        Beside the joint, (3,) [m].
    proximal
        The bone's other end, (3,) [m].
    medial
        Direction from the marker towards the joint; its part along the bone does not count, (3,).
    offset
        Distance of the centre from the marker [m].
    joint
        Its name, for the error.

    Returns
    -------
    Array
        (3,) [m].

    Raises
    ------
    ValueError
        If the offset is longer than the bone.

    Notes
    -----
    Kadaba et al. 1990 (J Orthop Res 8:383), Davis et al. 1991 (Hum Mov Sci 10:575).
    """
    up = unit(proximal - marker)
    share = offset / distance(proximal, marker)
    if share >= 1:
        raise ValueError(
            f"the {joint} would be {offset * 1000:.0f} mm from its lateral marker, farther "
            "than the next joint; check the widths and the markers' names"
        )
    inward = perpendicular(medial, up)
    return np.asarray(marker + offset * (share * up + np.sqrt(1 - share**2) * inward))
