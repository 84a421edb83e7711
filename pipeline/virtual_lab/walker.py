"""People: stature, mass, sex, and a body of their own."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.body import Body, build_body
from hbm.coordinates import INDEX
from hbm.kinematics import solve_ik
from hbm.markers import Markers, marker_sets
from hbm.segments import Sex
from hbm.spatial import Array
from pipeline.virtual_lab.anatomy import Build, t_pose

HANGING_ARM: Final = {"ShoulderAbduction": 8.0, "ElbowFlexion": 10.0}


@dataclass(frozen=True, slots=True)
class Person:
    """Who walks: sex, mass [kg], stature [m], age [years]."""

    name: str = "sub01"
    sex: Sex = "male"
    mass_kg: float = 74.6
    height_m: float = 1.78
    age: float = 26.0


@dataclass(frozen=True, slots=True)
class Walker:
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
    """

    person: Person
    body: Body
    t_pose: Array
    standing: Array


def make_walker(person: Person, *, marker_set: str = "hbm2") -> Walker:
    """Give a person a body.

    Parameters
    ----------
    person
        Who it is.
    marker_set
        Which markers the person wears: "hbm2" or "hbm1".

    Returns
    -------
    Walker
        Ready to walk.
    """
    names = tuple(marker_sets()[marker_set].segment)
    position = t_pose(names, person.height_m, person.sex, Build())
    pose = Markers(np.arange(2.0), names, np.stack([position, position]))
    body = build_body(
        pose,
        mass=person.mass_kg,
        sex=person.sex,
        marker_set=marker_set,
        height_m=person.height_m,
    )
    q = np.array(solve_ik(body, pose).q[0])
    standing = q.copy()
    for side in "RL":
        for name, angle in HANGING_ARM.items():
            standing[INDEX[side + name]] = np.radians(angle)
    return Walker(person, body, q, standing)
