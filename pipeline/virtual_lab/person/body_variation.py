"""True bodies: how people differ from what markers and regression equations suggest.

Joint centres are known to a centimetre at best: hip centres by regression err by 8 mm in every
direction (Sangeux et al. 2011, Gait Posture 34:324; 2014, 40:20), palpated joint axes by some
degrees (Della Croce et al. 2005, Gait Posture 21:226). Segment masses, centres and radii of
gyration differ between methods and people by several per cent of their values (Rao et al. 2006, J
Biomech 39:1531; Dumas et al. 2007, J Biomech 40:543).
"""

from dataclasses import replace
from typing import Final

import numpy as np

from hbm.body import Body
from hbm.coordinates import FIXED_TO, MOVING, PARENT, RIGID_BODIES, SIDES
from hbm.model import joints_of
from hbm.poses import marker_positions, segment_frames
from hbm.segments import Inertia
from hbm.spatial import Array, rotation_about
from pipeline.virtual_lab.faults import BodyFaults, Faults

MIN_MASS_KG: Final = 0.01
"""Segments below this mass are only there to split a joint; their inertia is not varied."""
JOINT_CENTER_SD_M: Final = {
    **{"thorax": 0.008, "head": 0.006, "upper_arm": 0.008, "forearm": 0.004, "hand": 0.003},
    **{"thigh": 0.008, "shank": 0.004, "foot": 0.003, "toes": 0.0, "shoulder": 0.0},
}
"""Standard deviation of the proximal joint centre of each segment, in every direction: the hip's as
cited above, the others assumed."""
MAX_DEVIATION_SD: Final = 2
"""Nothing varies by more than two standard deviations, so that no body is impossible."""


def vary(body: Body, t_pose: Array, faults: BodyFaults, rng: np.random.Generator) -> Body:
    """Give a body whose joints and inertias differ from those that its markers suggest.

    Parameters
    ----------
    body
        The body that a calibration pose suggests.
    t_pose
        Coordinates of that pose, (46,); the markers keep their places in it.
    faults
        Standard deviations of the differences.
    rng
        Source of the variation.

    Returns
    -------
    Body
        With the same total mass and the same markers in the T-pose.
    """
    if faults == Faults.none().body:
        return body
    axes = {
        name: _tilted(body.axes[name], faults.axis_deg, rng)
        for side in SIDES.values()
        for name in body.axes
        if name.startswith(side)
    }
    tilted = replace(body, joints=joints_of(body.offsets, axes))
    suggested, true = (_pose(b, t_pose) for b in (body, tilted))
    markers = marker_positions(body, t_pose[None])[0]
    R, old = {s: r for s, (r, _) in true.items()}, {s: o for s, (_, o) in suggested.items()}
    new = dict(old)
    for s in MOVING[1:]:
        part = s.split("_", 1)[1] if s.startswith(("right_", "left_")) else s
        error = faults.joint_scale * JOINT_CENTER_SD_M[part] * _drawn(rng, 3)
        new[s] = old[s] + error
    for side in ("right", "left"):  # the shoulder's two frames share their origin
        new[f"{side}_shoulder"] = new[f"{side}_upper_arm"]
    offsets = {s: R[p].T @ (new[s] - new[p]) for s, p in PARENT.items()}
    position = np.array(
        [R[s].T @ (m - new[s]) for m, s in zip(markers, body.marker_segment, strict=True)]
    )
    return replace(
        body,
        marker_position=position,
        joints=joints_of(offsets, axes),
        segments=_varied_inertias(body, faults, rng),
    )


def _pose(body: Body, q: Array) -> dict[str, tuple[Array, Array]]:
    """Give rotation and origin of every segment in one pose."""
    rotation, origin = segment_frames(body, q[None])
    return {s: (rotation[0, k], origin[0, k]) for k, s in enumerate(MOVING)}


def _tilted(axis: Array, sd_deg: float, rng: np.random.Generator) -> Array:
    rotation = np.radians(sd_deg) * _drawn(rng, 3)
    angle = float(np.linalg.norm(rotation))
    if angle == 0:
        return axis
    return np.asarray(rotation_about(rotation / angle, angle) @ axis)


def _varied_inertias(
    body: Body, faults: BodyFaults, rng: np.random.Generator
) -> dict[str, Inertia]:
    """Vary the segments; the mid trunk varies with the thorax."""
    drawn = {
        s: (_drawn(rng), _drawn(rng, 3), _drawn(rng))
        for s in RIGID_BODIES
        if body.segments[s].mass > MIN_MASS_KG
    }
    drawn |= {s: drawn[carrier] for s, carrier in FIXED_TO.items()}
    names = [s for s in body.segments if s in drawn]
    heavier = {s: 1 + faults.mass_share * float(drawn[s][0][0]) for s in names}
    total = sum(body.segments[s].mass for s in names)
    scale = total / sum(body.segments[s].mass * heavier[s] for s in names)
    varied = dict(body.segments)
    for s in names:
        part, (_, away, wider) = body.segments[s], drawn[s]
        factor = scale * heavier[s]
        varied[s] = Inertia(
            part.mass * factor,
            part.center + faults.center_m * away,
            part.tensor * factor * (1 + faults.gyration_share * float(wider[0])) ** 2,
        )
    return varied


def _drawn(rng: np.random.Generator, count: int = 1) -> Array:
    """Draw from the standard normal distribution within `MAX_DEVIATION_SD`."""
    return np.asarray(np.clip(rng.normal(size=count), -MAX_DEVIATION_SD, MAX_DEVIATION_SD))
