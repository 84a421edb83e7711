"""Gait: the mean pattern of adults, the stance phase, and when and where the feet come down.

Timing is the person's own; places follow from balance. Sideways a foot is placed a constant
distance outside of where the extrapolated centre of mass will be when weight is transferred (Hof
2008, Hum Mov Sci 27:112): the person walks straight on, and when the platform sways, the narrow,
crossed or wide steps that follow result from this rule.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, PchipInterpolator

from hbm.coordinates import INDEX, TREE
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.virtual_lab.machine.platform import smooth_step

STANCE: Final = 0.605
"""Stance phase as a share of the gait cycle, from initial contact to foot off, at 1.3 m/s."""
LEAVING: Final = 0.565, 0.615
"""Phases of the gait cycle between which the floor gradually releases a foot, about foot off;
assumed."""
ROLL_OVER: Final = (
    (0.0, 0.08, 0.20, 0.50, 0.80, 0.92, 1.0),
    (0.22, 0.30, 0.44, 0.63, 0.81, 0.90, 0.95),
)
"""Centre of pressure: share of the stance phase, and place between heel (0) and toe tip (1). It
passes quickly from the heel, slowly under the mid-foot, and stays under the metatarsal heads before
push-off (Han et al. 1999, Gait Posture 10:248)."""

RELEASING_DEG: Final = 2.0, 12.0
"""Pitch of a foot at which the end that leaves the floor begins to be free, and at which it is;
assumed."""
MIN_END_WEIGHT: Final = 0.05
"""Weight in the leg's inverse kinematics of an end of the sole that is free; small but positive,
so that the foot's pose stays determined."""
SWING_WEIGHT: Final = 0.3
"""Weight of a swinging foot's sole; chosen, so that a leg that is too short does not jerk the
body."""
ARRIVING: Final = 0.90, 1.0
"""Phases of the gait cycle between which a swinging foot regains its full weight; assumed."""


def roll_over(phase: Array) -> Array:
    """Give the place of the centre of pressure between heel (0) and toe tip (1), (T,)."""
    return np.interp(np.clip((phase % 1) / STANCE, 0, 1), *ROLL_OVER)


def sole_weights(pitch: Array, phase: Array) -> Array:
    """Give how closely a sole's points follow their path: weights of the leg's inverse kinematics.

    Parameters
    ----------
    pitch
        How far the foot points down, (T,) [rad].
    phase
        Phase of the foot's own gait cycle, (T,).

    Returns
    -------
    Array
        Weights of heel, inner and outer ball, and ankle, (T, 4). The heel is free where only the
        ball is on the floor, and the ball where only the heel is; a swinging foot has little weight
        altogether.
    """
    low, high = np.radians(RELEASING_DEG)
    heel, ball = (
        1 - (1 - MIN_END_WEIGHT) * smooth_step((angle - low) / (high - low))
        for angle in (pitch, -pitch)
    )
    cycle = phase % 1
    released, arrived = (smooth_step((cycle - a) / (b - a)) for a, b in (LEAVING, ARRIVING))
    whole = 1 - (1 - SWING_WEIGHT) * (released - arrived)
    ends = np.stack([heel, ball, ball, np.minimum(heel, ball)], axis=1)
    return np.asarray(whole[:, None] * ends)


SPEED_MPS: Final = 1.3
STRIDE_S: Final = 1.08
STEP_M: Final = SPEED_MPS * STRIDE_S / 2
HIP_HEIGHT_M: Final = 0.949
"""Walking speed, stride time, step length, and height of the mid-hip point in standing, for which
the coefficients were fitted (``tests/virtual_gait``)."""
_FEET: Final = ("foot pitch", "foot progression", "foothold")
"""What the table has beside coordinates."""


def posture(phase: Array, extent: Array, slope: Array, standing: Array) -> Array:
    """Give the coordinates of walking in the mean pattern of healthy adults.

    Parameters
    ----------
    phase
        Phase of the right gait cycle from initial contact, (T,), in gait cycles.
    extent
        Step length relative to that of the norms, (T,); 0 for standing. The motion is scaled by it.
    slope
        How steeply the belt rises forward, (T,) [rad].
    standing
        The person's coordinates in standing with the arms hanging, (46,).

    Returns
    -------
    Array
        Coordinates, (T, 46) [rad and m]. The pelvis moves about its place in standing.
    """
    change = np.zeros((len(phase), len(standing)))
    polynomials = _polynomials(slope)
    bases = {side: _basis(phase + (0.5 if side == "L" else 0.0)) for side in " RL"}
    for name, (about_standing, _) in _table()[1].items():
        if name in _FEET:
            continue
        for side in "RL" if name.startswith("R") else " ":
            i = INDEX[name if side == " " else side + name[1:]]
            value = _evaluate(name, bases[side], polynomials)
            if not TREE[i].translates:
                value = np.radians(value)
            from_standing = about_standing or name in ("PelvisX", "PelvisY")
            change[:, i] = value - (0.0 if from_standing else standing[i])
    size = size_of(standing)
    change[:, :2] *= size
    change[:, 2] *= size * extent  # the height of a pendulum changes with the square of its angle
    return np.asarray(standing + extent[:, None] * change)


def size_of(standing: Array) -> float:
    """Give leg length relative to that of the person the coefficients were fitted for."""
    return float(standing[INDEX["PelvisZ"]]) / HIP_HEIGHT_M


def foot_angles(phase: Array) -> tuple[Array, Array]:
    """Give a foot's pitch (down) and progression (inwards) over its gait cycle, (T,) each [rad]."""
    basis, level = _basis(phase), _polynomials(np.zeros_like(phase))
    pitch, progression = (np.radians(_evaluate(name, basis, level)) for name in _FEET[:2])
    return pitch, progression


def foothold(slope: Array) -> Array:
    """Give how far ahead of the pelvis' mean place the ankle is at initial contact, (T,) [m]."""
    return _evaluate("foothold", _basis(np.zeros_like(slope)), _polynomials(slope))


def _basis(phase: Array) -> tuple[Array, Array]:
    """Give the cosines and sines of all harmonics, (T, K) each."""
    harmonics = next(iter(_table()[1].values()))[1].shape[1]
    angle = 2 * np.pi * np.outer(phase, np.arange(harmonics))
    return np.cos(angle), np.sin(angle)


def _evaluate(name: str, basis: tuple[Array, Array], polynomials: Array) -> Array:
    """Evaluate a coordinate at phases and slopes, given what is common to all coordinates, (T,)."""
    (cosines, sines), (cosine, sine) = np.moveaxis(_table()[1][name][1], 2, 0), basis
    by_slope = cosine @ cosines.T + sine @ sines.T
    return np.asarray(np.sum(by_slope * polynomials, axis=1))


def _polynomials(slope: Array) -> Array:
    """Give the Lagrange polynomials over the slopes of the table, (T, slopes)."""
    at = np.degrees(slope)[:, None]
    nodes = _table()[0].tolist()
    out = np.ones((len(slope), len(nodes)))
    for j, node in enumerate(nodes):
        for other in nodes:
            if other != node:
                out[:, j] *= (at[:, 0] - other) / (node - other)
    return out


@cache
def _table() -> tuple[Array, dict[str, tuple[bool, Array]]]:
    """Give the slopes [deg]; by name whether values add to standing, cosines and sines.

    The last are (slopes, K, 2).
    """
    path = Path(__file__).with_name("gait.csv")
    rows = pd.read_csv(path, comment="#")
    slopes, at = np.unique(rows["slope_deg"].to_numpy(float), return_inverse=True)
    rows = rows.assign(at=at)
    count = int(rows["harmonic"].max()) + 1
    found: dict[str, tuple[bool, Array]] = {}
    for name, own in rows.groupby("coordinate", sort=False):
        values = np.zeros((len(slopes), count, 2))
        values[own["at"].to_numpy(), own["harmonic"].to_numpy()] = own[
            ["cosine", "sine"]
        ].to_numpy()
        found[str(name)] = bool((own["about"] == "standing").all()), values
    return slopes, found


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
    # double support as a share of step time: the slower, the more
    overlap = NORMAL_OVERLAP + OVERLAP_PER_MPS * (SPEED_MPS - speed_mps)
    overlap = float(np.clip(overlap, MIN_OVERLAP, MAX_OVERLAP))
    off = np.append(contact[1:], contact[-1] + mean) + overlap * np.append(duration, mean)
    return Steps(contact, off, overlap)


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
