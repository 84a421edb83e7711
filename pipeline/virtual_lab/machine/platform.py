"""The platform and the belt assemblies on it: how they move, and what load cells carry of them.

What moves does so by quintic splines of time, whose derivatives are exact. All formulas are those
of a rigid body with one rotation axis, written out. The load cells of a plate carry a belt
assembly: they measure what the person puts on the plate, and the assembly's own inertia and
changing weight, in the platform's moving frame.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.interpolate import BSpline, PPoly, make_interp_spline
from scipy.signal import cont2discrete, lfilter

from compensation.platform import PlatformPose
from compensation.signals import MachineLimits
from hbm.spatial import GRAVITY_MPS2, Array, skew

DEGREE: Final = 5
"""Of the splines: accelerations are still twice continuously differentiable."""
PADDING: Final = 3 * DEGREE
"""Samples by which a series is continued at both ends, so that the spline inside does not depend
on how it ends."""
_PIECES: Final = PPoly.from_spline(BSpline.basis_element(np.arange(DEGREE + 2.0)).tck)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A smooth function of time, given by a uniform quintic spline.

    Attributes
    ----------
    start
        Time of the first knot [s].
    rate_hz
        Knots per second.
    coefficients
        One row per knot and some beyond both ends, (K + 4, C).
    """

    start: float
    rate_hz: float
    coefficients: Array

    @property
    def duration(self) -> float:
        """Time from the first knot to the last [s]."""
        return (len(self.coefficients) - DEGREE) / self.rate_hz

    def at(self, time: Array, derivative: int = 0) -> Array:
        """Evaluate a derivative at any times between the knots, (T, C) [unit/s^derivative]."""
        return self.at_knots((np.asarray(time, float) - self.start) * self.rate_hz, derivative)

    def at_knots(self, position: Array, derivative: int = 0) -> Array:
        """Evaluate a derivative at places that are counted in knots, (T, C)."""
        # six basis functions are not zero between two knots
        knot = np.clip(np.floor(position).astype(int), 0, len(self.coefficients) - DEGREE - 1)
        weights = _weights(position - knot, derivative) * self.rate_hz**derivative
        value = np.zeros((len(position), self.coefficients.shape[1]))
        for k in range(DEGREE + 1):
            value += weights[:, k, None] * self.coefficients[knot + k]
        return value


def fit_trajectory(values: Array, rate_hz: float, start: float = 0.0) -> Trajectory:
    """Interpolate samples by a quintic spline.

    Parameters
    ----------
    values
        Samples at equal intervals, (K, C); more of them than `PADDING`.
    rate_hz
        Sampling rate [Hz].
    start
        Time of the first sample [s].

    Returns
    -------
    Trajectory
        Passes through the samples; four times continuously differentiable.
    """
    extended = np.pad(values, ((PADDING, PADDING), (0, 0)), mode="reflect", reflect_type="odd")
    spline = make_interp_spline(np.arange(len(extended)), extended, k=DEGREE)
    first = PADDING - DEGREE // 2
    return Trajectory(start, rate_hz, spline.c[first : first + len(values) + DEGREE - 1])


def smooth_step(x: Array) -> Array:
    """Rise from 0 (at x = 0 and below) to 1 (at x = 1 and above), without units.

    Notes
    -----
    The minimum-jerk polynomial ``10 x³ - 15 x⁴ + 6 x⁵`` (Flash and Hogan 1985, J Neurosci 5:1688):
    velocity and acceleration are zero at both ends.
    """
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


def _weights(fraction: Array, derivative: int) -> Array:
    """Give the weights of the six coefficients around places between two knots, (T, 6)."""
    places = np.arange(DEGREE, -1, -1) + fraction[:, None]
    return np.asarray(_PIECES(places, nu=derivative))


Pair = tuple[Array, Array]
"""Of the left and the right plate or belt."""
TERMS: Final = 5
"""Number of `motion_terms`."""


@dataclass(frozen=True, slots=True)
class PlatformMotion:
    """How the platform moves; rows of ``sway`` and ``pitch`` are value, velocity, acceleration.

    Attributes
    ----------
    sway
        Along the lab's left axis, (3, N) [m, m/s, m/s²].
    pitch
        About the lab's left axis, positive lowers the front, (3, N) [rad, rad/s, rad/s²].
    pivot
        A point of the pitch axis with the platform in neutral, (3,) [m].
    """

    sway: Array
    pitch: Array
    pivot: Array

    @property
    def pose(self) -> PlatformPose:
        """The platform's true pose."""
        return _turned_about(self.pivot, self.sway[0], self.pitch[0])

    def every(self, step: int) -> "PlatformMotion":
        """Give every ``step``-th sample."""
        return PlatformMotion(self.sway[:, ::step], self.pitch[:, ::step], self.pivot)


def specific_force(motion: PlatformMotion, point: Array) -> Array:
    """Give acceleration minus gravity of a point of the platform, in the platform's axes.

    Parameters
    ----------
    motion
        Of the platform.
    point
        In the platform frame, (3,) [m].

    Returns
    -------
    Array
        What an ideal accelerometer there measures, (N, 3) [m/s²].

    Notes
    -----
    With ``d`` from the pitch axis to the point: ``φ̈ ŷ×d − φ̇² (d − (d·ŷ) ŷ) + ÿ ŷ − Rᵀ g``.
    """
    specific = motion_terms(motion) @ felt_by_terms(point, motion.pivot).T
    specific[:, 2] += GRAVITY_MPS2
    return np.asarray(specific)


def motion_terms(motion: PlatformMotion) -> Array:
    """Give what the specific force of every point is linear in, (N, 5) [m/s², 1/s²].

    ``ÿ, φ̈, φ̇², g sin φ, g (1 − cos φ)``: all zero at rest in neutral.
    """
    (_, _, sway_acceleration), (angle, rate, acceleration) = motion.sway, motion.pitch
    # 1 - cos φ = 2 sin² (φ/2), which keeps its digits at small angles
    falling = GRAVITY_MPS2 * np.sin(angle), 2 * GRAVITY_MPS2 * np.sin(angle / 2) ** 2
    return np.column_stack([sway_acceleration, acceleration, rate**2, *falling])


def felt_by_terms(point: Array, pivot: Array) -> Array:
    """Give a point's specific force, less that at rest in neutral, by `motion_terms`, (3, 5)."""
    x, _, z = np.asarray(point, float) - pivot
    return np.array([[0, z, -x, -1, 0], [1, 0, 0, 0, 0], [0, -x, -z, 0, -1]])


@dataclass(frozen=True, slots=True)
class PlatformTrajectory:
    """The platform's motion at any time: sway to the left [m] and pitch [rad], front down.

    Attributes
    ----------
    trajectory
        Sway and pitch as functions of time, two columns.
    pivot
        A point of the pitch axis with the platform in neutral, (3,) [m].
    """

    trajectory: Trajectory
    pivot: Array

    def sway(self, time: Array) -> Array:
        """Give the sideways position, (T,) [m]."""
        return self._at(time)[:, 0]

    def slope(self, time: Array) -> Array:
        """Give how steeply the belts rise forward, (T,) [rad]."""
        return -self._at(time)[:, 1]

    def pose(self, time: Array) -> PlatformPose:
        """Give the platform's pose at T times.

        Before its start it rests; after its end it goes on as it came, turned about its last pose.
        """
        sway, pitch = self._at(time).T
        return _turned_about(self.pivot, sway, pitch)

    def _at(self, time: Array) -> Array:
        begin = self.trajectory.start
        end = begin + self.trajectory.duration
        # beyond the end: the motion before it, mirrored and turned about the last value
        mirrored = np.where(time > end, 2 * end - np.asarray(time), time)
        value = self.trajectory.at(np.clip(mirrored, begin, end))
        beyond = np.asarray(time) > end
        value[beyond] = 2 * self.trajectory.at(np.array([end])) - value[beyond]
        return value


def platform_trajectory(motion: PlatformMotion, rate_hz: float) -> PlatformTrajectory:
    """Interpolate the platform's motion between its samples."""
    values = np.column_stack([motion.sway[0], motion.pitch[0]])
    return PlatformTrajectory(fit_trajectory(values, rate_hz), motion.pivot)


def stationary_platform() -> PlatformTrajectory:
    """Give a platform that does not move."""
    # enough samples for a spline; one that does not move needs no more, however long the trial is
    return PlatformTrajectory(fit_trajectory(np.zeros((20, 2)), 1.0), np.zeros(3))


def _turned_about(pivot: Array, sway: Array, pitch: Array) -> PlatformPose:
    """Give the pose of a platform that is turned about an axis to the left through its pivot.

    A positive pitch lowers the front: ``x = (c, 0, -s)``, ``z = (s, 0, c)``.
    """
    # R about the left axis; the pivot p moves by the sway alone: origin = p - R p, and sway
    c, s, zero = np.cos(pitch), np.sin(pitch), np.zeros(len(pitch))
    rotation = np.stack([[c, zero, s], [zero, zero + 1, zero], [-s, zero, c]]).transpose(2, 0, 1)
    x, _, z = pivot
    origin = np.column_stack([x - c * x - s * z, sway, z + s * x - c * z])
    return PlatformPose(rotation, origin)


@dataclass(frozen=True, slots=True)
class Assembly:
    """A belt with its frame, rollers and motor, carried by the load cells of one plate.

    Attributes
    ----------
    mass
        [kg].
    center
        Centre of mass in the platform frame, (3,) [m].
    tensor
        Moment of inertia about the centre of mass, platform axes, (3, 3) [kg·m²].
    """

    mass: float
    center: tuple[float, float, float]
    tensor: tuple[tuple[float, ...], ...]


LEFT_ASSEMBLY: Final = Assembly(
    150.0, (0.34, 0.27, -0.12), ((5.2, 0.3, -0.6), (0.3, 46.0, 0.2), (-0.6, 0.2, 47.0))
)
RIGHT_ASSEMBLY: Final = Assembly(
    150.0, (0.31, -0.26, -0.13), ((5.0, -0.4, 0.5), (-0.4, 45.0, -0.2), (0.5, -0.2, 46.0))
)
BELT_ASSEMBLIES: Final = (LEFT_ASSEMBLY, RIGHT_ASSEMBLY)
"""150 kg each is what the thesis states. Centres and tensors are assumed: the motor and the driving
roller are at the front, and the tensors are about those of a box of 1.9 m by 0.6 m by 0.2 m with
small products of inertia, so that no axis of the platform is a principal axis."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Mechanical properties of the treadmill.

    Attributes
    ----------
    pivot_m
        A point of the pitch axis with the platform in neutral, (3,) [m]; its height is assumed.
    limits
        Ranges and speeds that the platform's actuators do not exceed, whatever the command.
    sway_hz, pitch_hz
        Bandwidths of the actuators, which respond as critically damped second-order systems. At
        7 Hz a step of 5 cm reaches its 0.3 m/s with the 5 m/s² that `compensation.MachineLimits`
        assumes; the pitch bandwidth is assumed.
    servo_hz
        Bandwidth of the belts' speed control, critically damped; assumed.
    belt_hz, belt_damping
        Natural frequency and damping ratio of the second-order response of a plate's pitch moment
        to belt acceleration (Hnat and van den Bogert 2014); values assumed.
    belt_moment_kg_m
        Pitch moment per belt acceleration in the steady state [N·m per m/s²]; assumed.
    """

    pivot_m: tuple[float, float, float] = (0.0, 0.0, -0.25)
    limits: MachineLimits = field(default_factory=MachineLimits)
    sway_hz: float = 7.0
    pitch_hz: float = 3.0
    servo_hz: float = 10.0
    belt_hz: float = 9.0
    belt_damping: float = 0.4
    belt_moment_kg_m: float = 4.0


@dataclass(frozen=True, slots=True)
class BeltRamp:
    """Belt speed that rises smoothly from rest and then stays constant.

    Attributes
    ----------
    speed_mps
        Final speed [m/s].
    start, ramp
        When the belt starts, and how long it takes to reach its final speed [s].
    """

    speed_mps: float
    start: float
    ramp: float

    def speed(self, time: Array) -> Array:
        """Give the speed, (T,) [m/s]."""
        return self.speed_mps * smooth_step((time - self.start) / self.ramp)

    def travelled(self, time: Array) -> Array:
        """Give the distance that the belt has travelled, the integral of its speed, (T,) [m]."""
        since = time - self.start
        x = np.clip(since / self.ramp, 0.0, 1.0)
        # ∫ 10 x³ - 15 x⁴ + 6 x⁵, and full speed after the ramp
        ramping = self.ramp * (x**6 - 3 * x**5 + 2.5 * x**4)
        return np.asarray(self.speed_mps * (ramping + np.maximum(since - self.ramp, 0.0)))


@dataclass(frozen=True, slots=True)
class TreadmillMotion:
    """How the treadmill moves in a trial, sample by sample.

    Attributes
    ----------
    time
        (N,) [s], at 1000 Hz in recordings with a person.
    platform
        The platform's true motion at these times.
    belt
        Commanded speed of both belts, (N,) [m/s].
    onsets
        When perturbations start, (P,) [s].
    """

    time: Array
    platform: PlatformMotion
    belt: Array
    onsets: Array

    @property
    def rate_hz(self) -> float:
        """Sampling rate [Hz]."""
        return round(1 / float(self.time[1] - self.time[0]), 6)


def move_platform(machine: Machine, sway: Array, pitch: Array, rate_hz: float) -> PlatformMotion:
    """Follow commanded sway and pitch within the machine's limits, starting at rest.

    Parameters
    ----------
    machine
        Limits and bandwidths.
    sway, pitch
        Commanded, (N,) [m] and [rad].
    rate_hz
        Sampling rate of the commands [Hz].

    Returns
    -------
    PlatformMotion
        Positions with their exact derivatives.
    """
    limits = machine.limits
    pitch_rad, pitch_rad_per_s = np.radians([limits.pitch_deg, limits.pitch_deg_per_s])
    sway = _limited(sway, limits.sway_m, limits.sway_m_per_s, rate_hz)
    pitch = _limited(pitch, pitch_rad, pitch_rad_per_s, rate_hz)
    return PlatformMotion(
        follow(sway, machine.sway_hz, rate_hz),
        follow(pitch, machine.pitch_hz, rate_hz),
        np.array(machine.pivot_m),
    )


def move_treadmill(
    machine: Machine, sway: Array, pitch: Array, belt: Array, rate_hz: float
) -> TreadmillMotion:
    """Follow commanded sway, pitch and belt speed, without perturbations; as `move_platform`."""
    platform = move_platform(machine, sway, pitch, rate_hz)
    return TreadmillMotion(np.arange(len(belt)) / rate_hz, platform, belt, np.empty(0))


def _limited(command: Array, max_value: float, max_speed: float, rate_hz: float) -> Array:
    """Limit a command to a range and a speed.

    A critically damped second-order system has a positive impulse response of unit area: following
    the limited command it exceeds neither.
    """
    within = np.clip(command, -max_value, max_value)
    step = max_speed / rate_hz
    if np.abs(np.diff(within)).max(initial=0.0) <= step:
        return within
    value, values = float(within[0]), []
    for target in within.tolist():
        value += min(max(target - value, -step), step)
        values.append(value)
    return np.array(values)


def follow(command: Array, bandwidth_hz: float, rate_hz: float) -> Array:
    """Respond as a critically damped second-order system to a command linear between samples.

    Gives value, velocity and acceleration, (3, N).
    """
    omega = 2 * np.pi * bandwidth_hz
    rest = float(command[0])
    rows = []
    # sᵏ ω² / (s² + 2 ω s + ω²) for value, velocity and acceleration, exact for a first-order hold
    for derivative in range(3):
        numerator = np.array([omega**2, *[0.0] * derivative])
        denominator = np.array([1, 2 * omega, omega**2])
        b, a, _ = cont2discrete((numerator, denominator), 1 / rate_hz, method="foh")
        rows.append(lfilter(b.ravel(), a, command - rest))
    rows[0] += rest
    return np.stack(rows)


def inertial_wrench(assembly: Assembly, pivot: Array) -> Array:
    """Give what the load cells of a rigid platform measure of their own belt assembly.

    Parameters
    ----------
    assembly
        On the cells.
    pivot
        A point of the pitch axis in the platform frame, (3,) [m].

    Returns
    -------
    Array
        By `motion_terms`, tared at rest in neutral, in the platform frame about its origin, with
        the sign of an action on a person standing there, (6, 5) [N, N·m per term].
    """
    force = assembly.mass * felt_by_terms(np.array(assembly.center), pivot)
    moment = skew(assembly.center) @ force
    # Euler's equation about the pitch axis ŷ: J ŷ φ̈ + φ̇² ŷ × J ŷ
    leftward = np.array([0.0, 1.0, 0.0])
    column = np.array(assembly.tensor) @ leftward
    moment[:, 1] += column
    moment[:, 2] += np.cross(leftward, column)
    return np.vstack([force, moment])


def weight_of(assembly: Assembly) -> Array:
    """Give what the cells of an assembly carry at rest in neutral, about the origin, (6,)."""
    force = np.array([0.0, 0.0, assembly.mass * GRAVITY_MPS2])
    return np.concatenate([force, np.cross(assembly.center, force)])
