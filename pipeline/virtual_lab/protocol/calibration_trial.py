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
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.io.recording import Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    BELT_CHANNELS,
    FRAME_HZ,
    SAMPLES_PER_FRAME,
    InstrumentedTreadmill,
    make_treadmill,
    recorded,
    undergo,
)
from pipeline.virtual_lab.machine.platform import Pair, move_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, Setting

LoadPattern = Callable[[Array, np.random.Generator], Array]
"""Gives the load of a person at times (N,) [s], (N, 6) [N, N·m]."""
MASS_KG: Final = 75.0
"""Of the person; the mean of the thesis' subjects, rounded."""
RIGHT_BELT_M: Final = -0.25
"""Middle of the right belt, sideways."""
BOARDS_M: Final = 0.6
"""How far the boards beside the belts are from the middle; assumed."""

WALKING_STEPS_PER_S: Final = 1.85
WALKING_CONTACT_STEPS: Final = 1.25
RUNNING_STEPS_PER_S: Final = 2.7
RUNNING_CONTACT_STEPS: Final = 0.75
"""Cadence, and contact time per step time, of walking at 1.3 m/s and running at 2.5 m/s: with
double support and with flight; typical values."""
STEP_TIME_SD_S: Final = 0.01
PEAK_SD: Final = 0.05
"""Standard deviations of the start of a step and, as a share, of its force; assumed."""
BRAKING_SHARE: Final = 0.18
LATERAL_SHARE: Final = 0.05
"""Largest fore-aft force by the vertical force's amplitude, and lateral by vertical force;
typical of walking."""
FOOTHOLD_AHEAD_M: Final = 0.3
STANCE_TRAVEL_M: Final = 0.6
STEP_WIDTH_M: Final = 0.16
"""Where the centre of pressure starts ahead of the middle of the plate, how far it travels back
during a contact, and how far left and right feet are apart; assumed."""
MARGIN_S: Final = 1.0
"""There are no steps in the first and the last second of a recording."""

BOARD_BAND_HZ: Final = (0.3, 6.0)
"""Band of the forces of a person who moves about; assumed."""
BOARD_FORCE_SHARE: Final = (0.1, 0.1, 0.3)
"""Standard deviation of the forces (forward, left, up) by body weight; assumed."""
BOARD_CHANGE_S: Final = 15.0
"""Period of walking from one side's board to the other's and back; assumed."""
BOARD_REACH_M: Final = 0.5
BOARD_ASIDE_SD_M: Final = 0.02
"""How far along a board the person goes from its middle (three standard deviations), and standard
deviation of the place across it; assumed."""


def walking(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who walks on the right belt, (N, 6) [N, N·m].

    Action on the platform in neutral, about the lab origin.
    """
    return _steps(time, rng, WALKING_STEPS_PER_S, WALKING_CONTACT_STEPS)


def running(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who runs on the right belt, as `walking`."""
    return _steps(time, rng, RUNNING_STEPS_PER_S, RUNNING_CONTACT_STEPS)


def stepping_on_boards(time: Array, rng: np.random.Generator) -> Array:
    """Give the load of a person who moves about on the boards beside the belts, as `walking`."""
    rate_hz = 1 / (time[1] - time[0])
    band = butter(2, BOARD_BAND_HZ, "band", fs=rate_hz, output="sos")
    drawn = sosfiltfilt(band, rng.normal(size=(len(time), 5)), axis=0)
    drawn /= drawn.std(axis=0)
    weight = MASS_KG * GRAVITY_MPS2
    force = drawn[:, :3] * weight * BOARD_FORCE_SHARE - [0, 0, weight]
    side = BOARDS_M * np.tanh(3 * np.sin(2 * np.pi * time / BOARD_CHANGE_S))
    along, aside = BOARD_REACH_M * drawn[:, 3] / 3, BOARD_ASIDE_SD_M * drawn[:, 4]
    point = np.column_stack([along, side + aside, 0 * time])
    return np.hstack([force, np.cross(point, force)])


def _steps(
    time: Array, rng: np.random.Generator, steps_per_s: float, contact_steps: float
) -> Array:
    """Give half sines of vertical force that carry the weight on average, (N, 6).

    ``contact_steps`` is contact time by step time.
    """
    weight = MASS_KG * GRAVITY_MPS2
    wrench = np.zeros((len(time), 6))
    starts = np.arange(MARGIN_S, time[-1] - MARGIN_S, 1 / steps_per_s)
    for n, start in enumerate(starts + rng.normal(0, STEP_TIME_SD_S, len(starts))):
        contact_s, side = contact_steps / steps_per_s, (-1) ** n
        rows = slice(*np.searchsorted(time, [start, start + contact_s]))
        phase = (time[rows] - start) / contact_s
        amplitude = weight * np.pi / 2 / contact_steps * (1 + PEAK_SD * rng.normal())
        vertical = amplitude * np.sin(np.pi * phase)
        forward = -BRAKING_SHARE * vertical * np.cos(np.pi * phase)
        lateral = LATERAL_SHARE * side * vertical
        force = -np.column_stack([forward, lateral, vertical])
        place = [
            FOOTHOLD_AHEAD_M - STANCE_TRAVEL_M * phase,
            RIGHT_BELT_M + STEP_WIDTH_M / 2 * side + 0 * phase,
            0 * phase,
        ]
        point = np.column_stack(place)
        wrench[rows] += np.hstack([force, np.cross(point, force)])
    return wrench


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
    rng = np.random.default_rng((seed, TRIAL_STREAM))
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
