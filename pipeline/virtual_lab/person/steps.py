"""Steps: when the feet come down, and where, so that the person keeps balance.

Timing is the person's own; places follow from balance. Sideways a foot is placed a constant
distance outside of where the extrapolated centre of mass will be when weight is transferred (Hof
2008, Hum Mov Sci 27:112): the person walks straight on, and when the platform sways, the narrow,
crossed or wide steps that follow result from this rule.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.person.gait_pattern import SPEED_MPS, STEP_M
from pipeline.virtual_lab.person.stance import STANCE

STEERING: Final = 0.04
"""Share of the sideways distance from the middle of the treadmill that each step takes back; chosen
so that people stay on the treadmill without walking visibly towards its middle."""
NORMAL_OVERLAP: Final = 2 * (STANCE - 0.5)
"""Double support as a share of step time at 1.3 m/s."""
OVERLAP_PER_MPS: Final = 0.22
MIN_OVERLAP: Final = 0.12
MAX_OVERLAP: Final = 0.36
"""Change of that share with speed, and its range: 21 % at 1.3 m/s, and 32 % at 0.8 m/s in a
treadmill recording (Moore, Hnat and van den Bogert 2015, PeerJ 3:e918)."""
INTERVALS_PER_STEP: Final = 60
"""Samples of the platform's sway per step for its integral: one every 10 ms or so."""
MAX_DEVIATION_SD: Final = 3
"""Random deviations of steps are limited to three standard deviations."""
SPARE_STEPS: Final = 6
SPARE_SHARE: Final = 0.1
"""Steps that are scheduled in excess of those expected, so that none is missing at the end."""


@dataclass(frozen=True, slots=True)
class StepParameters:
    """A person's spatiotemporal parameters, with their variability; the defaults are typical.

    Attributes
    ----------
    step_m
        Length of a step at 1.3 m/s [m].
    width_m
        Sideways distance between the centres of pressure of both feet [m].
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
    """Times of steps, alternately left (even) and right (odd).

    Attributes
    ----------
    contact
        Initial contacts, (S,) [s]; the first is when walking begins, with the left foot on the
        floor already.
    off
        When each foot leaves the floor again, (S,) [s].
    overlap
        Double support as a share of step time.
    """

    contact: Array
    off: Array
    overlap: float

    def side(self, step: int) -> str:
        """Give the side of a step, "left" or "right"."""
        return "right" if step % 2 else "left"


def step_time(parameters: StepParameters, speed_mps: float) -> float:
    """Give the mean duration of a step [s].

    Notes
    -----
    Step length grows with the square root of speed, as cadence does: their ratio, the walk ratio,
    is constant (Sekiya and Nagasaki 1998, Gait Posture 7:225).
    """
    return parameters.step_m * float(np.sqrt(speed_mps / SPEED_MPS)) / speed_mps


def schedule(
    parameters: StepParameters,
    speed_mps: float,
    start: float,
    stop: float,
    rng: np.random.Generator,
) -> Steps:
    """Choose the times of the steps.

    Parameters
    ----------
    parameters
        The person's spatiotemporal parameters.
    speed_mps
        Belt speed [m/s].
    start, stop
        Beginning of walking, and end of the trial [s]; steps continue a little longer.
    rng
        Source of the variability.

    Returns
    -------
    Steps
        Times of contact and foot off.
    """
    mean = step_time(parameters, speed_mps)
    count = int(np.ceil((stop - start) / mean * (1 + SPARE_SHARE))) + SPARE_STEPS
    deviation = np.clip(rng.normal(size=count), -MAX_DEVIATION_SD, MAX_DEVIATION_SD)
    duration = mean * (1 + parameters.time_sd * deviation)
    contact = start + np.append(0.0, np.cumsum(duration))
    overlap = double_support(speed_mps)
    off = np.append(contact[1:], contact[-1] + mean) + overlap * np.append(duration, mean)
    return Steps(contact, off, overlap)


def double_support(speed_mps: float) -> float:
    """Give double support as a share of step time: the slower, the more (`OVERLAP_PER_MPS`)."""
    overlap = NORMAL_OVERLAP + OVERLAP_PER_MPS * (SPEED_MPS - speed_mps)
    return float(np.clip(overlap, MIN_OVERLAP, MAX_OVERLAP))


def phase_of(steps: Steps, time: Array) -> Array:
    """Give the phase of the right gait cycle at which the gait pattern is evaluated, (T,).

    It is an integer at the right foot's contacts and a half more at the left's; between them it is
    scaled so that double support has the same phases at all speeds.
    """
    numbers = CubicSpline(steps.contact, np.arange(len(steps.contact)) - 1.0)(time)
    ends = np.array([-1.0, 0.0, 1.0])
    own, normal = (
        np.sort(np.append(ends, ends[:2] + share)) for share in (steps.overlap, NORMAL_OVERLAP)
    )
    own, normal = np.append(own, 1 + steps.overlap), np.append(normal, 1 + NORMAL_OVERLAP)
    whole = np.floor(numbers)
    return np.asarray((whole + PchipInterpolator(own, normal)(numbers - whole)) / 2)


def place_sideways(
    steps: Steps,
    parameters: StepParameters,
    height_m: float,
    sway: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Array:
    """Choose where the feet come down sideways.

    Parameters
    ----------
    steps
        Times of the steps.
    parameters
        The person's spatiotemporal parameters.
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
    duration = np.diff(steps.contact, append=2 * steps.contact[-1] - steps.contact[-2])
    change = steps.contact + steps.overlap / 2 * duration
    margin = parameters.width_m / (1 + np.mean(np.exp(rate * np.diff(change))))
    place = np.empty(len(change))
    place[0] = parameters.width_m / 2
    xi = place[0] - margin
    for k in range(1, len(place)):
        time = np.linspace(change[k - 1], change[k], INTERVALS_PER_STEP)
        remaining = np.exp(rate * (change[k] - time))
        pressure = place[k - 1] + sway(time)
        xi = remaining[0] * xi - rate * np.trapezoid(remaining * pressure, time)
        here = xi - float(sway(change[k : k + 1])[0])
        outward = -1.0 if k % 2 else 1.0
        middle = (place[k - 1] + here) / 2
        place[k] = here + outward * margin + STEERING * middle + parameters.side_sd * rng.normal()
    return place
