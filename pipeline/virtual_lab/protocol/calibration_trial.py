"""Trials with an empty plate: the treadmill follows a signal, or people are beside the plate.

`recordings` are those of experiment 2.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np

from compensation.protocol import (
    BELT_VARIANCE,
    PLATFORM_BELT_MPS,
    RUNNING_MPS,
    belt_signals,
    pitch_and_sway_signals,
    validation_signals,
)
from compensation.signals import Signal, resample_signal
from hbm.spatial import Array
from pipeline.io.recording import Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    BELT_CHANNELS,
    InstrumentedTreadmill,
    make_treadmill,
    recorded,
    undergo,
)
from pipeline.virtual_lab.machine.instruments import ANALOG_HZ, FRAME_HZ, SAMPLES_PER_FRAME
from pipeline.virtual_lab.machine.platform import Pair, move_treadmill
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
    on_frame: bool = False,
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
        Whether the person is on the frame beside the belts instead.

    Returns
    -------
    Recording
        No markers; plate 1, left; the accelerometers in g; belt speed in m/s.
    """
    treadmill = treadmill or make_treadmill(faults or Faults(), LABORATORY)
    of_motion, of_plates, of_sensors, of_belts = np.random.default_rng(seed).spawn(4)
    command, count = resample_signal(signal, rate_hz), len(sample_times(signal, rate_hz))
    sway, pitch, belt_speed = (x[:count] for x in (command.sway, command.pitch, command.belt_speed))
    motion = move_treadmill(treadmill.machine, sway, pitch, belt_speed, rate_hz)
    people = None if load is None or on_frame else (np.zeros_like(load), -load)
    response = undergo(treadmill, motion, of_motion, people, load if on_frame else None)
    streams = of_plates, of_sensors, of_belts
    name = f"{signal.name}.c3d"
    recording = recorded(name, treadmill, motion, response, (BELT_CHANNEL,), streams)
    return replace(recording, plates=recording.plates[:1])


def sample_times(signal: Signal, rate_hz: float) -> Array:
    """Give the sample times of a recording of a signal: whole frames, (N,) [s]."""
    frames = int(len(signal.sway) * FRAME_HZ / signal.rate_hz) - 1
    return np.arange(frames * round(rate_hz / FRAME_HZ)) / rate_hz


class Beside(NamedTuple):
    """What a person does on a treadmill that stays level, and where.

    ``place`` is on which belt, or on the boards, where both plates stay empty; ``belts_mps`` is
    None for the speed of the trials.
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
    motion = move_treadmill(treadmill.machine, level, level, level + speed, ANALOG_HZ)
    load = planned.load(time, of_load)
    nobody = np.zeros_like(load)
    sides: dict[str, Pair] = {"right": (nobody, -load), "left": (-load * MIRRORED, nobody)}
    people = sides.get(planned.place)
    on_frame = load if people is None else None
    response = undergo(treadmill, motion, of_motion, people, on_frame)
    streams = of_plates, of_sensors, of_belts
    return recorded(name, treadmill, motion, response, BELT_CHANNELS, streams)


TRIALS: Final = 58
"""28 calibration trials of the platform, 24 of the belts, and 6 validation trials, one of which is
belt pulses with a person on the other belt."""
TRIAL_STREAM: Final = 7
"""Number of the random numbers of people and noise, which are not those of the signals."""

BYSTANDERS: Final[dict[str, bystander.LoadPattern]] = {
    "sway": bystander.walking,
    "pitch": bystander.walking,
    "running": bystander.running,
    "boarding": bystander.stepping_on_boards,
}
"""Validation trial -> what the person on the platform beside the empty plate does."""
BESIDE_THE_BELTS: Final = (bystander.stepping_on_boards,)
"""Who is on the frame and not on the right belt."""


Planned = tuple[str, Signal, bystander.LoadPattern | None]
"""Sub-folder of a recording, what the treadmill is commanded, and the load of a person, if any."""


def planned_trials(seed: int) -> Iterator[Planned]:
    """List the trials of the experiment in the order in which they are recorded."""
    for n, speed in enumerate(PLATFORM_BELT_MPS):
        for signal in pitch_and_sway_signals(2 * seed + n, speed):
            yield "calibration", signal, None
    for n, speed in enumerate(BELT_VARIANCE):
        for signal in belt_signals(2 * seed + n, speed):
            yield "belt_calibration", signal, None
    *platform, belt, with_person = validation_signals(seed)
    for signal in platform:
        yield "validation", signal, BYSTANDERS[signal.name]
    yield "belt_validation", belt, None
    yield "belt_person", with_person, bystander.walking


def recordings(seed: int, *, rate_hz: float = ANALOG_HZ) -> Iterator[tuple[str, Recording]]:
    """Record the trials of the experiment; give sub-folder and recording of each.

    ``seed`` is that of signals, people, instruments and noise, ``rate_hz`` the sampling rate of the
    analog channels.
    """
    rng = np.random.default_rng((seed, TRIAL_STREAM))
    treadmill = make_treadmill(Faults(), seed)
    for folder, signal, person in planned_trials(seed):
        load = None if person is None else person(sample_times(signal, rate_hz), rng)
        noise, on_frame = int(rng.integers(2**31)), person in BESIDE_THE_BELTS
        recording = record_signal_trial(
            signal,
            seed=noise,
            rate_hz=rate_hz,
            treadmill=treadmill,
            load=load,
            on_frame=on_frame,
        )
        yield folder, recording


def simulate_ranking(folder: Path, seed: int, rate_hz: float = ANALOG_HZ) -> Iterator[Path]:
    """Write `recordings` as C3D files into the sub-folders that `hbm calibration rank` reads.

    Yields
    ------
    pathlib.Path
        Each file, once it is written.
    """
    for name, recording in recordings(seed, rate_hz=rate_hz):
        path = folder / name / recording.source
        write_c3d(path, recording.markers, recording.plates, analog=recording.analog)
        yield path
