"""Virtual subjects: stature, mass and sex, an individual body, and an individual gait."""

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from hbm.body import Body, build_body
from hbm.coordinates import COORDINATES, INDEX
from hbm.kinematics import solve_ik
from hbm.markers import Markers, marker_sets
from hbm.segments import Sex
from hbm.spatial import Array
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.anatomy import Proportions, t_pose
from pipeline.virtual_lab.person.body_variation import MAX_DEVIATION_SD, vary
from pipeline.virtual_lab.person.gait_pattern import STEP_M, size_of
from pipeline.virtual_lab.person.steps import StepParameters

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
ARM: Final = ("Shoulder", "Elbow", "ForeArm", "Wrist", "Hand")


@dataclass(frozen=True, slots=True)
class Person:
    """A person: name, sex, mass [kg], stature [m], age [years]."""

    name: str = "sub01"
    sex: Sex = "male"
    mass_kg: float = 74.6
    height_m: float = 1.78
    age: float = 26.0


@dataclass(frozen=True, slots=True)
class GaitStyle:
    """How a person's joint angles in walking differ from the mean pattern.

    Attributes
    ----------
    offset, gain
        Added to the coordinates in walking, and factor of their motion, (46,).
    wander
        Standard deviation of slow variations, (46,).
    """

    offset: Array
    gain: Array
    wander: Array

    def apply(self, change: Array, walking: Array) -> Array:
        """Give the person's change from standing in place of the mean pattern's, (T, 46)."""
        return change * self.gain + walking * self.offset


@dataclass(frozen=True, slots=True)
class VirtualSubject:
    """A person with a true body and a gait.

    Attributes
    ----------
    person
        Who it is.
    body
        The true body.
    t_pose
        Coordinates of the T-pose, standing on the floor at the lab's origin, (46,) [rad, m].
    standing
        The same with the arms hanging.
    step_parameters, style
        The person's spatiotemporal parameters and joint angles.
    """

    person: Person
    body: Body
    t_pose: Array
    standing: Array
    step_parameters: StepParameters
    style: GaitStyle


def make_subject(
    person: Person,
    *,
    marker_set: str = "hbm2",
    individuality: float = 0.0,
    faults: BodyFaults | None = None,
    variability: float = 1.0,
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
        How far joint centres, axes and inertias are from what markers and de Leva's table suggest;
        by default the body is the one that `build_body` finds.
    variability
        Scale of the differences between a person's steps; 1 as in healthy adults.
    rng
        Source of everything individual.

    Returns
    -------
    VirtualSubject
        Ready to walk.
    """
    rng = rng or np.random.default_rng(0)
    names = tuple(marker_sets()[marker_set].segment)
    proportions = Proportions(
        **{f.name: 1 + individuality * PROPORTION_SD * _drawn(rng) for f in fields(Proportions)}
    )
    position = t_pose(names, person.height_m, person.sex, proportions)
    pose = Markers(np.arange(2.0), names, np.stack([position, position]))
    body = build_body(
        pose,
        mass=person.mass_kg,
        sex=person.sex,
        marker_set=marker_set,
        height_m=person.height_m,
    )
    q = np.array(solve_ik(body, pose).q[0])
    body = vary(body, q, faults or Faults.none().body, rng)
    standing = q.copy()
    for side in "RL":
        for name, angle in HANGING_ARM_DEG.items():
            standing[INDEX[side + name]] = np.radians(angle)
    size, typical = size_of(standing), StepParameters()
    longer = STEP_LENGTH_SD * _drawn(rng) - TREADMILL_SHORTENING
    step_parameters = replace(
        typical,
        step_m=STEP_M * size * (1 + individuality * longer),
        width_m=typical.width_m * size * (1 + individuality * STEP_WIDTH_SD * _drawn(rng)),
        time_sd=variability * typical.time_sd,
        forward_sd=variability * typical.forward_sd,
        side_sd=variability * typical.side_sd,
    )
    style = _gait_style(individuality, variability, rng)
    return VirtualSubject(person, body, q, standing, step_parameters, style)


def _drawn(rng: np.random.Generator) -> float:
    """Draw from the standard normal distribution within `MAX_DEVIATION_SD`."""
    return float(np.clip(rng.normal(), -MAX_DEVIATION_SD, MAX_DEVIATION_SD))


def _gait_style(individuality: float, variability: float, rng: np.random.Generator) -> GaitStyle:
    count = len(COORDINATES)
    offset, gain, wander = np.zeros(count), np.ones(count), np.zeros(count)
    of_joint: dict[str, tuple[float, float]] = {}
    for i, name in enumerate(COORDINATES):
        joint = name[1:] if name[0] in "RL" else name
        arm = joint.startswith(ARM)
        if joint not in of_joint:
            of_joint[joint] = _drawn(rng), _drawn(rng)
        bilateral, wider = of_joint[joint]
        sd = np.radians(OFFSET_SD_DEG.get(joint, 0.0))
        own = BILATERAL_SHARE * bilateral + UNILATERAL_SHARE * _drawn(rng)
        offset[i] = individuality * sd * own
        if joint in ("PelvisYaw", "PelvisRightRoll"):
            gain[i] += individuality * PELVIS_RANGE_SD * wider
        elif not joint.startswith("Pelvis"):
            gain[i] += individuality * (ARM_RANGE_SD if arm else RANGE_SD) * wider
        if joint.startswith(("Pelvis", "ShoulderUp", "ShoulderForward", "ShoulderInward")):
            continue
        wander[i] = variability * np.radians(ARM_WANDER_DEG if arm else WANDER_DEG)
    return GaitStyle(offset, gain, wander)
