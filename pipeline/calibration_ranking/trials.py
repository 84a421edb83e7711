"""The recordings of experiment 2: their files, and the signals that are compared."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from compensation import Setup, belt_acceleration
from compensation.belts import spline_cutoff
from hbm.signals.filtering import Method, low_pass
from hbm.spatial import Array, rotate_wrench
from pipeline.config.schema import Treadmill
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import (
    accelerations,
    belt_speed,
    find_accelerometers,
    stated_accelerometers,
)
from pipeline.trial.ground.belts import belt_axes
from pipeline.trial.ground.calibrations import read_empty

Progress = Callable[[str, int, int], None]
RATE_HZ: Final = 100.0
"""At which models are fitted and compared, as D-Flow's (van de Loosdrecht 2018, D.3.4)."""
PLATFORM_FILTER: Final[Method] = "zero_phase"
"""As `hbm calibration fit` filters, so that a cut-off means the same in both."""
BELT_FILTER: Final[Method] = "realtime"
"""As D-Flow filters belt speed and pitch moment while it runs (van de Loosdrecht 2018, D.3.4)."""
FOLDERS: Final = ("calibration", "validation", "belt_calibration", "belt_validation", "belt_person")


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
    options
        What is stated about the files.
    accelerometer
        Sensors with their channels, such as "rear=ch14,ch15,ch16"; without any, found by name.
    """

    plate: int = 1
    # −3 dB after both passes: the 20 Hz of each of MATLAB's two passes (van de Loosdrecht 2018,
    # D.2), which the thesis states for experiment 1; for experiment 2 it states none
    cutoff_hz: float = 16.0
    belt_channel: str = "BeltSpeed"
    # from a smoothing spline through the belt's speed (van de Loosdrecht 2018, D.3.4)
    belt_cutoff_hz: float = 10.0
    options: ReadOptions = field(default_factory=ReadOptions)
    accelerometer: tuple[str, ...] = ()


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

    calibration: list[PlatformTrial] = field(default_factory=list)
    validation: list[PlatformTrial] = field(default_factory=list)
    belt_calibration: list[BeltTrial] = field(default_factory=list)
    belt_validation: list[BeltTrial] = field(default_factory=list)
    belt_person: list[BeltTrial] = field(default_factory=list)


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
    paths = [path for name in FOLDERS for path in sorted((folder / name).glob("*.[cC]3[dD]"))]
    filled = {path.parent.name for path in paths}
    for first, second in (FOLDERS[:2], FOLDERS[2:4]):
        if (first in filled) != (second in filled):
            have, lack = (first, second) if first in filled else (second, first)
            raise ValueError(f"{folder / have} has recordings, but {folder / lack} has none")
    if filled.isdisjoint(("calibration", "belt_calibration")):
        raise ValueError(
            f"{folder}: nothing to rank; put C3D files into its sub-folders calibration and "
            "validation (pitch and sway), or belt_calibration and belt_validation"
        )
    trials = Trials()
    for done, path in enumerate(paths, start=1):
        recording, name = read_empty(path, settings.options), path.parent.name
        one = (platform_trial if name in FOLDERS[:2] else belt_trial)(recording, settings)
        getattr(trials, name).append(one)
        if progress is not None:
            progress(path.name, done, len(paths))
    return trials


def platform_trial(recording: Recording, settings: RankingSettings) -> PlatformTrial:
    """Filter plate and accelerometers of a recording equally and decimate them."""
    sensors, readings, rate, inside = _readings(recording, settings)
    wrench = _wrench(recording, settings.plate)
    setup = Setup(tuple(sensors), RATE_HZ, settings.cutoff_hz, filter_method=PLATFORM_FILTER)
    return PlatformTrial(
        recording.source.stem,
        setup.low_pass(readings, rate)[inside],
        setup.low_pass(wrench, rate)[inside],
        setup,
    )


def belt_trial(recording: Recording, settings: RankingSettings) -> BeltTrial:
    """Filter pitch moment, belt speed and accelerometers equally and decimate them."""
    sensors, readings, rate, inside = _readings(recording, settings)
    # all signals through one causal filter, so that none is late against another
    cutoff = settings.belt_cutoff_hz
    speed = belt_speed(recording, settings.belt_channel)
    spline_hz = RATE_HZ / 2
    if np.ptp(speed[inside]) > 0:  # else constant and without noise: nothing to smooth
        spline_hz = min(spline_cutoff(speed[inside], RATE_HZ), spline_hz)
    return BeltTrial(
        recording.source.stem,
        belt_acceleration(speed, rate, cutoff, BELT_FILTER)[inside],
        low_pass(_wrench(recording, settings.plate)[:, 4], rate, cutoff, BELT_FILTER)[inside],
        low_pass(readings, rate, cutoff, BELT_FILTER)[inside],
        tuple(channel for three in sensors.values() for channel in three),
        spline_hz,
    )


def _readings(
    recording: Recording, settings: RankingSettings
) -> tuple[Mapping[str, tuple[str, str, str]], Array, float, slice]:
    """Give sensors, their readings, the rate, and the samples at 100 Hz without the edges."""
    sensors = stated_accelerometers(settings.accelerometer) or find_accelerometers(recording)
    time, readings = accelerations(recording, Treadmill(accelerometers=sensors))
    rate = (len(time) - 1) / float(time[-1] - time[0])
    # every so many samples: no resampling, which would be one filter more
    step = round(rate / RATE_HZ)
    if step < 1 or abs(rate / step - RATE_HZ) > 0.01:
        raise ValueError(
            f"{recording.source.stem}: analog rate {rate:g} Hz, expected a multiple of "
            f"{RATE_HZ:g} Hz"
        )
    # half a second at either end is left out, where the low-pass is inaccurate
    edge = round(0.5 * rate)
    return sensors, readings, rate, slice(edge, len(time) - edge, step)


def factors(name: str) -> dict[str, str | float]:
    """Give kind, duration and belt speed from a trial's name; empty where it states none."""
    # as the protocol's signals are named
    pattern = r"(?P<kind>.+)_(?P<duration_s>\d+)s_(?P<speed_mps>[\d.]+)mps"
    match = re.fullmatch(pattern, name)
    texts = match.groupdict() if match is not None else {}
    return {key: text if key == "kind" else float(text) for key, text in texts.items()}


def _wrench(recording: Recording, number: int) -> Array:
    plates = {plate.number: plate for plate in recording.plates}
    if number not in plates:
        present = ", ".join(map(str, plates)) or "none"
        raise ValueError(f"{recording.source.name}: no plate {number}; plates there: {present}")
    return rotate_wrench(plates[number].wrench_in_plate, belt_axes(plates[number]).T)
