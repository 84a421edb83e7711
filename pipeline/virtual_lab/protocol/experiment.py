"""One trial of the protocol: a person, the treadmill's course, and the recording of both."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.protocol import pitch_and_sway_signals
from compensation.signals import Signal, resample_signal
from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.course import ANALOG_HZ, Belt, Course, ride_of
from pipeline.virtual_lab.machine.machine import Machine, drive_belt, move_platform
from pipeline.virtual_lab.person.steps import schedule
from pipeline.virtual_lab.person.walk import Walk, walk
from pipeline.virtual_lab.person.walker import Walker, make_walker
from pipeline.virtual_lab.protocol.bench import Bench, record
from pipeline.virtual_lab.protocol.protocol import (
    PERSONS,
    Condition,
    Setting,
    perturbations,
    pitch_command,
    sway_command,
)

CONDITIONS: Final[tuple[Condition, ...]] = ("familiarisation", "baseline", "sway", "pitch")


@dataclass(frozen=True, slots=True)
class Trial:
    """A trial: what happened, and what was recorded of it.

    Attributes
    ----------
    walk
        What the person did.
    course
        What the treadmill did.
    recording
        What the instruments made of it.
    """

    walk: Walk
    course: Course
    recording: Recording


def walker_of(setting: Setting, subject: int) -> Walker:
    """Give a subject of the study, numbered from 0."""
    protocol = setting.protocol
    return make_walker(
        PERSONS[subject],
        marker_set=protocol.marker_set,
        individuality=protocol.individuality,
        variability=protocol.variability,
        faults=setting.faults.body,
        rng=np.random.default_rng((setting.seed, subject)),
    )


def run_trial(
    setting: Setting, bench: Bench, walker: Walker, subject: int, condition: Condition
) -> Trial:
    """Let a person do one trial, and record it.

    Parameters
    ----------
    setting
        Protocol, faults and seed.
    bench
        The instruments, from `make_bench` with the setting's faults.
    walker, subject
        Who, and the number that chance depends on.
    condition
        What.

    Returns
    -------
    Trial
        The same for the same seed.
    """
    walked, course = run_walk(setting, bench.machine, walker, subject, condition)
    name = f"{walker.person.name}_{condition}.c3d"
    noise = np.random.default_rng((setting.seed, subject, CONDITIONS.index(condition), 1))
    return Trial(walked, course, record(bench, course, walked, name, noise))


def run_walk(
    setting: Setting, machine: Machine, walker: Walker, subject: int, condition: Condition
) -> tuple[Walk, Course]:
    """Let a person do one trial with nobody recording; arguments as for `run_trial`."""
    protocol, duration = setting.protocol, setting.protocol.duration(condition)
    rng = np.random.default_rng((setting.seed, subject, CONDITIONS.index(condition)))
    steps = schedule(walker.habits, protocol.speed_mps, protocol.standing_s, duration, rng)
    onsets, sides = np.empty(0), np.empty(0)
    if condition == "sway":
        onsets, sides = perturbations(protocol, steps, setting.seed)

    time = np.arange(round(duration * ANALOG_HZ)) / ANALOG_HZ
    pitch = pitch_command(protocol, time) if condition == "pitch" else np.zeros(len(time))
    platform = move_platform(machine, sway_command(onsets, sides, time), pitch, ANALOG_HZ)
    belt = Belt(protocol.speed_mps, protocol.standing_s, protocol.starting_s)
    course = Course(time, platform, belt.speed(time), onsets)
    ride = ride_of(platform, ANALOG_HZ)
    return walk(walker, steps, belt, ride, duration, rng), course


def run_signal(bench: Bench, signal: Signal, rng: np.random.Generator) -> Recording:
    """Record the empty treadmill while it follows a signal, after a second at rest in neutral."""
    fine = resample_signal(signal, ANALOG_HZ)
    count, still = len(fine.sway) // 10 * 10, round(ANALOG_HZ)
    sway, pitch, belt = (
        np.pad(x[:count], (still, 0), constant_values=first)
        for x, first in ((fine.sway, 0.0), (fine.pitch, 0.0), (fine.belt_speed, fine.belt_speed[0]))
    )
    platform = move_platform(bench.machine, sway, pitch, ANALOG_HZ)
    speed = drive_belt(bench.machine, belt, ANALOG_HZ)
    course = Course(np.arange(len(sway)) / ANALOG_HZ, platform, speed, np.empty(0))
    return record(bench, course, None, f"{signal.name}.c3d", rng)


def run_calibration(setting: Setting, bench: Bench) -> Recording:
    """Record the empty treadmill while it follows the protocol's calibration signal."""
    name = setting.protocol.calibration
    belt_mps = float(name.removesuffix("mps").rpartition("_")[2])
    signals = pitch_and_sway_signals(setting.seed, belt_mps)
    chosen = next(signal for signal in signals if signal.name == name)
    return run_signal(bench, chosen, np.random.default_rng((setting.seed, len(PERSONS))))
