"""A moving treadmill as its instruments record it: plate, accelerometers and belt speed.

The platform follows its commands, but its base gives way: people, rollers and its own inertia make
it tremble a little in all six directions. Accelerometers and plates feel that too. Beside it stand
the faults of the instruments: noise, clipping, a drifting zero, a delay.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.signal import cont2discrete, lfilter

from compensation import Signal, resample_signal
from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2, Array, shift_wrench
from pipeline.io.recording import Analog, Plate, Recording
from pipeline.virtual_lab.machine.treadmill import (
    Assembly,
    Machine,
    PlatformMotion,
    assembly_wrench,
    belt_moment,
    drive_belt,
    move_platform,
    specific_force,
)

FRAME_HZ: Final = 100.0
PLATE_CENTER: Final = np.array([0.0, 0.25, 0.0])
CORNERS: Final = np.array([(0.9, 0.5, 0), (0.9, 0, 0), (-0.9, 0, 0), (-0.9, 0.5, 0)])
SENSORS: Final = {"Acc1": (-0.9, 0.62, -0.21), "Acc2": (0.95, -0.58, -0.17)}
BELT_CHANNEL: Final = "BeltSpeed"
PLATFORM_KG: Final = 600.0
INERTIA: Final = np.array([PLATFORM_KG] * 3 + [100.0, 300.0, 350.0])
CENTER: Final = np.array([0.0, 0.0, -0.3])
BELT_HZ: Final = 200.0
ROLLER_M: Final = 0.3


@dataclass(frozen=True, slots=True)
class Imperfections:
    """What keeps a compensation from being exact.

    Attributes
    ----------
    plate_noise
        White noise of the plate's forces at 1000 Hz, SD [N]; of its moments, half as many N·m.
    acceleration_noise
        White noise of the accelerometers at 1000 Hz, SD [m/s²].
    zero_drift
        Change of the plate's zero from trial to trial, SD [N]; of its moments, half as many N·m.
    acceleration_late_s
        How much later the accelerometers are than the plate [s].
    acceleration_range_g
        Where the accelerometers clip [g].
    base_hz, base_damping
        Natural frequencies of the platform on its base (forward, left, up, roll, pitch, yaw) [Hz]
        and their damping ratio; None for a base that does not give way.
    unbalance
        Force of an unbalanced roller by the square of the belt speed [N per (m/s)²].
    speed_noise
        Noise of the belt speed, SD [m/s].
    """

    plate_noise: float = 2.0
    acceleration_noise: float = 0.03
    zero_drift: float = 0.5
    acceleration_late_s: float = 0.001
    acceleration_range_g: float = 2.0
    base_hz: tuple[float, ...] | None = (25.0, 7.0, 30.0, 22.0, 7.0, 25.0)
    base_damping: float = 0.05
    unbalance: float = 0.2
    speed_noise: float = 0.005


PERFECT: Final = Imperfections(0.0, 0.0, 0.0, 0.0, np.inf, None, 0.05, 0.0, 0.0)
"""A rigid platform and ideal instruments."""


@dataclass(frozen=True, slots=True)
class BaseVibration:
    """Small motion of the platform on its base, in its own axes.

    Attributes
    ----------
    acceleration, turn, turning
        Acceleration of its origin [m/s²], small rotation [rad], angular acceleration [rad/s²],
        (N, 3) each.
    """

    acceleration: Array
    turn: Array
    turning: Array

    def force(self, motion: PlatformMotion, point: Array) -> Array:
        """Give what it adds to the specific force of a point, (N, 3) [m/s²]."""
        weight = specific_force(motion, np.zeros(3))
        return np.asarray(
            self.acceleration + np.cross(self.turning, point) - np.cross(self.turn, weight)
        )


def record(
    signal: Signal,
    *,
    seed: int,
    rate_hz: float = 1000.0,
    machine: Machine | None = None,
    imperfections: Imperfections | None = None,
    load: Array | None = None,
) -> Recording:
    """Let the treadmill follow a signal and record its empty left plate.

    Parameters
    ----------
    signal
        What the machine is told.
    seed
        Of the noise.
    rate_hz
        Of plate and analog channels, a multiple of 100 [Hz]; noise keeps its density.
    machine, imperfections
        By default as they come.
    load
        Wrench of people on the rest of the platform, about the lab origin with the platform in
        neutral, (N, 6) [N, N·m] at `times`.

    Returns
    -------
    Recording
        No markers; plate 1, left; two triaxial accelerometers in g; belt speed in m/s.
    """
    machine, faults = machine or Machine(), imperfections or Imperfections()
    rng = np.random.default_rng(seed)
    course = resample_signal(signal, rate_hz)
    time = times(signal, rate_hz)
    count = len(time)
    sway, pitch, told = (x[:count] for x in (course.sway, course.pitch, course.belt_speed))
    speed = drive_belt(machine, told, rate_hz)
    motion = move_platform(machine, sway, pitch, rate_hz)
    roller = _roller(speed, rate_hz, faults.unbalance, float(rng.uniform(0, 2 * np.pi)))
    acting = 2 * roller + (0 if load is None else load)
    tremble = _tremble(motion, acting, rate_hz, faults)

    wrench = _cells(motion, machine.assemblies[0], tremble) + roller
    wrench[:, 4] += belt_moment(machine, np.gradient(speed, 1 / rate_hz), rate_hz)
    grain = np.repeat([1.0, 0.5], 3)
    wrench += grain * rng.normal(0, faults.zero_drift, 6)
    wrench += grain * _white(rng, faults.plate_noise, (count, 6), rate_hz)
    in_plate = shift_wrench(wrench, PLATE_CENTER)
    plate = Plate(1, time, in_plate, np.eye(3), PLATE_CENTER, CORNERS)
    readings = [
        _reading(motion, np.array(point), tremble, faults, rng, rate_hz)
        for point in SENSORS.values()
    ]
    belt = _reported_speed(speed, rate_hz, faults.speed_noise, rng)
    names = (*(f"{sensor}.{axis}" for sensor in SENSORS for axis in "XYZ"), BELT_CHANNEL)
    units = ("g",) * 6 + ("m/s",)
    analog = Analog(time, names, units, np.column_stack([*readings, belt]))
    frames = time[:: round(rate_hz / FRAME_HZ)]
    nobody = Markers(frames, (), np.empty((len(frames), 0, 3)))
    return Recording(Path(f"{signal.name}.c3d"), nobody, (plate,), analog)


def times(signal: Signal, rate_hz: float) -> Array:
    """Give the instants of a recording: whole frames, (N,) [s]."""
    frames = int(len(signal.sway) * FRAME_HZ / signal.rate_hz) - 1
    return np.arange(frames * round(rate_hz / FRAME_HZ)) / rate_hz


def _roller(speed: Array, rate_hz: float, unbalance: float, start: float) -> Array:
    """Wrench of an unbalanced roller at the front of a belt, (N, 6)."""
    angle = start + 2 * np.pi * np.cumsum(speed) / rate_hz / ROLLER_M
    pull = unbalance * speed**2
    force = np.column_stack([pull * np.cos(angle), 0 * pull, pull * np.sin(angle)])
    return np.hstack([force, np.cross([0.9, 0.25, -0.1], force)])


def _tremble(
    motion: PlatformMotion, acting: Array, rate_hz: float, faults: Imperfections
) -> BaseVibration:
    count = motion.sway.shape[1]
    if faults.base_hz is None:
        return BaseVibration(*np.zeros((3, count, 3)))
    felt = specific_force(motion, CENTER) - specific_force(_at_rest(motion), CENTER)
    inertia = np.hstack([PLATFORM_KG * felt, np.cross(CENTER, PLATFORM_KG * felt)])
    inertia[:, 4] += INERTIA[4] * motion.pitch[2]
    pushing = acting - inertia
    place, acceleration = np.empty((2, count, 6))
    for k, hz in enumerate(faults.base_hz):
        omega = 2 * np.pi * hz
        below = np.array([1, 2 * faults.base_damping * omega, omega**2])
        push = (pushing[:, k] - pushing[0, k]) / INERTIA[k]
        for result, above, unit in (
            (place, np.array([omega**2]), omega**2),
            (acceleration, np.array([1.0, 0, 0]), 1.0),
        ):
            b, a, _ = cont2discrete((above, below), 1 / rate_hz, method="bilinear")
            result[:, k] = lfilter(b.ravel(), a, push / unit)
    return BaseVibration(acceleration[:, :3], place[:, 3:], acceleration[:, 3:])


def _at_rest(motion: PlatformMotion) -> PlatformMotion:
    return PlatformMotion(0 * motion.sway, 0 * motion.pitch, motion.pivot)


def _cells(motion: PlatformMotion, assembly: Assembly, tremble: BaseVibration) -> Array:
    center = np.array(assembly.center)
    force = assembly.mass * tremble.force(motion, center)
    moment = np.cross(center, force) + tremble.turning @ np.array(assembly.tensor)
    return np.asarray(assembly_wrench(motion, assembly) + np.hstack([force, moment]))


def _reading(
    motion: PlatformMotion,
    point: Array,
    tremble: BaseVibration,
    faults: Imperfections,
    rng: np.random.Generator,
    rate_hz: float,
) -> Array:
    """Give what an accelerometer with slightly crooked axes reads, (N, 3) [g]."""
    crooked = np.random.default_rng(int(1000 * abs(point).sum()))
    true = specific_force(motion, point) + tremble.force(motion, point)
    read = true @ (np.eye(3) + 0.015 * crooked.normal(size=(3, 3))) + 0.1 * crooked.normal(size=3)
    time = np.arange(len(read)) / rate_hz
    if faults.acceleration_late_s:
        late = time - faults.acceleration_late_s
        read = np.column_stack([np.interp(late, time, channel) for channel in read.T])
    read += _white(rng, faults.acceleration_noise, read.shape, rate_hz)
    limit = faults.acceleration_range_g
    return np.clip(read / GRAVITY_MPS2, -limit, limit)


def _reported_speed(speed: Array, rate_hz: float, noise: float, rng: np.random.Generator) -> Array:
    """Belt speed in steps of 200 Hz with noise on the way to the recorder, (N,) [m/s]."""
    step = max(round(rate_hz / BELT_HZ), 1)
    held = np.repeat(speed[::step], step)[: len(speed)]
    return np.asarray(held + _white(rng, noise, held.shape, rate_hz))


def _white(rng: np.random.Generator, sd: float, shape: tuple[int, ...], rate_hz: float) -> Array:
    return np.asarray(rng.normal(0, sd * np.sqrt(rate_hz / 1000), shape))
