"""How people differ from the Human Body Model: joint centres, axes, inertias, ankles and shoes.

Joint centres are known to a centimetre at best: hip centres by regression err by 8 mm in every
direction (Sangeux et al. 2011, Gait Posture 34:324; 2014, 40:20), palpated joint axes by some
degrees (Della Croce et al. 2005, Gait Posture 21:226). Segment masses, centres and radii of
gyration differ between methods and people by several per cent of their values (Rao et al. 2006, J
Biomech 39:1531; Dumas et al. 2007, J Biomech 40:543).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.segments import Inertia
from hbm.spatial import Array, rotation_about
from pipeline.virtual_lab.faults import BodyFaults
from pipeline.virtual_lab.person.body.kinematics import frames
from pipeline.virtual_lab.person.body.posture import SIDES, Anatomy, axes_of
from pipeline.virtual_lab.person.body.skeleton import COLUMN, LINKS, Skeleton

MIN_MASS_KG: Final = 0.01
"""Segments below this mass are only there to split a joint; their inertia is not varied."""
JOINT_CENTER_SD_M: Final = {
    **{"mid_trunk": 0.008, "neck": 0.006, "shoulder": 0.008, "elbow": 0.004, "wrist": 0.003},
    **{"hip": 0.008, "knee": 0.004, "ankle": 0.003},
}
"""Standard deviation of joint centres in every direction: the hip's as cited above, the others
assumed. The first is that of the lumbar joint, which carries the mid trunk."""
MAX_DEVIATION_SD: Final = 2
"""Nothing varies by more than two standard deviations, so that no body is impossible."""
MID_TRUNK_SHARE: Final = 0.69
"""Place of T12/L1 on the way from C7/T1 to L5/S1: the share with which thorax and abdomen of Dumas
and Wojtusch (2018) together have the torso's centre of mass of Dumas et al. (2007), both sexes."""
ANKLE_SD_DEG: Final = 3.7, 7.0
"""Standard deviations of the talocrural axis between people, in the frontal and the transverse
plane (Inman 1976, The joints of the ankle)."""
SUBTALAR_SD_DEG: Final = 9.0, 11.0
"""Standard deviations of the subtalar axis' inclination and medial deviation (Inman 1976)."""
SUBTALAR_BELOW_M: Final = 0.012
"""Distance of the subtalar axis below the talocrural one; assumed, half the talus' height."""
SHOE_SIZE_M: Final = 0.28, 0.10, 0.06
"""Length, width and height of the box that has a shoe's radii of gyration; assumed."""
SHOE_HEIGHT_M: Final = 0.015
"""Height of its centre above the sole; assumed: most of a shoe's mass is in the sole."""


def drawn(rng: np.random.Generator, count: int = 1) -> Array:
    """Draw from the standard normal distribution within `MAX_DEVIATION_SD`, (count,)."""
    return np.asarray(np.clip(rng.normal(size=count), -MAX_DEVIATION_SD, MAX_DEVIATION_SD))


def vary(anatomy: Anatomy, faults: BodyFaults, rng: np.random.Generator) -> Anatomy:
    """Give a person whose joints differ from those that the markers suggest.

    Parameters
    ----------
    anatomy
        The joints that the markers suggest, in the T-pose.
    faults
        Sizes of the differences.
    rng
        Source of the variation; what is drawn does not depend on the sizes.

    Returns
    -------
    Anatomy
        In the same pose, with the same joint angles.
    """
    axes, points = dict(anatomy.axes), dict(anatomy.points)
    ankle = 0.0 if faults.same_body else faults.ankle_scale
    for name in sorted(axes):
        axes[name] = _tilted(axes[name], np.radians(faults.axis_deg) * drawn(rng, 3))
        sd_deg = _ankle_sd_deg(name)
        if sd_deg is not None:
            first, second = np.radians(sd_deg) * ankle * drawn(rng, 2)
            axes[name] = _tilted(axes[name], np.array([first, 0.0, second]))
    for name in sorted(points):
        joint = name.removeprefix("right_").removeprefix("left_")
        own = "mid_trunk" if name == "lumbar" else joint
        if own in JOINT_CENTER_SD_M and name != "mid_trunk":
            points[name] = points[name] + faults.joint_scale * JOINT_CENTER_SD_M[own] * drawn(
                rng, 3
            )
    for side in SIDES:
        lower = np.array([0.0, 0.0, ankle * SUBTALAR_BELOW_M])
        points[f"{side}_subtalar"] = points[f"{side}_ankle"] - lower
    points["mid_trunk"] = points["lumbar"]
    if not faults.same_body:
        away = points["lumbar"] - points["neck"]
        points["mid_trunk"] = points["neck"] + MID_TRUNK_SHARE * away
    changed = replace(anatomy, axes=axes, points=points, ends=_ends(anatomy.ends, points))
    return replace(changed, rotations=_rotations(changed))


def vary_inertias(
    inertias: Mapping[str, Inertia], faults: BodyFaults, rng: np.random.Generator
) -> dict[str, Inertia]:
    """Vary masses, centres and radii of gyration; the total mass stays.

    Parameters
    ----------
    inertias
        By segment.
    faults
        Sizes of the differences.
    rng
        Source of the variation.

    Returns
    -------
    dict of str to Inertia
        By segment.
    """
    names = [s for s, part in inertias.items() if part.mass > MIN_MASS_KG]
    draws = {s: (drawn(rng), drawn(rng, 3), drawn(rng)) for s in names}
    if faults.same_body:
        draws["mid_trunk"] = draws["thorax"]
    heavier = {s: 1 + faults.mass_share * float(draws[s][0][0]) for s in names}
    total = sum(inertias[s].mass for s in names)
    scale = total / sum(inertias[s].mass * heavier[s] for s in names)
    varied = dict(inertias)
    for s in names:
        part, (_, away, wider) = inertias[s], draws[s]
        factor = scale * heavier[s]
        varied[s] = Inertia(
            part.mass * factor,
            part.center + faults.center_m * away,
            part.tensor * factor * (1 + faults.gyration_share * float(wider[0])) ** 2,
        )
    return varied


def with_shoes(
    inertias: Mapping[str, Inertia], anatomy: Anatomy, shoe_kg: float
) -> dict[str, Inertia]:
    """Add a shoe to each foot: a box over the length of the foot; mass in kg."""
    length, width, height = SHOE_SIZE_M
    square = np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])
    shod = dict(inertias)
    for side in SIDES:
        foot = f"{side}_foot"
        heel, tip, _ = anatomy.ends[foot]
        middle = (heel + tip) / 2
        middle[2] = SHOE_HEIGHT_M
        tensor = np.diag(shoe_kg / 12 * square)
        shoe = Inertia(shoe_kg, middle, tensor)
        shod[foot] = shod[foot] + shoe.in_frame(anatomy.rotations[foot], anatomy.origin(foot))
    return shod


def _ankle_sd_deg(name: str) -> tuple[float, float] | None:
    if name.endswith("AnklePlantarFlexion"):
        return ANKLE_SD_DEG
    return SUBTALAR_SD_DEG if name.endswith("FootPronation") else None


def _tilted(axis: Array, rotation: Array) -> Array:
    angle = float(np.linalg.norm(rotation))
    if angle == 0:
        return axis
    return np.asarray(rotation_about(rotation / angle, angle) @ axis)


def _ends(ends: Mapping[str, Array], points: Mapping[str, Array]) -> dict[str, Array]:
    """Move the ends of the limbs' segments with their joints."""
    joints = {
        **{"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist")},
        **{"hand": ("wrist", "knuckle"), "thigh": ("hip", "knee"), "shank": ("knee", "ankle")},
    }
    moved = dict(ends)
    for side in SIDES:
        for part, (first, second) in joints.items():
            near, far = points[f"{side}_{first}"], points[f"{side}_{second}"]
            moved[f"{side}_{part}"] = np.stack([near, far, ends[f"{side}_{part}"][2]])
    return moved


def _rotations(anatomy: Anatomy) -> dict[str, Array]:
    """Give the orientations that follow from joint angles and axes."""
    q = np.zeros((len(LINKS), 1))
    for name, value in anatomy.q.items():
        q[COLUMN[name]] = value
    nowhere = {s: np.zeros(3) for s in anatomy.rotations}
    jointed = Skeleton(axes_of(anatomy), nowhere, {}, (), (), np.zeros((0, 3)))
    return {s: frame.rotation[0][..., 0] for s, frame in frames(jointed, (q,)).items()}
