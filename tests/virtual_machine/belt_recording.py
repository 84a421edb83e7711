"""Recordings of an unloaded belt at random speed: real ones, and simulated in the same way."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.signal import butter, sosfiltfilt

from hbm.spatial import Array
from pipeline.virtual_lab.machine.belts import BeltDrive, run_belt

RATE_HZ: Final = 100.0
SECONDS: Final = 350.0
MEAN_MPS: Final = 2.0
HELD_S: Final = 0.1
"""For which the commanded acceleration is constant: the spectrum of the speed has its zeros at
multiples of 10 Hz."""
MIN_COMMAND_HZ: Final = 0.4
"""Below which the recorded speeds hold nothing."""
REPORT_HZ: Final = 50.0
"""Update rate of the recorded speeds: they come in pairs, equal or interpolated."""
COMMAND_SD_MPS2: Final = 4.74
"""Of the commanded acceleration, as identified on the first recording."""


@dataclass(frozen=True, slots=True)
class BeltRecording:
    """Pitch moment of an empty plate [N·m] and belt speed [m/s] at 100 Hz, (N,) each."""

    moment: Array
    speed: Array


def read_recording(folder: Path, number: int) -> BeltRecording:
    """Read one of the two real recordings, on even times."""
    time, moment, speed = np.loadtxt(folder / f"RandomFastSpeed{number}.txt", skiprows=1).T
    even = np.arange(len(time)) / RATE_HZ
    return BeltRecording(np.interp(even, time, moment), np.interp(even, time, speed))


def random_command(rng: np.random.Generator, sd_mps2: float, seconds: float = SECONDS) -> Array:
    """Draw commanded speeds of white acceleration, each held, at 100 Hz [m/s]."""
    held = round(HELD_S * RATE_HZ)
    acceleration = np.repeat(sd_mps2 * rng.normal(size=int(seconds / HELD_S) + 400), held)
    sos = butter(1, MIN_COMMAND_HZ, "high", fs=RATE_HZ, output="sos")
    speed = sosfiltfilt(sos, np.cumsum(acceleration) / RATE_HZ)[2000:-2000]
    return MEAN_MPS + np.asarray(speed)


def simulate_recording(
    drive: BeltDrive, sd_mps2: float, seed: int, seconds: float = SECONDS
) -> BeltRecording:
    """Record a simulated belt as the real one was: sampled at 100 Hz without any filter."""
    command_rng, belt_rng = (np.random.default_rng((seed, n)) for n in range(2))
    command = random_command(command_rng, sd_mps2, seconds)
    motion = run_belt(replace(drive, report_hz=REPORT_HZ), command, RATE_HZ, belt_rng)
    return BeltRecording(-motion.pitch_moment, motion.reported_speed)
