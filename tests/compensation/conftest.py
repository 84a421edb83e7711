"""A platform simulated by the Newton–Euler equations, independent of the package under test.

Two belt assemblies ride on a rigid platform. Each assembly is a rigid body with mass ``m``, centre
``c`` and inertia tensor ``I`` about that centre, in platform axes. The load cells push on it with
``F = m (a_c - g)`` and rotate it with ``M_c = I α + ω × I ω``; about the platform's origin that is
``M = M_c + c × F``. An accelerometer at ``p`` reads ``a_p - g`` in its own, slightly rotated axes.

Where a linear compensation is exact, and where not. With platform-frame vectors, every point has
the specific force ``f(p) = f₀ + W p``, where ``W = [α]× + [ω]×[ω]×``. ``F`` and ``M`` are sums of
``m f`` and ``p × m f`` over the assembly, hence linear in the 3 + 9 numbers ``(f₀, W)``.

* Sway and pitch: ``α = (0, α, 0)``, ``ω = (0, ω, 0)``, so ``W = α [e_y]× - ω² (1 - e_y e_yᵀ)``:
  5 unknowns ``(f₀, α, ω²)``. Two sensors with baseline ``d`` give ``f(p₁)`` and
  ``W d = α (d_z, 0, -d_x) - ω² (d_x, 0, d_z)``, whose determinant ``-(d_x² + d_z²)`` vanishes only
  for a baseline along the pitch axis. Otherwise all is known: *exact*, the ω² term included, with
  rank 5 + 1 of 6 + 1 columns (both sensors measure the same sway). One sensor: 3 equations for 5
  unknowns, an approximation.
* Any motion in space: four sensors ``p₁ … p₄`` not in one plane give ``W`` on three independent
  baselines and so all 12 unknowns: *exact*. Four in one plane do not determine ``W n`` along the
  normal ``n``; its antisymmetric part follows from the rest up to products ``ωᵢωⱼ``, an
  approximation that is good as long as rotation is slow.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

GRAVITY_MPS2 = np.array([0, 0, -9.81])
REAR_LEFT, FRONT_RIGHT = (-0.9, 0.62, -0.21), (0.95, -0.58, -0.17)
FRONT_LEFT, REAR_RIGHT = (0.88, 0.6, -0.05), (-0.86, -0.63, -0.33)
PLACES = {
    "one": (REAR_LEFT,),
    "parallel": (REAR_LEFT, (-0.9, -0.6, -0.21)),  # the baseline is parallel to the pitch axis
    "two": (REAR_LEFT, FRONT_RIGHT),
    "four": (REAR_LEFT, FRONT_RIGHT, FRONT_LEFT, REAR_RIGHT),
    "four in a plane": tuple((x, y, -0.2) for x in (-0.9, 0.9) for y in (-0.6, 0.6)),
}


@dataclass(frozen=True)
class Assembly:
    mass: float
    center: tuple
    inertia: tuple


LEFT = Assembly(
    150.0, (-0.21, 0.27, -0.13), ((3.1, 0.4, -0.7), (0.4, 44.0, 0.3), (-0.7, 0.3, 45.0))
)
RIGHT = Assembly(
    150.0, (-0.17, -0.31, -0.15), ((2.8, -0.5, 0.6), (-0.5, 41.0, -0.2), (0.6, -0.2, 43.0))
)


@dataclass(frozen=True)
class Motion:
    """Rotation platform to lab; angular velocity, acceleration and a₀ - g in platform axes."""

    rotation: np.ndarray
    position: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    force_0: np.ndarray

    def specific_force(self, point):
        centripetal = np.cross(self.omega, np.cross(self.omega, point))
        return self.force_0 + np.cross(self.alpha, point) + centripetal


def smooth_random(rng, time, largest, low_hz=0.15, high_hz=5.0):
    """Sum of sines with random phases and a flat acceleration spectrum: x, its rate, its second."""
    omega = 2 * np.pi * np.sort(rng.uniform(low_hz, high_hz, 40))
    angle = omega * time[:, None] + rng.uniform(0, 2 * np.pi, 40)
    size = omega**-2.0
    x = np.cos(angle) @ size
    size = size * largest / np.max(np.abs(x))
    return np.cos(angle) @ size, -np.sin(angle) @ (size * omega), -np.cos(angle) @ (size * omega**2)


def rotation_matrix(axis, angle):
    rotation = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[:, axis, axis] = 1
    rotation[:, i, i] = rotation[:, j, j] = np.cos(angle)
    rotation[:, i, j], rotation[:, j, i] = -np.sin(angle), np.sin(angle)
    return rotation


def apply(rotation, vector):
    return np.einsum("tij,tj->ti", rotation, np.broadcast_to(vector, (len(rotation), 3)))


def pitch_and_sway(sway, pitch, pivot=(0.15, 0.0, -0.4)):
    """Motion of a platform that rotates about a lateral axis through a pivot that sways.

    ``sway`` and ``pitch`` are each (value, rate, second derivative).
    """
    (y, _, ay), (angle, rate, acceleration) = sway, pitch
    rotation, lateral = rotation_matrix(1, angle), np.array([0.0, 1, 0])
    omega, alpha = rate[:, None] * lateral, acceleration[:, None] * lateral
    back = np.swapaxes(rotation, 1, 2)
    arm = -np.asarray(pivot)  # from the pivot to the platform's origin
    force_0 = (
        apply(back, ay[:, None] * lateral - GRAVITY_MPS2)
        + np.cross(alpha, arm)
        + np.cross(omega, np.cross(omega, arm))
    )
    position = y[:, None] * lateral + pivot + apply(rotation, arm)
    return Motion(rotation, position, omega, alpha, force_0)


@lru_cache(maxsize=6)
def random_motion(seed, duration, rate_hz, late_s):
    rng, time = np.random.default_rng(seed), np.arange(int(duration * rate_hz)) / rate_hz - late_s
    return pitch_and_sway(
        smooth_random(rng, time, 0.0475), smooth_random(rng, time, np.radians(9.5))
    )


def motion_in_space(rng, time, largest=0.17):
    """Three translations and three rotations, R = R_y R_x R_z."""
    (b, db, ddb), (a, da, dda), (c, dc, ddc) = (smooth_random(rng, time, largest) for _ in "yxz")
    shift = [smooth_random(rng, time, 0.05) for _ in "xyz"]
    inner, last = rotation_matrix(0, a) @ rotation_matrix(2, c), rotation_matrix(2, c)
    y, x, z = (
        apply(np.swapaxes(inner, 1, 2), (0, 1, 0)),
        apply(np.swapaxes(last, 1, 2), (1, 0, 0)),
        np.array([0.0, 0, 1]),
    )
    db, da, dc, ddb, dda, ddc = (v[:, None] for v in (db, da, dc, ddb, dda, ddc))
    omega_inner = x * da + z * dc
    omega = y * db + omega_inner
    alpha = y * ddb + np.cross(y, omega_inner) * db + x * dda + np.cross(x, z * dc) * da + z * ddc
    rotation = rotation_matrix(1, b) @ inner
    back = np.swapaxes(rotation, 1, 2)
    force_0 = apply(back, np.column_stack([s[2] for s in shift]) - GRAVITY_MPS2)
    return Motion(rotation, np.column_stack([s[0] for s in shift]), omega, alpha, force_0)


def plate_wrench(assembly, motion):
    """What a plate, zeroed in neutral, measures of its own belt assembly, in platform axes."""
    inertia, center = np.array(assembly.inertia), np.array(assembly.center)
    force = assembly.mass * motion.specific_force(center)
    moment = (
        motion.alpha @ inertia
        + np.cross(motion.omega, motion.omega @ inertia)
        + np.cross(center, force)
    )
    weight = -assembly.mass * GRAVITY_MPS2
    return np.hstack([force - weight, moment - np.cross(center, weight)])


def accelerometers(motion, positions, rng, crooked=True):
    """Readings (T, 3 n): gain errors of 1 %, axes 1° off, offsets of 10 mg; no noise."""
    channels = []
    for position in positions:
        reading = motion.specific_force(np.array(position))
        if crooked:
            distortion = np.eye(3) + 0.015 * rng.normal(size=(3, 3))
            reading = reading @ distortion + 0.1 * rng.normal(size=3)
        channels.append(reading)
    return np.hstack(channels)


@dataclass(frozen=True)
class Trial:
    motion: Motion
    accelerations: np.ndarray
    wrench: np.ndarray
    accelerations_clean: np.ndarray
    wrench_clean: np.ndarray


class MovingPlatform:
    """One laboratory: its sensors keep their crookedness from trial to trial."""

    force_noise, moment_noise, acceleration_noise = 3.0, 1.5, 0.05  # SD at 1000 Hz

    def __init__(self, positions=(REAR_LEFT, FRONT_RIGHT), assembly=LEFT, crooked=True):
        self.positions, self.assembly, self.crooked = positions, assembly, crooked

    def record(self, motion, noise=None, cutoff_hz=None, person=0.0):
        """Read all instruments along a motion; ``noise`` is its seed, then low-pass and 100 Hz."""
        clean_a = accelerometers(
            motion, self.positions, np.random.default_rng(8), crooked=self.crooked
        )
        clean_w = plate_wrench(self.assembly, motion) + person
        a, w = clean_a, clean_w
        if noise is not None:
            rng = np.random.default_rng(noise)
            a = a + self.acceleration_noise * rng.normal(size=a.shape)
            size = np.repeat([self.force_noise, self.moment_noise], 3)
            w = w + size * rng.normal(size=w.shape)
        signals = [a, w, clean_a, clean_w]
        if cutoff_hz is not None:
            sos = butter(2, cutoff_hz, fs=1000, output="sos")
            signals = [sosfiltfilt(sos, s, axis=0)[500:-500:10] for s in signals]
        return Trial(motion, *signals)

    def random_trial(self, seed, duration=60.0, rate_hz=1000.0, late_s=0.0, **options):
        """Random sway (±4.75 cm) and pitch (±9.5°), all of it `late_s` late."""
        return self.record(random_motion(seed, duration, rate_hz, late_s), **options)

    def follow(self, sway, pitch, rate_hz=1000.0, **options):
        """Follow commanded positions given at 100 Hz, as smoothly as five derivatives allow."""
        at = np.arange(len(sway)) / 100
        time = np.arange(0, at[-1], 1 / rate_hz)
        courses = [make_interp_spline(at, course, k=5) for course in (sway, pitch)]
        motion = pitch_and_sway(
            *([course(time, order) for order in range(3)] for course in courses)
        )
        return self.record(motion, **options)

    def spatial_trial(self, seed, duration=60.0, rate_hz=100.0, **options):
        """Random translation and rotation in all six degrees of freedom."""
        time = np.arange(int(duration * rate_hz)) / rate_hz
        return self.record(motion_in_space(np.random.default_rng(seed), time), **options)

    def slow_pitch_trial(self, duration=60.0, rate_hz=1000.0, **options):
        """Pitch ± 10° in a sine of 30 s, no sway: the thesis' third condition."""
        angle = 2 * np.pi / 30 * np.arange(int(duration * rate_hz)) / rate_hz
        size, rate = np.radians(10), 2 * np.pi / 30
        pitch = size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)
        return self.record(pitch_and_sway(np.zeros((3, len(angle))), pitch), **options)


@pytest.fixture(scope="session")
def laboratory():
    """The class itself, to build laboratories from."""
    return MovingPlatform


@pytest.fixture(scope="session")
def assemblies():
    return {"left": LEFT, "right": RIGHT}


@pytest.fixture(scope="session")
def sensor_places():
    return PLACES
