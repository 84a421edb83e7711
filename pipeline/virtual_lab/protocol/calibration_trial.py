"""One trial of the calibration ranking: the treadmill follows a signal with its left plate empty.

The platform vibrates on its base, and a roller may be unbalanced; the instruments have noise, a
limited range, a drifting zero and a delay.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compensation import Signal, resample_signal
from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2, Array, shift_wrench
from pipeline.io.recording import Analog, Recording
from pipeline.virtual_lab.machine.actuators import drive_belt, move_platform
from pipeline.virtual_lab.machine.artefacts import assembly_wrench, belt_moment, roller_wrench
from pipeline.virtual_lab.machine.base_vibration import BaseVibration, ElasticBase, vibrate
from pipeline.virtual_lab.machine.instruments.accelerometer import Accelerometer
from pipeline.virtual_lab.machine.instruments.belt_speed import BeltSpeedSensor
from pipeline.virtual_lab.machine.instruments.force_plate import (
    PLATE_CENTERS_M,
    ForcePlate,
    recorded_plate,
)
from pipeline.virtual_lab.machine.instruments.sampling import (
    ANALOG_HZ,
    FRAME_HZ,
    delayed,
    noise_sd_at,
)
from pipeline.virtual_lab.machine.platform import PlatformMotion, specific_force
from pipeline.virtual_lab.machine.treadmill import Machine

SENSOR_PLACES_M: Final = {"Acc1": (-0.9, 0.62, -0.21), "Acc2": (0.95, -0.58, -0.17)}
"""Accelerometers in the platform frame: rear left and front right, as in the thesis."""
SENSITIVITY_SD: Final = 0.015
"""Standard deviation of an accelerometer's gains and of its axes' misalignment; assumed."""
SENSOR_OFFSET_SD_MPS2: Final = 0.1
"""Standard deviation of an accelerometer's offsets; assumed, 10 mg."""
MOMENT_ARM_M: Final = 0.5
"""Errors of a plate's moments per those of its forces [N·m per N]; assumed."""
BELT_CHANNEL: Final = "BeltSpeed"
DEFAULT_BASE: Final = ElasticBase((25.0, 7.0, 30.0, 22.0, 7.0, 25.0), damping=0.05)
"""Softest sideways and in pitch, in which the platform moves; assumed."""


@dataclass(frozen=True, slots=True)
class Imperfections:
    """What keeps a compensation from being exact; the sizes are assumed.

    Attributes
    ----------
    plate_noise_n
        White noise of the plate's forces at 1000 Hz, SD [N]; of its moments, half as many N·m.
    acceleration_noise_mps2
        White noise of the accelerometers at 1000 Hz, SD [m/s²].
    zero_drift_n
        Change of the plate's zero from trial to trial, SD [N]; of its moments, half as many N·m.
    acceleration_delay_s
        How much later the accelerometers are than the plate [s].
    acceleration_range_g
        Where the accelerometers clip [g].
    base
        How the platform's base yields; None for one that does not.
    unbalance_kg_per_m
        Force of an unbalanced roller by the square of the belt speed [N per (m/s)²].
    speed_noise_mps
        Noise of the belt speed at 1000 Hz, SD [m/s].
    """

    plate_noise_n: float = 2.0
    acceleration_noise_mps2: float = 0.03
    zero_drift_n: float = 0.5
    acceleration_delay_s: float = 0.001
    acceleration_range_g: float = 2.0
    base: ElasticBase | None = DEFAULT_BASE
    unbalance_kg_per_m: float = 0.2
    speed_noise_mps: float = 0.005


PERFECT: Final = Imperfections(
    plate_noise_n=0.0,
    acceleration_noise_mps2=0.0,
    zero_drift_n=0.0,
    acceleration_delay_s=0.0,
    acceleration_range_g=np.inf,
    base=None,
    unbalance_kg_per_m=0.0,
    speed_noise_mps=0.0,
)
"""A rigid base, balanced rollers, and ideal instruments but for gain, axes and offset of the
accelerometers, which a calibration finds."""


def record_signal_trial(
    signal: Signal,
    *,
    seed: int,
    rate_hz: float = ANALOG_HZ,
    machine: Machine | None = None,
    imperfections: Imperfections | None = None,
    load: Array | None = None,
) -> Recording:
    """Let the treadmill follow a signal and record its empty left plate.

    Parameters
    ----------
    signal
        What the machine is commanded.
    seed
        Seed of the noise.
    rate_hz
        Sampling rate of plate and analog channels, a multiple of 100 [Hz]; noise keeps its
        density.
    machine, imperfections
        By default those of `Machine` and `Imperfections`.
    load
        Wrench of people on the rest of the platform, about the lab origin with the platform in
        neutral, (N, 6) [N, N·m] at `sample_times`.

    Returns
    -------
    Recording
        No markers; plate 1, left; two triaxial accelerometers in g; belt speed in m/s.
    """
    machine, faults = machine or Machine(), imperfections or Imperfections()
    rng = np.random.default_rng(seed)
    command, time = resample_signal(signal, rate_hz), sample_times(signal, rate_hz)
    sway, pitch, belt_speed = (
        x[: len(time)] for x in (command.sway, command.pitch, command.belt_speed)
    )
    speed = drive_belt(machine, belt_speed, rate_hz)
    motion = move_platform(machine, sway, pitch, rate_hz)
    start_rad = float(rng.uniform(0, 2 * np.pi))
    roller = roller_wrench(speed, rate_hz, faults.unbalance_kg_per_m, start_rad)
    both_rollers = 2 * roller
    vibration = vibrate(faults.base, motion, both_rollers + (0 if load is None else load), rate_hz)

    assembly = machine.assemblies[0]
    wrench = assembly_wrench(motion, assembly) + vibration.assembly_wrench(motion, assembly)
    wrench += roller
    wrench[:, 4] += belt_moment(machine, np.gradient(speed, 1 / rate_hz), rate_hz)
    plate = _plate(faults, rate_hz, rng)
    measured = shift_wrench(plate.measure(wrench, time, rng), PLATE_CENTERS_M[0])
    readings = [
        _reading(sensor, motion, vibration, time, faults.acceleration_delay_s, rng)
        for sensor in _sensors(faults, rate_hz)
    ]
    belt = BeltSpeedSensor(noise_sd_at(faults.speed_noise_mps, rate_hz))
    channels = np.column_stack([*readings, belt.measure(speed, rate_hz, rng)])
    names = (*(f"{sensor}.{axis}" for sensor in SENSOR_PLACES_M for axis in "XYZ"), BELT_CHANNEL)
    units = ("g",) * (len(names) - 1) + ("m/s",)
    frames = time[:: round(rate_hz / FRAME_HZ)]
    return Recording(
        Path(f"{signal.name}.c3d"),
        Markers(frames, (), np.empty((len(frames), 0, 3))),
        (recorded_plate(1, time, measured),),
        Analog(time, names, units, channels),
    )


def sample_times(signal: Signal, rate_hz: float) -> Array:
    """Give the sample times of a recording of a signal: whole frames, (N,) [s]."""
    frames = int(len(signal.sway) * FRAME_HZ / signal.rate_hz) - 1
    return np.arange(frames * round(rate_hz / FRAME_HZ)) / rate_hz


def _plate(faults: Imperfections, rate_hz: float, rng: np.random.Generator) -> ForcePlate:
    """Draw the zero of this trial; errors are about the platform's origin."""
    scale = np.repeat([1.0, MOMENT_ARM_M], 3)
    return ForcePlate(
        offset=scale * rng.normal(0, faults.zero_drift_n, 6),
        noise=scale * noise_sd_at(faults.plate_noise_n, rate_hz),
    )


def _sensors(faults: Imperfections, rate_hz: float) -> list[Accelerometer]:
    """Give the accelerometers, whose gains, axes and offsets are the same in every trial."""
    sensors = []
    for name, place in SENSOR_PLACES_M.items():
        point = np.array(place)
        rng = np.random.default_rng(int(1000 * abs(point).sum()))
        sensors.append(
            Accelerometer(
                name,
                point,
                sensitivity=(np.eye(3) + SENSITIVITY_SD * rng.normal(size=(3, 3))).T,
                offset=SENSOR_OFFSET_SD_MPS2 * rng.normal(size=3),
                noise=noise_sd_at(faults.acceleration_noise_mps2, rate_hz),
                limit=faults.acceleration_range_g * GRAVITY_MPS2,
            )
        )
    return sensors


def _reading(
    sensor: Accelerometer,
    motion: PlatformMotion,
    vibration: BaseVibration,
    time: Array,
    delay_s: float,
    rng: np.random.Generator,
) -> Array:
    """Give what an accelerometer reports, (N, 3) [g], g being that of the simulation."""
    true = specific_force(motion, sensor.place) + vibration.specific_force(motion, sensor.place)
    return sensor.measure(delayed(true, delay_s, time), rng) / GRAVITY_MPS2
