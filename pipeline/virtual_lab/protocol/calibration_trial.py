"""Trials with an empty plate: the treadmill follows a signal, or people are beside the plate.

A person who walks, runs or steps beside the empty plate is a simple load pattern, without a body.
`recordings` are those of experiment 2.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from compensation.protocol import (
    BELT_VARIANCE,
    PLATFORM_BELT_MPS,
    RUNNING_MPS,
    belt_signals,
    pitch_and_sway_signals,
    validation_signals,
)
from compensation.signals import Signal, resample_signal
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.io.recording import Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    BELT_CHANNELS,
    FRAME_HZ,
    PLATE_CENTERS_M,
    SAMPLES_PER_FRAME,
    InstrumentedTreadmill,
    make_treadmill,
    recorded,
    undergo,
)
from pipeline.virtual_lab.machine.platform import Pair, move_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, Setting

PERSON: Final = read_numbers("pipeline.virtual_lab.protocol", "parameters.toml", "beside")

LoadPattern = Callable[[Array, np.random.Generator], Array]
"""Gives the load of a person at times (N,) [s], (N, 6) [N, N·m]."""


def walking(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who walks on the right belt, (N, 6) [N, N·m].

    Action on the platform in neutral, about the lab origin.
    """
    return _steps(time, rng, *PERSON.walking)


def running(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who runs on the right belt, as `walking`."""
    return _steps(time, rng, *PERSON.running)


def stepping_on_boards(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who moves about on the boards beside the belts, as `walking`."""
    rate_hz = 1 / (time[1] - time[0])
    # forces and places are noise in the band of human motion, each scaled to its own size
    band = butter(2, PERSON.board_band, "band", fs=rate_hz, output="sos")
    drawn = sosfiltfilt(band, rng.normal(size=(len(time), 5)), axis=0)
    drawn /= drawn.std(axis=0)
    weight = PERSON.mass * GRAVITY_MPS2
    force = drawn[:, :3] * weight * PERSON.board_force - [0, 0, weight]
    # from one side's board to the other's and back, quickly
    side = PERSON.boards * np.tanh(3 * np.sin(2 * np.pi * time / PERSON.board_change))
    along, aside = PERSON.board_reach * drawn[:, 3] / 3, PERSON.board_aside * drawn[:, 4]
    point = np.column_stack([along, side + aside, 0 * time])
    return np.hstack([force, np.cross(point, force)])


def _steps(
    time: Array, rng: np.random.Generator, steps_per_s: float, contact_steps: float
) -> Array:
    """Give half sines of vertical force that carry the weight on average, (N, 6).

    ``contact_steps`` is contact time by step time.
    """
    weight = PERSON.mass * GRAVITY_MPS2
    wrench = np.zeros((len(time), 6))
    margin_s = 1.0  # without steps, at both ends of a recording
    starts = np.arange(margin_s, time[-1] - margin_s, 1 / steps_per_s)
    for n, start in enumerate(starts + rng.normal(0, PERSON.step_time, len(starts))):
        contact_s, side = contact_steps / steps_per_s, (-1) ** n
        rows = slice(*np.searchsorted(time, [start, start + contact_s]))
        phase = (time[rows] - start) / contact_s
        # a half sine of this amplitude carries the weight on average; braking, then propulsion
        amplitude = weight * np.pi / 2 / contact_steps * (1 + PERSON.peak * rng.normal())
        vertical = amplitude * np.sin(np.pi * phase)
        forward = -PERSON.braking * vertical * np.cos(np.pi * phase)
        lateral = PERSON.lateral * side * vertical
        force = -np.column_stack([forward, lateral, vertical])
        place = [
            PERSON.foothold - PERSON.travel * phase,
            PLATE_CENTERS_M[1, 1] + PERSON.step_width / 2 * side + 0 * phase,
            0 * phase,
        ]
        point = np.column_stack(place)
        wrench[rows] += np.hstack([force, np.cross(point, force)])
    return wrench


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
    treadmill = treadmill or make_treadmill(faults or Faults(), seed=0)  # always the same
    of_motion, of_plates, of_sensors, of_belts = np.random.default_rng(seed).spawn(4)
    command, count = resample_signal(signal, rate_hz), len(sample_times(signal, rate_hz))
    sway, pitch, belt_speed = (x[:count] for x in (command.sway, command.pitch, command.belt_speed))
    motion = move_treadmill(treadmill.machine, sway, pitch, belt_speed, rate_hz)
    people = None if load is None or on_frame else (np.zeros_like(load), -load)
    response = undergo(treadmill, motion, of_motion, people, load if on_frame else None)
    streams = of_plates, of_sensors, of_belts
    name = f"{signal.name}.c3d"
    recording = recorded(name, treadmill, motion, response, ("BeltSpeed",), streams)
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

    load: LoadPattern
    place: Literal["right", "left", "boards"]
    belts_mps: float | None = None


BESIDE: Final = {
    "walking_right.c3d": Beside(walking, "right"),
    "walking_left.c3d": Beside(walking, "left"),
    "running_right.c3d": Beside(running, "right", RUNNING_MPS),
    "running_left.c3d": Beside(running, "left", RUNNING_MPS),
    "boards.c3d": Beside(stepping_on_boards, "boards", 0.0),
}
"""Recording -> what is recorded."""


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
    # on the left belt the load is the mirror image of that on the right
    mirrored = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    sides: dict[str, Pair] = {"right": (nobody, -load), "left": (-load * mirrored, nobody)}
    people = sides.get(planned.place)
    on_frame = load if people is None else None
    response = undergo(treadmill, motion, of_motion, people, on_frame)
    streams = of_plates, of_sensors, of_belts
    return recorded(name, treadmill, motion, response, BELT_CHANNELS, streams)


TRIALS: Final = 58
"""28 calibration trials of the platform, 24 of the belts, and 6 validation trials, one of which is
belt pulses with a person on the other belt."""

BYSTANDERS: Final[dict[str, LoadPattern]] = {
    "sway": walking,
    "pitch": walking,
    "running": running,
    "boarding": stepping_on_boards,
}
"""Validation trial -> what the person on the platform beside the empty plate does."""
BESIDE_THE_BELTS: Final = (stepping_on_boards,)
"""Who is on the frame and not on the right belt."""


Planned = tuple[str, Signal, LoadPattern | None]
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
    yield "belt_person", with_person, walking


def recordings(seed: int, *, rate_hz: float = ANALOG_HZ) -> Iterator[tuple[str, Recording]]:
    """Record the trials of the experiment; give sub-folder and recording of each.

    ``seed`` is that of signals, people, instruments and noise, ``rate_hz`` the sampling rate of the
    analog channels.
    """
    rng = np.random.default_rng((seed, 7))  # not the random numbers of the signals
    treadmill = make_treadmill(Faults(), seed)
    for folder, signal, person in planned_trials(seed):
        load = None if person is None else person(sample_times(signal, rate_hz), rng)
        noise, on_frame = int(rng.integers(2**31)), person in BESIDE_THE_BELTS
        recording = record_signal_trial(
            signal, seed=noise, rate_hz=rate_hz, treadmill=treadmill, load=load, on_frame=on_frame
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
