"""One trial of the protocol: a person, the treadmill's motion, and the recording of both."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.signals.protocol import pitch_and_sway_signals
from compensation.signals.signal import Signal, resample_signal
from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.motion import (
    ANALOG_HZ,
    BeltRamp,
    TreadmillMotion,
    platform_trajectory,
)
from pipeline.virtual_lab.machine.treadmill import Machine, drive_belt, move_platform
from pipeline.virtual_lab.person.steps import schedule
from pipeline.virtual_lab.person.subject import VirtualSubject, make_subject
from pipeline.virtual_lab.person.walk import Walk, walk
from pipeline.virtual_lab.protocol.instrumented_treadmill import InstrumentedTreadmill, record
from pipeline.virtual_lab.protocol.walking_protocol import (
    PERSONS,
    ConditionName,
    Setting,
    perturbations,
    pitch_command,
    sway_command,
)

CONDITIONS: Final[tuple[ConditionName, ...]] = ("familiarisation", "baseline", "sway", "pitch")


@dataclass(frozen=True, slots=True)
class WalkingTrial:
    """A trial: what happened, and what was recorded of it.

    Attributes
    ----------
    walk
        What the person did.
    motion
        What the treadmill did.
    recording
        What the instruments made of it.
    """

    walk: Walk
    motion: TreadmillMotion
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
        rng=np.random.default_rng((setting.seed, number)),
    )


def run_trial(
    setting: Setting,
    treadmill: InstrumentedTreadmill,
    subject: VirtualSubject,
    number: int,
    condition: ConditionName,
) -> WalkingTrial:
    """Let a person do one trial, and record it.

    Parameters
    ----------
    setting
        Protocol, faults and seed.
    treadmill
        The instruments, from `make_treadmill` with the setting's faults.
    subject, number
        Who, and the number that chance depends on.
    condition
        What.

    Returns
    -------
    WalkingTrial
        The same for the same seed.
    """
    walked, motion = run_walk(setting, treadmill.machine, subject, number, condition)
    name = f"{subject.person.name}_{condition}.c3d"
    noise = np.random.default_rng((setting.seed, number, CONDITIONS.index(condition), 1))
    return WalkingTrial(walked, motion, record(treadmill, motion, walked, name, noise))


def run_walk(
    setting: Setting,
    machine: Machine,
    subject: VirtualSubject,
    number: int,
    condition: ConditionName,
) -> tuple[Walk, TreadmillMotion]:
    """Let a person do one trial with nobody recording; arguments as for `run_trial`."""
    protocol, duration = setting.protocol, setting.protocol.duration(condition)
    rng = np.random.default_rng((setting.seed, number, CONDITIONS.index(condition)))
    steps = schedule(subject.habits, protocol.speed_mps, protocol.standing_s, duration, rng)
    onsets, sides = np.empty(0), np.empty(0)
    if condition == "sway":
        onsets, sides = perturbations(protocol, steps, setting.seed)

    time = np.arange(round(duration * ANALOG_HZ)) / ANALOG_HZ
    pitch = pitch_command(protocol, time) if condition == "pitch" else np.zeros(len(time))
    platform = move_platform(machine, sway_command(onsets, sides, time), pitch, ANALOG_HZ)
    belt = BeltRamp(protocol.speed_mps, protocol.standing_s, protocol.starting_s)
    motion = TreadmillMotion(time, platform, belt.speed(time), onsets)
    ride = platform_trajectory(platform, ANALOG_HZ)
    return walk(subject, steps, belt, ride, duration, rng), motion


def run_signal(
    treadmill: InstrumentedTreadmill, signal: Signal, rng: np.random.Generator
) -> Recording:
    """Record the empty treadmill while it follows a signal, after a second at rest in neutral."""
    fine = resample_signal(signal, ANALOG_HZ)
    count, still = len(fine.sway) // 10 * 10, round(ANALOG_HZ)
    sway, pitch, belt = (
        np.pad(x[:count], (still, 0), constant_values=first)
        for x, first in ((fine.sway, 0.0), (fine.pitch, 0.0), (fine.belt_speed, fine.belt_speed[0]))
    )
    platform = move_platform(treadmill.machine, sway, pitch, ANALOG_HZ)
    speed = drive_belt(treadmill.machine, belt, ANALOG_HZ)
    motion = TreadmillMotion(np.arange(len(sway)) / ANALOG_HZ, platform, speed, np.empty(0))
    return record(treadmill, motion, None, f"{signal.name}.c3d", rng)


def run_calibration(setting: Setting, treadmill: InstrumentedTreadmill) -> Recording:
    """Record the empty treadmill while it follows the protocol's calibration signal."""
    name = setting.protocol.calibration
    belt_mps = float(name.removesuffix("mps").rpartition("_")[2])
    signals = pitch_and_sway_signals(setting.seed, belt_mps)
    chosen = next(signal for signal in signals if signal.name == name)
    return run_signal(treadmill, chosen, np.random.default_rng((setting.seed, len(PERSONS))))
