"""Short trials of the virtual laboratory, recorded by as many instruments as one wants."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from compensation.signals.protocol import platform_signal
from pipeline.config.schema import Platform, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.machine.actuators import move_platform
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from pipeline.virtual_lab.machine.instruments.sampling import ANALOG_HZ
from pipeline.virtual_lab.machine.platform import platform_trajectory
from pipeline.virtual_lab.machine.readings import (
    PITCH_CHANNEL,
    PLATFORM_MARKERS_M,
    SWAY_CHANNEL,
)
from pipeline.virtual_lab.machine.treadmill import BeltRamp, TreadmillMotion
from pipeline.virtual_lab.machine.vibration import Response
from pipeline.virtual_lab.person.steps import schedule
from pipeline.virtual_lab.person.subject import make_subject
from pipeline.virtual_lab.person.walk import Walk, simulate_walk
from pipeline.virtual_lab.protocol.instrumented_treadmill import person_loads, record, undergo
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, sway_command
from pipeline.virtual_lab.protocol.walking_trial import run_signal

SPEED_MPS: Final = 1.3
STANDING_S: Final = 2.5
STARTING_S: Final = 3.0
STEADY_S: Final = STANDING_S + STARTING_S + 0.5
"""From here on gait cycles count."""
DURATION_S: Final = 18.5
SWAYS_S: Final = (6.0, 9.0)
"""Times between which the platform starts to sway; it is back in neutral 10 s later."""
PITCH_RAD: Final = 0.1
PITCH_PERIOD_S: Final = 8.0
CALIBRATION_S: Final = 60
CALIBRATION_MPS: Final = 3.0


@dataclass(frozen=True, slots=True)
class Walked:
    """A person's walk on a treadmill, and what its instruments underwent.

    Attributes
    ----------
    seed
        Of all that is random.
    walk, motion, response
        How the person and the treadmill moved, and what the instruments undergo.
    """

    seed: int
    walk: Walk
    motion: TreadmillMotion
    response: Response


def walk_on(
    treadmill: InstrumentedTreadmill,
    body: BodyFaults,
    seed: int,
    *,
    moving: bool = False,
    individuality: float = 1.0,
) -> Walked:
    """Simulate a person who stands and then walks for 13 s."""
    of_body, of_walk, of_platform, of_machine = np.random.default_rng(seed).spawn(4)
    person = PERSONS[int(of_platform.integers(len(PERSONS)))]
    subject = make_subject(person, individuality=individuality, faults=body, rng=of_body)
    steps = schedule(subject.step_parameters, SPEED_MPS, STANDING_S, DURATION_S, of_walk)
    time = np.arange(round(DURATION_S * ANALOG_HZ)) / ANALOG_HZ
    sway = pitch = np.zeros(len(time))
    if moving:
        onset, side = of_platform.uniform(*SWAYS_S), of_platform.choice([-1.0, 1.0])
        sway = sway_command(np.array([onset]), np.array([side]), time)
        waves = np.sin(2 * np.pi * (time - STEADY_S) / PITCH_PERIOD_S)
        pitch = side * PITCH_RAD * waves * (time > STEADY_S)
    platform = move_platform(treadmill.machine, sway, pitch, ANALOG_HZ)
    belt = BeltRamp(SPEED_MPS, STANDING_S, STARTING_S)
    motion = TreadmillMotion(time, platform, belt.speed(time), np.empty(0))
    trajectory = platform_trajectory(platform, ANALOG_HZ)
    walk = simulate_walk(subject, steps, belt, trajectory, DURATION_S, of_walk)
    response = undergo(treadmill, motion, of_machine, person_loads(walk, time))
    return Walked(seed, walk, motion, response)


def recorded(walked: Walked, treadmill: InstrumentedTreadmill) -> Recording:
    """Record a walk; equal walks have equal noise in all instruments."""
    noise = np.random.default_rng((walked.seed, 1))
    name = f"walk_{walked.seed}.c3d"
    return record(treadmill, walked.motion, walked.walk, name, noise, walked.response)
