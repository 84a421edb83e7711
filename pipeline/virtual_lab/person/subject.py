"""Virtual subjects: stature, mass and sex, an individual body, and an individual gait."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final, Literal

import numpy as np

from hbm.coordinates import COORDINATES, INDEX
from hbm.markers import marker_sets
from hbm.spatial import Array
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.anatomy import Proportions, axes_of, locate, offsets_of, t_pose
from pipeline.virtual_lab.person.body import Skeleton, WobblingMass
from pipeline.virtual_lab.person.gait import SIDES, STEP_M, Sole, StepParameters, size_of, sole_of
from pipeline.virtual_lab.person.variation import (
    ExtraJoints,
    draw_extra_joints,
    draw_wobbling_masses,
    drawn,
    inertias_of,
    navel_share,
    vary,
    vary_inertias,
    with_shoes,
)

SHOE_KG: Final = 0.3
SOLE_M: Final = 0.025
SOLE_YIELD_M: Final = 0.004
"""Mass and sole of a shoe, and how far it yields under body weight; assumed."""
HANGING_ARM_DEG: Final = {"ShoulderAbduction": 8.0, "ElbowFlexion": 10.0}
"""Posture of the arms in standing; typical values."""
PROPORTION_SD: Final = 0.03
"""Standard deviation of proportions between people of one stature; assumed."""
TREADMILL_SHORTENING: Final = 0.03
"""By how much steps on a treadmill are shorter than overground; typical of comparisons of both."""
STEP_LENGTH_SD: Final = 0.02
STEP_WIDTH_SD: Final = 0.12
"""Standard deviations of step length and width between people of one leg length; assumed."""
OFFSET_SD_DEG: Final = {
    **{"PelvisForwardPitch": 3.0, "TrunkFlexion": 3.0, "HeadFlexion": 4.0},
    **{"HipFlexion": 2.0, "HipAbduction": 1.0, "HipInternalRotation": 5.0, "KneeFlexion": 1.5},
    **{"ShoulderAbduction": 3.0, "ShoulderFlexion": 4.0, "ShoulderInternalRotation": 6.0},
    **{"ElbowFlexion": 6.0, "ForeArmPronation": 8.0, "WristFlexion": 5.0, "HandAbduction": 3.0},
}
"""Standard deviations of mean joint angles between people: assumed, about half of the published
spread (Pinzone et al. 2014, Gait Posture 40:286), part of which is error of measurement."""
BILATERAL_SHARE: Final = 0.9
UNILATERAL_SHARE: Final = 0.4
"""Of an offset that both sides have in common, and of each side's own: the squares add up to about
1; assumed."""
RANGE_SD: Final = 0.05
PELVIS_RANGE_SD: Final = 0.20
ARM_RANGE_SD: Final = 0.25
"""Standard deviations of the range of motion between people, by the mean range: legs, trunk and
head; rotation and obliquity of the pelvis; arms. Assumed."""
WANDER_DEG: Final = 0.5
ARM_WANDER_DEG: Final = 1.5
"""Standard deviations of joint angles from stride to stride; assumed."""
ANATOMICAL: Final = ("LGTRO", "RGTRO", "LTOE", "RTOE")
"""Points of the body, beside the markers of the Human Body Model 2, that locate joints."""
ARM: Final = ("Shoulder", "Elbow", "ForeArm", "Wrist", "Hand")


@dataclass(frozen=True, slots=True)
class Person:
    """A person: name, sex, mass [kg], stature [m], age [years]."""

    name: str = "sub01"
    sex: Literal["male", "female"] = "male"
    mass_kg: float = 74.6
    height_m: float = 1.78
    age: float = 26.0


@dataclass(frozen=True, slots=True)
class VirtualSubject:
    """A person with a true body and a gait.

    Attributes
    ----------
    person
        Who it is.
    marker_set
        Name of the marker set that the person wears.
    skeleton
        The true body: joints, inertias and markers.
    extra_joints, wobbling
        How the person moves in joints that the Human Body Model does not have; soft tissue.
    soles, sole_yield_m
        Side -> sole; by how much the shoe is compressed under body weight [m].
    t_pose
        Coordinates of the T-pose, standing on the floor, (46,) [rad, m].
    standing
        The same with the arms hanging.
    step_parameters
        The person's spatiotemporal parameters.
    offset, gain, wander
        How the joint angles in walking differ from the mean pattern: added to the coordinates,
        factor of their motion, and standard deviation of slow variations, (46,).
    """

    person: Person
    marker_set: str
    skeleton: Skeleton
    extra_joints: ExtraJoints
    wobbling: tuple[WobblingMass, ...]
    soles: Mapping[str, Sole]
    sole_yield_m: float
    t_pose: Array
    standing: Array
    step_parameters: StepParameters
    offset: Array
    gain: Array
    wander: Array


def make_subject(
    person: Person,
    *,
    marker_set: str = "hbm2",
    individuality: float = 0.0,
    faults: BodyFaults | None = None,
    rng: np.random.Generator | None = None,
) -> VirtualSubject:
    """Give a person a body and a gait.

    Parameters
    ----------
    person
        Who it is.
    marker_set
        Name of the marker set: "hbm2" or "hbm1".
    individuality
        Scale of the differences between people in proportions and gait; 1 as in the population.
    faults
        How the body differs from what markers and the Human Body Model suggest; by default not at
        all.
    rng
        Source of everything individual.

    Returns
    -------
    VirtualSubject
        Ready to walk.
    """
    faults = faults or Faults.none().body
    shape_rng, body_rng, gait_rng = (rng or np.random.default_rng(0)).spawn(3)
    deviation = PROPORTION_SD * individuality * drawn(shape_rng, len(fields(Proportions)))
    worn, proportions = marker_sets()[marker_set], Proportions(*(1 + deviation).tolist())
    source, shoe_scale = faults.inertias, faults.shoe_scale
    if faults.same_body:
        source, shoe_scale = "de_leva", 0.0

    # markers in the T-pose, the joints that they suggest, and the true ones
    points = tuple(dict.fromkeys((*marker_sets()["hbm2"].segment, *worn.segment, *ANATOMICAL)))
    position = t_pose(points, person.height_m, person.sex, proportions)
    position[:, 2] += shoe_scale * SOLE_M
    at = dict(zip(points, position, strict=True))
    suggested = locate(at, frozenset(worn.landmark), person.sex, navel_share(person.sex))
    joint_rng, mass_rng, tissue_rng, motion_rng = body_rng.spawn(4)
    anatomy = vary(suggested, faults, joint_rng)

    # masses, those of the shoes last
    shoe_kg = shoe_scale * SHOE_KG
    bare_kg = person.mass_kg - 2 * shoe_kg
    inertias = inertias_of(anatomy, source, bare_kg, person.sex, person.height_m)
    inertias = vary_inertias(inertias, faults, mass_rng)
    wobbling = draw_wobbling_masses(inertias, faults, tissue_rng)
    if shoe_kg > 0:
        inertias = with_shoes(inertias, anatomy, shoe_kg)

    # markers on the segments, and the soles
    on_segment = [
        anatomy.rotations[s].T @ (at[name] - anatomy.origin(s)) for name, s in worn.segment.items()
    ]
    skeleton = Skeleton(
        axes_of(anatomy),
        offsets_of(anatomy),
        inertias,
        tuple(worn.segment),
        tuple(worn.segment.values()),
        np.array(on_segment),
    )
    landmarks = {mark: at[name] for mark, name in worn.landmark.items()}
    soles = {}
    for side in SIDES:
        foot = f"{side}_foot"
        soles[side] = sole_of(landmarks, anatomy.rotations[foot], anatomy.origin(foot), side)

    # posture and gait
    q = np.array([anatomy.q.get(name, 0.0) for name in COORDINATES])
    standing = q.copy()
    for side in "RL":
        for name, angle in HANGING_ARM_DEG.items():
            standing[INDEX[side + name]] = np.radians(angle)
    size, typical = size_of(standing), StepParameters()
    longer, wider = drawn(gait_rng, 2).tolist()
    longer = STEP_LENGTH_SD * longer - TREADMILL_SHORTENING
    step_parameters = replace(
        typical,
        step_m=STEP_M * size * (1 + individuality * longer),
        width_m=typical.width_m * size * (1 + individuality * STEP_WIDTH_SD * wider),
    )
    return VirtualSubject(
        person,
        marker_set,
        skeleton,
        draw_extra_joints(faults, q, motion_rng),
        wobbling,
        soles,
        shoe_scale * SOLE_YIELD_M,
        q,
        standing,
        step_parameters,
        *_gait_style(individuality, gait_rng),
    )


def _gait_style(individuality: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Draw offset, gain and wander of all coordinates."""
    count = len(COORDINATES)
    offset, gain, wander = np.zeros(count), np.ones(count), np.zeros(count)
    of_joint: dict[str, Array] = {}
    for i, name in enumerate(COORDINATES):
        joint = name[1:] if name[0] in "RL" else name
        arm = joint.startswith(ARM)
        if joint not in of_joint:
            of_joint[joint] = drawn(rng, 2)
        bilateral, wider = of_joint[joint]
        sd = np.radians(OFFSET_SD_DEG.get(joint, 0.0))
        deviation = BILATERAL_SHARE * bilateral + UNILATERAL_SHARE * drawn(rng)[0]
        offset[i] = individuality * sd * deviation
        if joint in ("PelvisYaw", "PelvisRightRoll"):
            gain[i] += individuality * PELVIS_RANGE_SD * wider
        elif not joint.startswith("Pelvis"):
            gain[i] += individuality * (ARM_RANGE_SD if arm else RANGE_SD) * wider
        if joint.startswith(("Pelvis", "ShoulderUp", "ShoulderForward", "ShoulderInward")):
            continue
        wander[i] = np.radians(ARM_WANDER_DEG if arm else WANDER_DEG)
    return offset, gain, wander
