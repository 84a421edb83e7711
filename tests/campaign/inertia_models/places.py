"""Where accelerometers show most of a platform's motion."""

from itertools import combinations
from math import comb
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation.inputs import read_table
from hbm.spatial import Array, skew

ACCELERATION_MPS2: Final = 1.0
ANGULAR_RADPS2: Final = 2.0
CENTRIPETAL_PER_S2: Final = 0.3
"""Of a platform that sways and pitches and vibrates on its base: acceleration of a point, angular
acceleration, and products of angular velocities (30 °/s squared); standard deviations, assumed."""
ERROR_MPS2: Final = 0.01
"""Of a reading after the filter, standard deviation: noise, and what the platform bends."""
MAX_COMBINATIONS: Final = 200_000


def best_places(candidates_m: ArrayLike, count: int) -> tuple[int, ...]:
    """Choose the places whose accelerometers determine the platform's motion best.

    Notes
    -----
    D-optimality (Fedorov 1972): the information matrix of the twelve numbers that a rigid body's
    specific force ``f₀ + ([α]× + S) r`` consists of has the largest determinant, given what these
    vary by (Bayesian D-optimality, Chaloner and Verdinelli 1995), so that two accelerometers, which
    leave the rotation about the line between them open, can be compared too. The origin does not
    matter where the candidates surround it.

    """
    places = read_table(candidates_m, "candidates_m", 3)
    if not 1 <= count <= len(places):
        raise ValueError(f"{count} accelerometers for {len(places)} places: give more places")
    if comb(len(places), count) > MAX_COMBINATIONS:
        raise ValueError(
            f"{count} of {len(places)} places are more than {MAX_COMBINATIONS} combinations; "
            "give fewer places"
        )
    found, largest = tuple(range(count)), -np.inf
    scaled = [_felt_by_motion(place) for place in places - places.mean(axis=0)]
    single = np.stack([design.T @ design for design in scaled]) / ERROR_MPS2**2
    for chosen in combinations(range(len(places)), count):
        _, size = np.linalg.slogdet(np.eye(12) + single[list(chosen)].sum(axis=0))
        if size > largest + 1e-9:
            found, largest = chosen, float(size)
    return found


def _felt_by_motion(place: Array) -> Array:
    """Give the specific force at a place by motion in units of its standard deviation, (3, 12)."""
    x, y, z = place
    u, v, w = place / np.sqrt(2)  # elements beside the diagonal are there twice
    symmetric = np.array([(x, 0, 0, v, w, 0), (0, y, 0, u, 0, w), (0, 0, z, 0, u, v)])
    return np.hstack(
        [
            ACCELERATION_MPS2 * np.eye(3),
            -ANGULAR_RADPS2 * skew(place),
            CENTRIPETAL_PER_S2 * symmetric,
        ]
    )
