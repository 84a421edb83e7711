"""Steps: when feet come down, and where, so that the person does not fall.

Timing is the person's own; places follow from balance. Sideways a foot is placed a constant
distance outside of where the extrapolated centre of mass will be when weight is transferred (Hof
2008, Hum Mov Sci 27:112): the person walks straight on, and when the platform sways the next steps
become narrow, crossed or wide by themselves.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.person.gait_pattern import SPEED_MPS, STEP_M
from pipeline.virtual_lab.person.stance import STANCE

STEERING: Final = 0.04  # share of the distance from the middle that each step takes back
USUAL_OVERLAP: Final = 2 * (STANCE - 0.5)
FINE: Final = 60  # instants per step at which the platform is looked at


@dataclass(frozen=True, slots=True)
class Habits:
    """A person's own way of stepping; lengths in m, times in s.

    Attributes
    ----------
    step_m
        Length of a step at 1.3 m/s.
    width_m
        Distance of the feet's lines of pressure, sideways.
    time_sd, forward_sd, side_sd
        Standard deviations from step to step: duration relative to its mean, place forward and
        sideways [m].
    """

    step_m: float = STEP_M
    width_m: float = 0.15
    time_sd: float = 0.015
    forward_sd: float = 0.008
    side_sd: float = 0.003


@dataclass(frozen=True, slots=True)
class Steps:
    """Feet coming down, alternately left (even) and right (odd).

    Attributes
    ----------
    contact
        When each foot comes down, (S,) [s]; the first marks the moment walking begins, with the
        left foot on the floor already.
    off
        When it leaves the floor again, (S,) [s].
    overlap
        Share of a step's time that both feet are on the floor.
    """

    contact: Array
    off: Array
    overlap: float

    def side(self, step: int) -> str:
        """Give whose foot it is."""
        return "right" if step % 2 else "left"


def step_time(habits: Habits, speed_mps: float) -> float:
    """Give the mean duration of a step [s].

    Notes
    -----
    Step length grows with the square root of speed, as cadence does: their ratio, the walk ratio,
    is constant (Sekiya and Nagasaki 1998, Gait Posture 7:225).
    """
    return habits.step_m * float(np.sqrt(speed_mps / SPEED_MPS)) / speed_mps


def schedule(
    habits: Habits, speed_mps: float, start: float, stop: float, rng: np.random.Generator
) -> Steps:
    """Decide when the feet come down.

    Parameters
    ----------
    habits
        The person's way of stepping.
    speed_mps
        Belt speed [m/s].
    start, stop
        Walking begins; the trial ends [s]. Steps go on for a little longer.
    rng
        Source of the variability.

    Returns
    -------
    Steps
        Times of contact and foot off.
    """
    mean = step_time(habits, speed_mps)
    count = int(np.ceil((stop - start) / mean * 1.1)) + 6
    lasting = mean * (1 + habits.time_sd * np.clip(rng.normal(size=count), -3, 3))
    contact = start + np.append(0.0, np.cumsum(lasting))
    overlap = double_support(speed_mps)
    off = np.append(contact[1:], contact[-1] + mean) + overlap * np.append(lasting, mean)
    return Steps(contact, off, overlap)


def double_support(speed_mps: float) -> float:
    """Give the share of a step's time that both feet are on the floor: the more the slower.

    Notes
    -----
    From the norms' 21 % at 1.3 m/s to the 32 % that a real treadmill recording shows at 0.8 m/s
    (Moore, Hnat and van den Bogert 2015).
    """
    return float(np.clip(USUAL_OVERLAP + 0.22 * (SPEED_MPS - speed_mps), 0.12, 0.36))


def phase_of(steps: Steps, time: Array) -> Array:
    """Give the phase of the right gait cycle in the norms, (T,).

    It is whole at the right foot's contacts and half at the left's; between them double support
    takes as much of it as in the norms.
    """
    numbers = CubicSpline(steps.contact, np.arange(len(steps.contact)) - 1.0)(time)
    ends = np.array([-1.0, 0.0, 1.0])
    own, usual = (
        np.sort(np.append(ends, ends[:2] + share)) for share in (steps.overlap, USUAL_OVERLAP)
    )
    own, usual = np.append(own, 1 + steps.overlap), np.append(usual, 1 + USUAL_OVERLAP)
    whole = np.floor(numbers)
    return np.asarray((whole + PchipInterpolator(own, usual)(numbers - whole)) / 2)


def place_sideways(
    steps: Steps,
    habits: Habits,
    height_m: float,
    sway: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Array:
    """Decide where the feet come down sideways.

    Parameters
    ----------
    steps
        When they come down.
    habits
        The person's way of stepping.
    height_m
        Height of the centre of mass [m].
    sway
        Sideways position of the platform at any times [s] -> [m].
    rng
        Source of the variability.

    Returns
    -------
    Array
        Places in the platform's frame, (S,) [m], left positive.

    Notes
    -----
    Linear inverted pendulum: with ``ω = √(g/h)`` the extrapolated centre of mass ``ξ = y + ẏ/ω``
    obeys ``ξ̇ = ω (ξ - p)`` about the centre of pressure ``p``, which moves with the platform and
    changes feet in the middle of double support.
    """
    rate = np.sqrt(GRAVITY_MPS2 / height_m)
    lasting = np.diff(steps.contact, append=2 * steps.contact[-1] - steps.contact[-2])
    change = steps.contact + steps.overlap / 2 * lasting
    margin = habits.width_m / (1 + np.mean(np.exp(rate * np.diff(change))))
    place = np.empty(len(change))
    place[0] = habits.width_m / 2
    xi = place[0] - margin
    for k in range(1, len(place)):
        time = np.linspace(change[k - 1], change[k], FINE)
        remaining = np.exp(rate * (change[k] - time))
        pressure = place[k - 1] + sway(time)
        xi = remaining[0] * xi - rate * np.trapezoid(remaining * pressure, time)
        here = xi - float(sway(change[k : k + 1])[0])
        outward = -1.0 if k % 2 else 1.0
        middle = (place[k - 1] + here) / 2
        place[k] = here + outward * margin + STEERING * middle + habits.side_sd * rng.normal()
    return place
