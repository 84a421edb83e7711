"""A treadmill that bends and yields on its base, independent of the package under test.

The platform follows commanded sway and pitch as a rigid body. On top of that it moves in the six
lowest modes of point masses on springs: heave, roll, yaw, … of the base, and bending of the frame.
The inertia of the commanded motion and the forces of people excite them. A plate is part of the
masses: empty, it measures what its mass needs to move and its weight, nothing else. Somebody on the
other plate or on the boards acts on the frame, and reaches an empty plate through the modes alone.
All vectors are in platform axes (x forward, y left, z up), the origin is between the plates.
Of the program it has only the type in which a recording is given (`as_recording`).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.signal import cont2discrete, lfilter

from hbm import Markers
from pipeline.io.recording import Analog, Plate, Recording

RATE_HZ, START_S = 250, 5.0
UP_MPS2 = np.array([0.0, 0.0, 9.81])
PIVOT = np.array([0.1, 0.0, -0.4])
CORNERS = np.array(
    [(0.95, -0.6, -0.15), (-0.9, 0.6, -0.25), (0.9, 0.6, -0.05), (-0.95, -0.6, -0.35)]
)
WALKING, RUNNING, BOARDS = "walking", "running", "boards"
SENSORS = {f"s{n}": [f"s{n}{axis}" for axis in "xyz"] for n in range(4)}
"""Accelerometer -> its channels."""
ON_BOTH_SIDES = np.array([(0.9, 0.25, 0), (0.9, -0.25, 0), (-0.9, -0.25, 0), (-0.9, 0.25, 0)])


def shapes(points):
    """Displacement and rotation (P, 3, 15): three shifts, three rotations, nine bending shapes."""
    x, y, zero = points[:, 0], points[:, 1], 0 * points[:, 0]
    moved, turned = np.zeros((2, len(points), 3, 15))
    moved[:, :, :3], turned[:, :, 3:6] = np.eye(3), np.eye(3)
    moved[:, :, 3:6] = np.cross(np.eye(3)[None], points[:, None]).transpose(0, 2, 1)
    curves = [(x**2 - 0.3, 2 * x, zero), (x * y, y, x), (x**2 * y, 2 * x * y, x**2)]
    for k, (bent, by_x, by_y) in enumerate(curves):
        for axis in range(3):
            moved[:, axis, 6 + 3 * k + axis] = bent
        turned[:, :, 6 + 3 * k : 9 + 3 * k] = np.stack(
            [[zero, zero, by_y], [zero, zero, -by_x], [-by_y, by_x, zero]], axis=0
        ).transpose(2, 0, 1)
    return moved, turned


def course(rng, time, acceleration, highest_hz):
    """Random motion of this acceleration (RMS), its spectrum flat from 0.15 Hz: x, its rates."""
    omega = 2 * np.pi * np.exp(rng.uniform(np.log(0.15), np.log(highest_hz), 60))
    angle, size = omega * time[:, None] + rng.uniform(0, 2 * np.pi, 60), omega**0.5
    size *= acceleration / np.sqrt(np.sum(size**2) / 2)
    return np.sin(angle) @ (size / omega**2), np.cos(angle) @ (size / omega), -np.sin(angle) @ size


def steps(rng, time, person, mass_kg=75.0):
    """Force on the frame (N, 3) [N] of each foot, and where it acts (N, 3) [m]."""
    period, contact, peak = {
        WALKING: (0.55, 0.68, 1.1), RUNNING: (0.36, 0.25, 2.4), BOARDS: (0.7, 0.9, 1.1)
    }[person]  # fmt: skip
    starts = np.arange(0.0, time[-1], period)
    starts = starts + rng.normal(0, 0.03 * period, len(starts))
    for number, start in enumerate(starts):
        phase = (time - start) / contact
        on = (phase > 0) & (phase < 1)
        if not on.any():
            continue
        p, side = phase[on, None], (-1) ** number
        bump = np.sin(np.pi * p)
        if person != RUNNING:
            bump = bump - 0.35 * np.sin(3 * np.pi * p) * (p - p**2) * 4
        size = mass_kg * 9.81 * peak * rng.normal(1, 0.05)
        sway, forward = 0.05 * side, -0.2 * np.sin(2 * np.pi * p)
        force = size * np.hstack([forward * bump, sway * bump, -bump])
        if person == BOARDS:
            at = np.tile([rng.uniform(-0.9, 0.9), side * rng.uniform(0.55, 0.65), 0.0], (len(p), 1))
        else:
            at = np.hstack([0.35 - 0.7 * p, -0.28 + 0.08 * side + 0 * p, 0 * p])
        yield on, force, at


@dataclass(frozen=True)
class Recorded:
    """Readings of four accelerometers (N, 12) and what both plates measure (N, 6), unfiltered."""

    readings: np.ndarray
    left: np.ndarray
    right: np.ndarray


def as_recording(name, recorded):
    """Give what was recorded as the program reads it from a file: two plates, 12 channels."""
    time = np.arange(len(recorded.left)) / RATE_HZ
    plates = [
        Plate(
            number=k,
            time=time,
            wrench_in_plate=wrench,
            rotation=np.eye(3),
            center=np.zeros(3),
            corners=ON_BOTH_SIDES,
        )
        for k, wrench in enumerate((recorded.left, recorded.right), 1)
    ]
    names = tuple(channel for channels in SENSORS.values() for channel in channels)
    analog = Analog(time, names, ("m/s²",) * 12, recorded.readings)
    nobody = Markers(time[::5], (), np.empty((len(time[::5]), 0, 3)))
    return Recording(Path(name), nobody, tuple(plates), analog)


class FlexibleTreadmill:
    """One laboratory: masses, springs, damping and sensors are drawn from its seed.

    ``flexibility`` multiplies what springs yield, ``noise`` the white noise of all instruments.
    """

    def __init__(self, seed, flexibility=1.0, noise=1.0):
        rng = np.random.default_rng(seed)
        plates = [
            rng.normal((x + 0.05, middle + y, -0.1), 0.04)
            for middle in (0.28, -0.28)
            for x in np.linspace(-0.8, 0.8, 5)
            for y in (-0.12, 0.12)
        ]
        frame = rng.uniform([-1.1, -0.7, -0.5], [1.1, 0.7, -0.2], (16, 3))
        self.points = np.vstack([plates, frame])
        self.mass = np.concatenate([rng.uniform(10, 20, 20), rng.uniform(30, 60, 16)])
        moved, _ = shapes(self.points)
        inertia = np.einsum("p,pci,pcj->ij", self.mass, moved, moved)
        natural = 2 * np.pi * rng.uniform(9, 20, 15) / np.sqrt(flexibility)
        size = natural * np.sqrt(np.diag(inertia))
        coupling = np.eye(15) + 0.15 * np.tril(rng.normal(size=(15, 15)), -1)
        stiffness = size[:, None] * (coupling @ coupling.T) * size
        squared, modes = eigh(stiffness, inertia)
        self.omega, self.modes = np.sqrt(squared[:6]), modes[:, :6]
        self.damping = rng.uniform(0.02, 0.06, 6)
        self.at = CORNERS + rng.normal(0, 0.03, (4, 3))
        self.sensing = np.eye(3) + 0.01 * rng.normal(size=(4, 3, 3))
        self.offset = 0.05 * rng.normal(size=(4, 3))
        self.noise = noise

    def record(self, seed, sway=0.0, pitch=0.0, person=None, highest_hz=3.0, seconds=40.0):
        """Follow random sway [m/s² RMS] and pitch [rad/s²], with somebody walking, …, or nobody."""
        rng = np.random.default_rng(seed)
        time = np.arange(round((seconds + START_S) * RATE_HZ)) / RATE_HZ
        _, _, swaying = course(rng, time, sway, highest_hz)
        angle, rate, turning = course(rng, time, pitch, highest_hz)
        sensed, moved = self._rigid(self.at, swaying, angle, rate, turning), shapes(self.points)[0]
        masses = self._rigid(self.points, swaying, angle, rate, turning)
        push = -np.einsum("p,pci,tpc->ti", self.mass, moved, masses - UP_MPS2)
        load = np.zeros((len(time), 6))
        for on, force, at in steps(rng, time, person) if person else ():
            push[on] += np.einsum("tci,tc->ti", shapes(at)[0], force)
            load[on] -= np.hstack([force, np.cross(at, force)]) if person != BOARDS else 0.0
        amplitude, acceleration = self._vibration(push @ self.modes)
        felt = self._with_modes(sensed, self.at, amplitude, acceleration)
        felt = np.einsum("sij,tsj->tsi", self.sensing, felt) + self.offset
        felt += self.noise * rng.normal(0, 0.02, felt.shape)
        masses = self._with_modes(masses, self.points, amplitude, acceleration) - UP_MPS2
        force = masses * self.mass[:, None]
        every = np.concatenate([force, np.cross(self.points, force)], axis=2)
        left, right = every[:, :10].sum(axis=1), every[:, 10:20].sum(axis=1) - load
        noise = self.noise * np.repeat([1.5, 0.6], 3)
        both = [w + rng.normal(0, noise, w.shape) for w in (left, right)]
        begun = slice(round(START_S * RATE_HZ), None)
        return Recorded(felt.reshape(len(time), -1)[begun], *(w[begun] for w in both))

    @staticmethod
    def _rigid(points, sway, angle, rate, turning):
        """Specific force (N, P, 3) at points of a platform that pitches about a swaying pivot."""
        arm = points - PIVOT
        zero = np.zeros_like(sway)
        base = np.stack([-9.81 * np.sin(angle), sway, 9.81 * np.cos(angle)], axis=1)
        about = np.stack([zero, turning, zero], axis=1)
        plane = arm * [1, 0, 1]
        return base[:, None] + np.cross(about[:, None], arm) - rate[:, None, None] ** 2 * plane

    def _vibration(self, push):
        """Amplitudes of the modes and their accelerations, (N, 6)."""
        found = []
        for force, omega, zeta in zip(push.T, self.omega, self.damping, strict=True):
            top, bottom, _ = cont2discrete(
                ([1.0], [1.0, 2 * zeta * omega, omega**2]), 1 / RATE_HZ, "foh"
            )
            q = lfilter(top.ravel(), bottom, force)
            speed = np.gradient(q, 1 / RATE_HZ)
            found.append((q, force - 2 * zeta * omega * speed - omega**2 * q))
        return (np.stack(each, axis=1) for each in zip(*found, strict=True))

    def _with_modes(self, rigid, points, amplitude, acceleration):
        """Add what the modes accelerate, and how they turn what is fixed there under gravity."""
        moved, turned = (s @ self.modes for s in shapes(points))
        tilt = np.einsum("pci,ti->tpc", turned, amplitude)
        return rigid + np.einsum("pci,ti->tpc", moved, acceleration) - np.cross(tilt, UP_MPS2)
