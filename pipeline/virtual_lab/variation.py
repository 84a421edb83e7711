"""True bodies: how people differ from what markers and regression tables say of them.

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
from hbm.coordinates import MASSLESS, PARENT, SEGMENTS
from hbm.native import kernels
from hbm.segments import Inertia
from hbm.spatial import Array, rotation_about

CENTER_SD_M: Final = {
    **{"trunk": 0.008, "head": 0.006, "upper_arm": 0.008, "forearm": 0.004, "hand": 0.003},
    **{"thigh": 0.008, "shank": 0.004, "foot": 0.003, "toes": 0.0, "shoulder": 0.0},
}
AXIS_SD_DEG: Final = 3.0
MASS_SD: Final = 0.06
COM_SD_M: Final = 0.008
RADIUS_SD: Final = 0.05


def vary(body: Body, t_pose: Array, amount: float, rng: np.random.Generator) -> Body:
    """Give a body whose joints and inertias are not those that its markers suggest.

    Parameters
    ----------
    body
        The body that a calibration pose suggests.
    t_pose
        The coordinates of that pose, (46,); in it the markers stay where they are.
    amount
        1 for the variation among people, 0 for none.
    rng
        Source of the variation.

    Returns
    -------
    Body
        With the same total mass and the same markers in the T-pose.
    """
    if amount == 0:
        return body
    poses = kernels().segment_poses(t_pose[None], body.geometry)[0].reshape(len(SEGMENTS), 4, 3)
    R = {s: pose[:3].T for s, pose in zip(SEGMENTS, poses, strict=True)}
    old = {s: pose[3] for s, pose in zip(SEGMENTS, poses, strict=True)}
    new = dict(old)
    for s in SEGMENTS[1:]:
        part = s.split("_", 1)[1] if s.startswith(("right_", "left_")) else s
        error = amount * CENTER_SD_M[part] * np.clip(rng.normal(size=3), -2, 2)
        new[s] = old[s] + error
    for side in ("right", "left"):  # the shoulder's two frames share their origin
        new[f"{side}_shoulder"] = new[f"{side}_upper_arm"]
    offsets = {s: R[p].T @ (new[s] - new[p]) for s, p in PARENT.items()}
    axes = {name: _tilted(axis, amount, rng) for name, axis in body.axes.items()}
    position = np.array(
        [
            x + R[s].T @ (old[s] - new[s])
            for x, s in zip(body.marker_position, body.marker_segment, strict=True)
        ]
    )
    inertias = _varied_inertias(body, amount, rng)
    return replace(body, marker_position=position, offsets=offsets, axes=axes, inertias=inertias)


def _tilted(axis: Array, amount: float, rng: np.random.Generator) -> Array:
    turn = np.radians(amount * AXIS_SD_DEG) * np.clip(rng.normal(size=3), -2, 2)
    angle = float(np.linalg.norm(turn))
    return rotation_about(turn / angle, angle) @ axis


def _varied_inertias(body: Body, amount: float, rng: np.random.Generator) -> dict[str, Inertia]:
    factors = {s: 1 + amount * MASS_SD * float(np.clip(rng.normal(), -2, 2)) for s in body.inertias}
    mass = {s: part.mass * factors[s] for s, part in body.inertias.items()}
    scale = body.mass / sum(mass.values())
    varied = {}
    for s, part in body.inertias.items():
        away = amount * COM_SD_M * np.clip(rng.normal(size=3), -2, 2)
        radius = 1 + amount * RADIUS_SD * float(np.clip(rng.normal(), -2, 2))
        grown = scale * factors[s] * radius**2
        still = s in MASSLESS or s.endswith("toes")
        varied[s] = (
            part if still else Inertia(mass[s] * scale, part.center + away, part.tensor * grown)
        )
    return varied
