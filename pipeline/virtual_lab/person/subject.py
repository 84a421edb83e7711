"""People: stature, mass, sex, a body of their own, and a way of walking of their own."""

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
from pipeline.virtual_lab.person.anatomy import Build, t_pose
from pipeline.virtual_lab.person.body_variation import vary
from pipeline.virtual_lab.person.gait_pattern import STEP_M, size_of
from pipeline.virtual_lab.person.steps import Habits

HANGING_ARM: Final = {"ShoulderAbduction": 8.0, "ElbowFlexion": 10.0}
BUILD_SD: Final = 0.03
TREADMILL: Final = 0.03  # how much shorter than in the norms steps are on a belt
OFFSET_SD_DEG: Final = {  # between people, about half the spread of the norms
    **{"PelvisForwardPitch": 3.0, "TrunkFlexion": 3.0, "HeadFlexion": 4.0},
    **{"HipFlexion": 2.0, "HipAbduction": 1.0, "HipInternalRotation": 5.0, "KneeFlexion": 1.5},
    **{"ShoulderAbduction": 3.0, "ShoulderFlexion": 4.0, "ShoulderInternalRotation": 6.0},
    **{"ElbowFlexion": 6.0, "ForeArmPronation": 8.0, "WristFlexion": 5.0, "HandAbduction": 3.0},
}
GAIN_SD: Final = 0.05
PELVIS_GAIN_SD: Final = 0.20
ARM_GAIN_SD: Final = 0.25
WANDER_DEG: Final = 0.5  # from stride to stride
ARM_WANDER_DEG: Final = 1.5
ARM: Final = ("Shoulder", "Elbow", "ForeArm", "Wrist", "Hand")


@dataclass(frozen=True, slots=True)
class Person:
    """Who walks: sex, mass [kg], stature [m], age [years]."""

    name: str = "sub01"
    sex: Sex = "male"
    mass_kg: float = 74.6
    height_m: float = 1.78
    age: float = 26.0


@dataclass(frozen=True, slots=True)
class Style:
    """How a person's joints differ from the mean pattern.

    Attributes
    ----------
    offset, gain
        Added to the coordinates while walking, and factor of their movement, (46,).
    wander
        Standard deviation of slow variations, (46,).
    """

    offset: Array
    gain: Array
    wander: Array

    def apply(self, moved: Array, walking: Array) -> Array:
        """Give the person's movement from standing, (T, 46), in place of the mean pattern's."""
        return moved * self.gain + walking * self.offset


@dataclass(frozen=True, slots=True)
class VirtualSubject:
    """A person with a true body.

    Attributes
    ----------
    person
        Who it is.
    body
        The body that moves and weighs.
    t_pose
        Coordinates of the T-pose, standing on the floor at the lab's origin, (46,) [rad, m].
    standing
        The same with the arms hanging.
    habits, style
        How the person steps and moves.
    """

    person: Person
    body: Body
    t_pose: Array
    standing: Array
    habits: Habits
    style: Style


def make_subject(
    person: Person,
    *,
    marker_set: str = "hbm2",
    individuality: float = 0.0,
    faults: BodyFaults | None = None,
    variability: float = 1.0,
    rng: np.random.Generator | None = None,
) -> VirtualSubject:
    """Give a person a body and a way of walking.

    Parameters
    ----------
    person
        Who it is.
    marker_set
        Which markers the person wears: "hbm2" or "hbm1".
    individuality
        How much proportions and way of walking differ between people; 1 as in the population.
    faults
        How far joint centres, axes and inertias are from what markers and de Leva's table say; by
        default the body is the one that `build_body` finds.
    variability
        How much steps differ from each other; 1 as in healthy adults.
    rng
        Source of everything individual.

    Returns
    -------
    VirtualSubject
        Ready to walk.
    """
    rng = rng or np.random.default_rng(0)
    names = tuple(marker_sets()[marker_set].segment)
    parts = {f.name: 1 + individuality * BUILD_SD * _normal(rng) for f in fields(Build)}
    position = t_pose(names, person.height_m, person.sex, Build(**parts))
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
        for name, angle in HANGING_ARM.items():
            standing[INDEX[side + name]] = np.radians(angle)
    size = size_of(standing)
    habits = Habits()
    habits = replace(
        habits,
        step_m=STEP_M * size * (1 + individuality * (0.02 * _normal(rng) - TREADMILL)),
        width_m=habits.width_m * size * (1 + individuality * 0.12 * _normal(rng)),
        time_sd=variability * habits.time_sd,
        forward_sd=variability * habits.forward_sd,
        side_sd=variability * habits.side_sd,
    )
    return VirtualSubject(
        person, body, q, standing, habits, _style(individuality, variability, rng)
    )


def _normal(rng: np.random.Generator) -> float:
    return float(np.clip(rng.normal(), -2.0, 2.0))


def _style(individuality: float, variability: float, rng: np.random.Generator) -> Style:
    offset, gain, wander = np.zeros(len(COORDINATES)), np.ones(len(COORDINATES)), np.zeros(46)
    shared: dict[str, tuple[float, float]] = {}
    for i, name in enumerate(COORDINATES):
        joint = name[1:] if name[0] in "RL" else name
        arm = joint.startswith(ARM)
        if joint not in shared:
            shared[joint] = _normal(rng), _normal(rng)
        both, swing = shared[joint]
        spread = np.radians(OFFSET_SD_DEG.get(joint, 0.0))
        offset[i] = individuality * spread * (0.9 * both + 0.4 * _normal(rng))
        if joint in ("PelvisYaw", "PelvisRightRoll"):
            gain[i] += individuality * PELVIS_GAIN_SD * swing
        elif not joint.startswith("Pelvis"):
            gain[i] += individuality * (ARM_GAIN_SD if arm else GAIN_SD) * swing
        if joint.startswith(("Pelvis", "ShoulderUp", "ShoulderForward", "ShoulderInward")):
            continue
        wander[i] = variability * np.radians(ARM_WANDER_DEG if arm else WANDER_DEG)
    return Style(offset, gain, wander)
