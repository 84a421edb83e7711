"""One trial of the calibration ranking: the treadmill follows a signal, its left plate empty."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from compensation.signals import Signal, resample_signal
from hbm.markers import Markers
from hbm.spatial import Array
from pipeline.io.recording import Analog, Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
    undergo,
)
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ, FRAME_HZ
from pipeline.virtual_lab.machine.readings import (
    measure_accelerations,
    measure_belts,
    measure_plates,
)
from pipeline.virtual_lab.machine.treadmill import TreadmillMotion
from pipeline.virtual_lab.machine.vibration import Response

BELT_CHANNEL: Final = "BeltSpeed"
LABORATORY: Final = 0
"""Seed of the instruments where none are given: every such trial has the same."""


def record_signal_trial(
    signal: Signal,
    *,
    seed: int,
    rate_hz: float = ANALOG_HZ,
    treadmill: InstrumentedTreadmill | None = None,
    faults: Faults | None = None,
    load: Array | None = None,
    on_frame: Array | None = None,
) -> Recording:
    """Let the treadmill follow a signal and record its empty left plate.

    Parameters
    ----------
    signal
        What the machine is commanded.
    seed
        Seed of the noise, the rollers' angles and the belts' rumble.
    rate_hz
        Sampling rate of plate and analog channels, a multiple of 100 [Hz]; noise keeps its
        density.
    treadmill
        With its instruments; by default the same one in every trial, with ``faults``.
    faults
        Of the default treadmill; by default `Faults`.
    load
        Action of a person on the right belt, about the lab origin with the platform in neutral,
        (N, 6) [N, N·m] at `sample_times`.
    on_frame
        Action of people on the frame beside the belts, likewise.

    Returns
    -------
    Recording
        No markers; plate 1, left; the accelerometers in g; belt speed in m/s.
    """
    treadmill = treadmill or make_treadmill(faults or Faults(), LABORATORY)
    of_motion, of_plates, of_sensors, of_belts = np.random.default_rng(seed).spawn(4)
    command, time = resample_signal(signal, rate_hz), sample_times(signal, rate_hz)
    sway, pitch, belt_speed = (
        x[: len(time)] for x in (command.sway, command.pitch, command.belt_speed)
    )
    motion = TreadmillMotion(
        time,
        move_platform(treadmill.machine, sway, pitch, rate_hz),
        belt_speed,
        np.empty(0),
    )
    people = None if load is None else (np.zeros_like(load), -load)
    response = undergo(treadmill, motion, of_motion, people, on_frame)
    streams = of_plates, of_sensors, of_belts
    recording = record_without_markers(
        f"{signal.name}.c3d", treadmill, motion, response, (BELT_CHANNEL,), streams
    )
    return replace(recording, plates=recording.plates[:1])


def record_without_markers(
    name: str,
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    response: Response,
    belts: tuple[str, ...],
    streams: tuple[np.random.Generator, np.random.Generator, np.random.Generator],
) -> Recording:
    """Record plates, accelerometers and the speed of belts, by the names of their channels.

    Parameters
    ----------
    name
        Of the file.
    treadmill, motion, response
        The instruments, how the treadmill moved, and what they underwent.
    belts
        Channels of belt speed, the left one first.
    streams
        Sources of the noise of plates, accelerometers and belts.

    Returns
    -------
    Recording
        Its frames are at the cameras' rate and hold no marker.
    """
    of_plates, of_sensors, of_belts = streams
    names, units, readings = measure_accelerations(treadmill, motion, response, of_sensors)
    belts, belt_units, speeds = measure_belts(treadmill, motion, response, belts, of_belts)
    frames = motion.time[:: round(motion.rate_hz / FRAME_HZ)]
    return Recording(
        Path(name),
        Markers(frames, (), np.empty((len(frames), 0, 3))),
        measure_plates(treadmill, motion, response, of_plates),
        Analog(motion.time, names + belts, units + belt_units, np.hstack([readings, speeds])),
    )


def sample_times(signal: Signal, rate_hz: float) -> Array:
    """Give the sample times of a recording of a signal: whole frames, (N,) [s]."""
    frames = int(len(signal.sway) * FRAME_HZ / signal.rate_hz) - 1
    return np.arange(frames * round(rate_hz / FRAME_HZ)) / rate_hz
