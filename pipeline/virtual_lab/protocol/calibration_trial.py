"""Trials with an empty plate: the treadmill follows a signal, or people are beside the plate."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np

from compensation.protocol import RUNNING_MPS
from compensation.signals import Signal, resample_signal
from hbm.markers import Markers
from hbm.spatial import Array
from pipeline.io.recording import Analog, Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    BELT_CHANNELS,
    InstrumentedTreadmill,
    make_treadmill,
    measure_accelerations,
    measure_belts,
    measure_plates,
    undergo,
)
from pipeline.virtual_lab.machine.instruments import ANALOG_HZ, FRAME_HZ, SAMPLES_PER_FRAME
from pipeline.virtual_lab.machine.platform import TreadmillMotion, move_platform
from pipeline.virtual_lab.machine.structure import Response
from pipeline.virtual_lab.person import bystander
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, Setting

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


@dataclass(frozen=True, slots=True)
class Beside:
    """What a person does on a treadmill that stays level, and where.

    Attributes
    ----------
    load
        Of the person, on the right belt or on the boards.
    place
        On which belt, or on the boards, where both plates stay empty.
    belts_mps
        Speed of the belts; None for that of the trials.
    """

    load: bystander.LoadPattern
    place: Literal["right", "left", "boards"]
    belts_mps: float | None = None


BESIDE: Final = {
    "walking_right.c3d": Beside(bystander.walking, "right"),
    "walking_left.c3d": Beside(bystander.walking, "left"),
    "running_right.c3d": Beside(bystander.running, "right", RUNNING_MPS),
    "running_left.c3d": Beside(bystander.running, "left", RUNNING_MPS),
    "boards.c3d": Beside(bystander.stepping_on_boards, "boards", 0.0),
}
"""Recording -> what is recorded."""
MIRRORED: Final = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""A load on the right belt by the same one on the left."""


def beside_names(setting: Setting) -> tuple[str, ...]:
    """Name the recordings of people beside an empty plate; none where the protocol has none."""
    return tuple(BESIDE) if setting.protocol.beside_s > 0 else ()


def run_beside(setting: Setting, treadmill: InstrumentedTreadmill, name: str) -> Recording:
    """Record plates, accelerometers and belts while somebody is beside a plate that stays empty.

    Parameters
    ----------
    setting
        Protocol, faults and seed.
    treadmill
        The instruments, from `make_treadmill` with the setting's faults.
    name
        A key of `BESIDE`.

    Returns
    -------
    Recording
        Without markers. Equal seeds give equal recordings.
    """
    protocol, planned = setting.protocol, BESIDE[name]
    seed = (setting.seed, len(PERSONS), 1 + list(BESIDE).index(name))
    of_load, of_motion, of_plates, of_sensors, of_belts = np.random.default_rng(seed).spawn(5)
    frames = round(protocol.beside_s * FRAME_HZ)
    time = np.arange(frames * SAMPLES_PER_FRAME) / ANALOG_HZ
    level = np.zeros(len(time))
    speed = protocol.speed_mps if planned.belts_mps is None else planned.belts_mps
    motion = TreadmillMotion(
        time,
        move_platform(treadmill.machine, level, level, ANALOG_HZ),
        level + speed,
        np.empty(0),
    )
    load = planned.load(time, of_load)
    nobody = np.zeros_like(load)
    people: tuple[Array, Array] | None = {
        "right": (nobody, -load),
        "left": (-load * MIRRORED, nobody),
        "boards": None,
    }[planned.place]
    on_frame = load if people is None else None
    response = undergo(treadmill, motion, of_motion, people, on_frame)
    streams = of_plates, of_sensors, of_belts
    return record_without_markers(name, treadmill, motion, response, BELT_CHANNELS, streams)
