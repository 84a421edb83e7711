"""One trial of the walking study: how the person and the treadmill move, and the recording."""

from dataclasses import dataclass

import numpy as np

from compensation.protocol import pitch_and_sway_signals
from compensation.signals import Signal, resample_signal
from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ, SAMPLES_PER_FRAME
from pipeline.virtual_lab.machine.platform import platform_trajectory
from pipeline.virtual_lab.machine.treadmill import BeltRamp, Machine, TreadmillMotion
from pipeline.virtual_lab.machine.vibration import Response
from pipeline.virtual_lab.person.steps import schedule
from pipeline.virtual_lab.person.subject import VirtualSubject, make_subject
from pipeline.virtual_lab.person.walk import Walk, simulate_walk
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    InstrumentedTreadmill,
    person_loads,
    record,
    undergo,
)
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
    protocol = setting.protocol
    return make_subject(
        PERSONS[number],
        marker_set=protocol.marker_set,
        individuality=protocol.individuality,
        variability=protocol.variability,
        faults=setting.faults.body,
        forward_m=protocol.place_forward_m,
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
    noise = np.random.default_rng((setting.seed, number, CONDITIONS.index(condition), 1))
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
    rng = np.random.default_rng((setting.seed, number, CONDITIONS.index(condition)))
    steps = schedule(
        subject.step_parameters, protocol.speed_mps, protocol.standing_s, duration, rng
    )
    onsets, directions = np.empty(0), np.empty(0)
    if condition == "sway":
        onsets, directions = perturbations(protocol, steps, setting.seed)

    time = np.arange(round(duration * ANALOG_HZ)) / ANALOG_HZ
    pitch = pitch_command(protocol, time) if condition == "pitch" else np.zeros(len(time))
    platform = move_platform(machine, sway_command(onsets, directions, time), pitch, ANALOG_HZ)
    belt = BeltRamp(protocol.speed_mps, protocol.standing_s, protocol.starting_s)
    motion = TreadmillMotion(time, platform, belt.speed(time), onsets)
    trajectory = platform_trajectory(platform, ANALOG_HZ)
    return simulate_walk(subject, steps, belt, trajectory, duration, rng), motion


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
    command = resample_signal(signal, ANALOG_HZ)
    count = len(command.sway) // SAMPLES_PER_FRAME * SAMPLES_PER_FRAME
    rest = round(ANALOG_HZ)
    sway, pitch, belt_speed = (
        np.pad(values[:count], (rest, 0), constant_values=first)
        for values, first in (
            (command.sway, 0.0),
            (command.pitch, 0.0),
            (command.belt_speed, command.belt_speed[0]),
        )
    )
    platform = move_platform(treadmill.machine, sway, pitch, ANALOG_HZ)
    time = np.arange(len(sway)) / ANALOG_HZ
    motion = TreadmillMotion(time, platform, belt_speed, np.empty(0))
    return record(treadmill, motion, None, f"{signal.name}.c3d", rng)


def run_calibration(setting: Setting, treadmill: InstrumentedTreadmill) -> Recording:
    """Record the empty treadmill while it follows the protocol's calibration signal."""
    name = setting.protocol.calibration
    belt_mps = float(name.removesuffix("mps").rpartition("_")[2])
    signals = pitch_and_sway_signals(setting.seed, belt_mps)
    chosen = next(signal for signal in signals if signal.name == name)
    return run_signal(treadmill, chosen, np.random.default_rng((setting.seed, len(PERSONS))))
