"""The recordings of experiment 2: their files, and the signals that are compared."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compensation import (
    Setup,
    belt_acceleration,
    low_pass,
    spline_cutoff,
)
from hbm.signals.filtering import Method
from hbm.spatial import Array, rotate_wrench
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import (
    accelerations,
    belt_speed,
    find_accelerometers,
    stated_accelerometers,
)
from pipeline.trial.ground.belts import belt_axes
from pipeline.trial.ground.calibration_recording import read_empty

Progress = Callable[[str, int, int], None]
RATE_HZ: Final = 100.0
"""At which models are fitted and compared, as D-Flow's (van de Loosdrecht 2018, D.3.4)."""
RATE_TOLERANCE_HZ: Final = 0.01
"""Of a recording's rate, per multiple of that."""
PLATFORM_FILTER: Final[Method] = "zero_phase"
"""As `hbm calibration fit` filters, so that a cut-off means the same in both."""
PLATFORM_CUTOFF_HZ: Final = 16.0
"""−3 dB after both passes: the 20 Hz of each of MATLAB's two passes (van de Loosdrecht 2018, D.2),
which the thesis states for experiment 1; for experiment 2 it states none."""
BELT_CUTOFF_HZ: Final = 10.0
"""From a smoothing spline through the belt's speed (van de Loosdrecht 2018, D.3.4)."""
BELT_FILTER: Final[Method] = "realtime"
"""As D-Flow filters belt speed and pitch moment while it runs (van de Loosdrecht 2018, D.3.4)."""
EDGE_S: Final = 0.5
"""Left out at both ends, where the low-pass is inaccurate."""
FOLDERS: Final = ("calibration", "validation", "belt_calibration", "belt_validation", "belt_person")
NAME: Final = re.compile(r"(?P<kind>.+)_(?P<duration_s>\d+)s_(?P<speed_mps>[\d.]+)mps")
"""Of a calibration trial, as the protocol's signals are named."""


@dataclass(frozen=True, slots=True)
class RankingSettings:
    """Plate, channels and filters of a ranking.

    Attributes
    ----------
    plate
        Number of the empty plate whose compensation is scored.
    cutoff_hz
        Low-pass of plate and accelerometers, `PLATFORM_FILTER` [Hz].
    belt_channel
        Analog channel with the belt's speed.
    belt_cutoff_hz
        Low-pass of pitch moment and belt acceleration, `BELT_FILTER` [Hz].
    axes, units, plate_units
        How the files are to be read, as in `pipeline.io.stated.Stated`.
    accelerometer
        Sensors with their channels, such as "rear=ch14,ch15,ch16"; None finds them by name.
    """

    plate: int = 1
    cutoff_hz: float = PLATFORM_CUTOFF_HZ
    belt_channel: str = "BeltSpeed"
    belt_cutoff_hz: float = BELT_CUTOFF_HZ
    axes: str | None = None
    units: str | None = None
    plate_units: str | None = None
    accelerometer: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class PlatformTrial:
    """An empty plate and the accelerometers, equally filtered, at 100 Hz.

    Attributes
    ----------
    name
        Of the file.
    accelerations
        (N, k) [m/s²].
    wrench
        Along the belt, to its left and up, about the middle of the plate's surface,
        (N, 6) [N, N·m]. Which end is the front is unknown, and no RMS depends on it.
    setup
        Sensors, rate and filter.
    """

    name: str
    accelerations: Array
    wrench: Array
    setup: Setup


@dataclass(frozen=True, slots=True)
class BeltTrial:
    """An empty plate's pitch moment and the belt's acceleration, equally filtered, at 100 Hz.

    Attributes
    ----------
    name
        Of the file.
    acceleration
        Of the belt, (N,) [m/s²].
    moment
        About the axis across the belt, through the centre of the plate, (N,) [N·m].
    readings
        Of the accelerometers, through the same filter, (N, k) [m/s²].
    channels
        Names of their k channels.
    spline_cutoff_hz
        Of the smoothing spline through the belt's speed; 50 where it smooths nothing [Hz].
    """

    name: str
    acceleration: Array
    moment: Array
    readings: Array
    channels: tuple[str, ...]
    spline_cutoff_hz: float = np.nan


@dataclass(frozen=True, slots=True)
class Trials:
    """All recordings of the experiment, by sub-folder."""

    calibration: tuple[PlatformTrial, ...]
    validation: tuple[PlatformTrial, ...]
    belt_calibration: tuple[BeltTrial, ...]
    belt_validation: tuple[BeltTrial, ...]
    belt_person: tuple[BeltTrial, ...]


def read_trials(
    folder: Path, settings: RankingSettings, progress: Progress | None = None
) -> Trials:
    """Read all recordings of an experiment.

    Parameters
    ----------
    folder
        With sub-folders calibration and validation, belt_calibration and belt_validation, and
        belt_person for trials with a person on the other belt; those of the platform or of the
        belts may be missing.
    settings
        Plate, channels and filters.
    progress
        Called with the name of every file that is read, how many are, and how many there are.

    Raises
    ------
    ValueError, OSError
        If there is nothing to rank, or a recording cannot be used.
    """
    files = {name: sorted((folder / name).glob("*.[cC]3[dD]")) for name in FOLDERS}
    pairs = (FOLDERS[:2], FOLDERS[2:4])
    if not any(all(files[name] for name in pair) for pair in pairs):
        raise ValueError(
            f"{folder}: nothing to rank; put C3D files into its sub-folders calibration and "
            "validation (pitch and sway), or belt_calibration and belt_validation"
        )
    for first, second in pairs:
        if bool(files[first]) != bool(files[second]):
            have, lack = (first, second) if files[first] else (second, first)
            raise ValueError(f"{folder / have} has recordings, but {folder / lack} has none")
    stated = Stated(axes=settings.axes, units=settings.units, plate_units=settings.plate_units)
    named = [(name, path) for name, paths in files.items() for path in paths]
    platform: dict[str, list[PlatformTrial]] = {name: [] for name in FOLDERS[:2]}
    belts: dict[str, list[BeltTrial]] = {name: [] for name in FOLDERS[2:]}
    for done, (name, path) in enumerate(named, start=1):
        recording = read_empty(path, stated)
        if name in platform:
            platform[name].append(platform_trial(recording, settings))
        else:
            belts[name].append(belt_trial(recording, settings))
        if progress is not None:
            progress(path.name, done, len(named))
    return Trials(
        tuple(platform["calibration"]),
        tuple(platform["validation"]),
        *(tuple(trials) for trials in belts.values()),
    )


def platform_trial(recording: Recording, settings: RankingSettings) -> PlatformTrial:
    """Filter plate and accelerometers of a recording equally and decimate them.

    Raises
    ------
    ValueError
        If the plate or the accelerometers are missing, or the rate is not a multiple of 100 Hz.
    """
    name = recording.source.stem
    sensors = stated_accelerometers(settings.accelerometer or ()) or find_accelerometers(recording)
    time, readings = accelerations(recording, Treadmill(accelerometers=sensors))
    rate, step = _rate(time, name)
    wrench = _wrench(recording, settings.plate)
    inside = _inside(len(time), rate, step)
    setup = Setup(tuple(sensors), RATE_HZ, settings.cutoff_hz, filter_method=PLATFORM_FILTER)
    return PlatformTrial(
        name, setup.low_pass(readings, rate)[inside], setup.low_pass(wrench, rate)[inside], setup
    )


def belt_trial(recording: Recording, settings: RankingSettings) -> BeltTrial:
    """Filter pitch moment, belt speed and accelerometers equally and decimate them.

    Raises
    ------
    ValueError
        If plate, accelerometers or belt speed are missing, or the rate is not a multiple of 100 Hz.
    """
    name = recording.source.stem
    sensors = stated_accelerometers(settings.accelerometer or ()) or find_accelerometers(recording)
    time, readings = accelerations(recording, Treadmill(accelerometers=sensors))
    rate, step = _rate(time, name)
    cutoff = settings.belt_cutoff_hz
    inside = _inside(len(time), rate, step)
    speed = belt_speed(recording, settings.belt_channel)
    return BeltTrial(
        name,
        belt_acceleration(speed, rate, cutoff, BELT_FILTER)[inside],
        low_pass(_wrench(recording, settings.plate)[:, 4], rate, cutoff, BELT_FILTER)[inside],
        low_pass(readings, rate, cutoff, BELT_FILTER)[inside],
        tuple(channel for three in sensors.values() for channel in three),
        _spline_cutoff(speed[inside]),
    )


def _spline_cutoff(speed: Array) -> float:
    """Give the cut-off [Hz] of the smoothing spline through a belt's speed at 100 Hz.

    After van de Loosdrecht (2018), eq. D.8.
    """
    if np.ptp(speed) == 0:  # constant and without noise: nothing to smooth
        return RATE_HZ / 2
    return min(spline_cutoff(speed, RATE_HZ), RATE_HZ / 2)


def factors(name: str) -> dict[str, str | float]:
    """Give kind, duration and belt speed from a trial's name; empty where it states none."""
    match = NAME.fullmatch(name)
    if match is None:
        return {}
    return {
        "kind": match["kind"],
        "duration_s": float(match["duration_s"]),
        "speed_mps": float(match["speed_mps"]),
    }


def _wrench(recording: Recording, number: int) -> Array:
    for plate in recording.plates:
        if plate.number == number:
            return rotate_wrench(plate.wrench_in_plate, belt_axes(plate).T)
    present = ", ".join(str(plate.number) for plate in recording.plates) or "none"
    raise ValueError(f"{recording.source.name}: no plate {number}; plates there: {present}")


def _rate(time: Array, name: str) -> tuple[float, int]:
    rate = (len(time) - 1) / float(time[-1] - time[0])
    step = round(rate / RATE_HZ)
    if step < 1 or abs(rate / step - RATE_HZ) > RATE_TOLERANCE_HZ:
        raise ValueError(f"{name}: analog rate {rate:g} Hz, expected a multiple of {RATE_HZ:g} Hz")
    return rate, step


def _inside(count: int, rate: float, step: int) -> slice:
    """Give the samples at 100 Hz, without the edges."""
    edge = round(EDGE_S * rate)
    return slice(edge, count - edge, step)
