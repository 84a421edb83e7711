"""A walking trial: how person and treadmill move, and what is recorded of it.

`run_trial` is one of the walking study, `simulate_trial` one on a stationary treadmill.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from compensation.protocol import pitch_and_sway_signals
from compensation.signals import Signal, resample_signal
from hbm.markers import Markers
from hbm.spatial import Array, shift_wrench
from pipeline.io.recording import Metadata, Recording
from pipeline.virtual_lab.faults import CameraFaults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    BELT_CHANNELS,
    FRAME_HZ,
    PLATE_CENTERS_M,
    SAMPLES_PER_FRAME,
    ForcePlate,
    InstrumentedTreadmill,
    measure_markers,
    measure_platform,
    measure_pose,
    measure_pulses,
    recorded,
    recorded_plate,
    undergo,
)
from pipeline.virtual_lab.machine.platform import (
    BeltRamp,
    Machine,
    Pair,
    TreadmillMotion,
    move_treadmill,
    platform_trajectory,
    stationary_platform,
)
from pipeline.virtual_lab.machine.structure import Response
from pipeline.virtual_lab.person.body import marker_positions, segment_poses
from pipeline.virtual_lab.person.gait import schedule
from pipeline.virtual_lab.person.soft_tissue import displace_markers
from pipeline.virtual_lab.person.subject import Person, VirtualSubject, make_subject
from pipeline.virtual_lab.person.walk import Walk, plate_wrenches, simulate_walk
from pipeline.virtual_lab.protocol.walking_protocol import (
    CONDITIONS,
    PERSONS,
    ConditionName,
    Setting,
    perturbations,
    pitch_command,
    recording_name,
    sway_command,
)


def person_loads(walk: Walk, time: Array) -> Pair:
    """Give the ground reaction of the left and the right plate on a person, (N, 6) each."""
    loads, chunk = np.empty((2, len(time), 6)), 60_000  # a minute at a time, to bound memory
    for start in range(0, len(time), chunk):
        part = slice(start, start + chunk)
        loads[:, part] = plate_wrenches(walk, time[part])
    return loads[0], loads[1]


def record(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    walk: Walk | None,
    name: str,
    rng: np.random.Generator,
    response: Response | None = None,
) -> Recording:
    """Record a trial.

    Parameters
    ----------
    treadmill
        The instruments.
    motion
        How the treadmill moves.
    walk
        The person on it; None for an empty treadmill.
    name
        Name of the file.
    rng
        Source of all noise; every instrument has its own random numbers of it.
    response
        What the instruments undergo, if it is known already.

    Returns
    -------
    Recording
        Markers of person and platform at 100 Hz; plates, accelerometers, belt speeds, platform
        channels and pulses at 1000 Hz. No gait events: finding them is part of the processing.
    """
    of_motion, of_plates, of_sensors, of_belts, of_platform, of_pulse, of_rim, of_person = (
        rng.spawn(8)
    )
    if response is None:
        people = None if walk is None else person_loads(walk, motion.time)
        response = undergo(treadmill, motion, of_motion, people)
    markers, person = measure_platform(treadmill, motion, response, of_rim), None
    if walk is not None:
        body, person = walk.subject.skeleton, stated(walk.subject)
        of_body = measure_person(walk, markers.time, treadmill.faults.cameras, of_person)
        position = np.concatenate([of_body, markers.position], axis=1)
        markers = Markers(markers.time, (*body.markers, *markers.names), position)
    more = measure_pose(treadmill, motion, of_platform), measure_pulses(motion, of_pulse)
    streams = of_plates, of_sensors, of_belts
    return recorded(
        name, treadmill, motion, response, BELT_CHANNELS, streams, markers, more, person
    )


def measure_person(
    walk: Walk, frames: Array, cameras: CameraFaults, rng: np.random.Generator
) -> Array:
    """Give the markers on a person's skin as cameras see them at times (T,) [s], (T, M, 3) [m]."""
    of_skin, of_cameras = rng.spawn(2)
    body, q = walk.subject.skeleton, walk.motion.at(frames).T
    segments = list(dict.fromkeys(body.marker_segment))
    poses = segment_poses(body, q, segments)
    orientation = {s: R for s, (R, _) in zip(segments, poses, strict=True)}
    walking = np.minimum(walk.placement.extent(frames), 1.0)
    bones = marker_positions(body, q)
    on_skin = displace_markers(
        bones, body.marker_segment, orientation, q, walking, cameras, of_skin, FRAME_HZ
    )
    return measure_markers(on_skin, cameras, of_cameras, FRAME_HZ)


def stated(subject: VirtualSubject) -> Metadata:
    """Give what a file states of a person."""
    return Metadata(mass_kg=subject.person.mass_kg, height_m=subject.person.height_m)


@dataclass(frozen=True, slots=True)
class WalkingTrial:
    """A trial: what happened, and what was recorded of it.

    Attributes
    ----------
    walk
        How the person moved.
    motion
        How the treadmill moved.
    response
        What the instruments underwent.
    recording
        What they recorded of it.
    """

    walk: Walk
    motion: TreadmillMotion
    response: Response
    recording: Recording


def study_subject(setting: Setting, number: int) -> VirtualSubject:
    """Give a subject of the study, numbered from 0."""
    return make_subject(
        PERSONS[number],
        marker_set=setting.protocol.marker_set,
        individuality=1.0,
        faults=setting.faults.body,
        rng=np.random.default_rng((setting.seed, number)),
    )


def run_trial(
    setting: Setting,
    treadmill: InstrumentedTreadmill,
    subject: VirtualSubject,
    number: int,
    condition: ConditionName,
) -> WalkingTrial:
    """Simulate and record one trial of one subject.

    Parameters
    ----------
    setting
        Protocol, faults and seed.
    treadmill
        The instruments, from `make_treadmill` with the setting's faults.
    subject, number
        Who walks, and the subject's number in the study, on which everything random depends.
    condition
        Which condition.

    Returns
    -------
    WalkingTrial
        Equal seeds give equal trials.
    """
    walk, motion = run_walk(setting, treadmill.machine, subject, number, condition)
    name = recording_name(subject.person, condition)
    noise = np.random.default_rng((setting.seed, number, 1 + CONDITIONS.index(condition), 1))
    response = undergo(treadmill, motion, noise.spawn(1)[0], person_loads(walk, motion.time))
    recording = record(treadmill, motion, walk, name, noise, response)
    return WalkingTrial(walk, motion, response, recording)


def run_walk(
    setting: Setting,
    machine: Machine,
    subject: VirtualSubject,
    number: int,
    condition: ConditionName,
) -> tuple[Walk, TreadmillMotion]:
    """Simulate one trial without recording it; parameters as for `run_trial`."""
    protocol, duration = setting.protocol, setting.protocol.duration(condition)
    rng = np.random.default_rng((setting.seed, number, 1 + CONDITIONS.index(condition)))
    steps = schedule(
        subject.step_parameters, protocol.speed_mps, protocol.standing_s, duration, rng
    )
    onsets, directions = np.empty(0), np.empty(0)
    if condition == "sway":
        onsets, directions = perturbations(protocol, steps, setting.seed)

    time = np.arange(round(duration * ANALOG_HZ)) / ANALOG_HZ
    pitch = pitch_command(protocol, time) if condition == "pitch" else np.zeros(len(time))
    sway = sway_command(onsets, directions, time)
    belt = BeltRamp(protocol.speed_mps, protocol.standing_s, protocol.starting_s)
    motion = move_treadmill(machine, sway, pitch, belt.speed(time), ANALOG_HZ)
    trajectory = platform_trajectory(motion.platform, ANALOG_HZ)
    walk = simulate_walk(subject, steps, belt, trajectory, duration, rng)
    return walk, replace(motion, onsets=onsets)


def run_signal(
    treadmill: InstrumentedTreadmill, signal: Signal, rng: np.random.Generator
) -> Recording:
    """Record the empty treadmill while it follows a signal, after a second at rest in neutral.

    Parameters
    ----------
    treadmill
        The treadmill with its instruments.
    signal
        What it is commanded.
    rng
        Source of all noise.

    Returns
    -------
    Recording
        Named as the signal; its markers are those of the platform.
    """
    command, rest = resample_signal(signal, ANALOG_HZ), (round(ANALOG_HZ), 0)
    count = len(command.sway) // SAMPLES_PER_FRAME * SAMPLES_PER_FRAME
    sway, pitch = (np.pad(values[:count], rest) for values in (command.sway, command.pitch))
    belt_speed = np.pad(command.belt_speed[:count], rest, mode="edge")
    motion = move_treadmill(treadmill.machine, sway, pitch, belt_speed, ANALOG_HZ)
    return record(treadmill, motion, None, f"{signal.name}.c3d", rng)


def run_calibration(
    setting: Setting, treadmill: InstrumentedTreadmill, *, another_day: bool = False
) -> Recording:
    """Record the empty treadmill while it follows the protocol's calibration signal.

    On another day rollers begin at other angles, and noise is another.
    """
    name = setting.protocol.calibration
    belt_mps = float(name.removesuffix("mps").rpartition("_")[2])
    signals = pitch_and_sway_signals(setting.seed, belt_mps)
    chosen = next(signal for signal in signals if signal.name == name)
    of_noise = setting.seed, len(PERSONS), *((1,) if another_day else ())
    return run_signal(treadmill, chosen, np.random.default_rng(of_noise))


def simulate_trial(
    path: str | Path,
    *,
    person: Person | None = None,
    duration_s: float = 20.0,
    speed_mps: float = 1.3,
    seed: int = 0,
    marker_noise_m: float = 0.0005,
    plate_noise_n: float = 0.5,
) -> Walk:
    """Simulate a person who stands in a T-pose and then walks, and write it as C3D.

    Parameters
    ----------
    path
        C3D file to write: 46 markers at 100 Hz, two plates at 1000 Hz.
    person
        Who walks; by default a man of 74.6 kg and 1.78 m. The body is the one that the markers of
        the T-pose suggest.
    duration_s
        Length of the trial [s]; the belts run at full speed after 6 s.
    speed_mps
        Belt speed [m/s].
    seed
        Equal seeds give equal files.
    marker_noise_m, plate_noise_n
        Standard deviations of white noise on markers [m] and plate forces [N].

    Returns
    -------
    Walk
        What really happened: coordinates and ground forces as functions of time.
    """
    rng = np.random.default_rng(seed)
    subject = make_subject(person or Person())
    # the T-pose and lowering the arms, then the belts' way to their speed
    standing_s, starting_s = 2.5, 3.5
    steps = schedule(subject.step_parameters, speed_mps, standing_s, duration_s, rng)
    belt = BeltRamp(speed_mps, standing_s, starting_s)
    walk = simulate_walk(subject, steps, belt, stationary_platform(), duration_s, rng)

    frames = np.arange(round(duration_s * FRAME_HZ)) / FRAME_HZ
    cameras = CameraFaults(noise_m=marker_noise_m, gaps_per_minute=0.0)
    position = marker_positions(subject.skeleton, walk.motion.at(frames).T)
    markers = measure_markers(position, cameras, rng, FRAME_HZ)
    time = np.arange(round(duration_s * ANALOG_HZ)) / ANALOG_HZ
    # moments have the noise of forces by about the distance of load cells from the centre, 0.3 m
    plate = ForcePlate(noise=plate_noise_n * np.repeat([1.0, 0.3], 3))
    plates = []
    for k, wrench in enumerate(plate_wrenches(walk, time)):
        measured = plate.measure(wrench, ANALOG_HZ, rng)
        plates.append(recorded_plate(k + 1, time, shift_wrench(measured, PLATE_CENTERS_M[k])))
    recorded_markers = Markers(frames, subject.skeleton.markers, markers)
    write_c3d(path, recorded_markers, plates, metadata=stated(subject))
    return walk
