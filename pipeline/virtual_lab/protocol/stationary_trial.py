"""One trial on a treadmill that stands still: T-pose, then walking, written as a C3D file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.poses import marker_positions
from hbm.spatial import Array
from pipeline.io.c3d.write import write_c3d
from pipeline.virtual_lab.machine.motion import BeltRamp, stationary_platform
from pipeline.virtual_lab.person.ground_reaction import foot_wrenches
from pipeline.virtual_lab.person.steps import schedule
from pipeline.virtual_lab.person.subject import Person, VirtualSubject, make_subject
from pipeline.virtual_lab.person.walk import walk
from pipeline.virtual_lab.protocol.plate_loads import plate, plate_wrenches
from pipeline.virtual_lab.trajectories import Trajectory

FRAME_HZ: Final = 100.0
ANALOG_HZ: Final = 1000.0
START_S: Final = 2.5
RAMP_S: Final = 3.5
MOMENT_NOISE_M: Final = 0.3


@dataclass(frozen=True, slots=True)
class Truth:
    """What really happened in a trial.

    Attributes
    ----------
    subject
        Who walked.
    motion
        The coordinates as a function of time, 46 columns [rad, m].
    time
        Frame times, (T,) [s].
    q
        Coordinates at the frames, (T, 46).
    left, right
        Wrenches on the feet at the frames, (T, 6) [N, N·m], lab axes about the lab origin.
    """

    subject: VirtualSubject
    motion: Trajectory
    time: Array
    q: Array
    left: Array
    right: Array


def simulate_trial(
    path: str | Path,
    *,
    person: Person | None = None,
    duration_s: float = 20.0,
    speed_mps: float = 1.3,
    seed: int = 0,
    marker_noise_m: float = 0.0005,
    plate_noise_n: float = 0.5,
) -> Truth:
    """Let a person stand in a T-pose, then walk, and write what the laboratory records.

    Parameters
    ----------
    path
        C3D file to write: 46 markers at 100 Hz, two plates at 1000 Hz.
    person
        Who walks; by default a man of 74.6 kg and 1.78 m. The body is the one that `build_body`
        finds in the T-pose.
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
    Truth
        What really happened.
    """
    rng = np.random.default_rng(seed)
    subject = make_subject(person or Person())
    steps = schedule(subject.habits, speed_mps, START_S, duration_s, rng)
    belt = BeltRamp(speed_mps, START_S, RAMP_S)
    walked = walk(subject, steps, belt, stationary_platform(duration_s), duration_s, rng)

    time = np.arange(round(duration_s * FRAME_HZ)) / FRAME_HZ
    q = walked.motion.at(time)
    position = marker_positions(subject.body, q)
    position += rng.normal(0, marker_noise_m, position.shape)
    clock = np.arange(round(duration_s * ANALOG_HZ)) / ANALOG_HZ
    grain = plate_noise_n * np.array([1.0, 1.0, 1.0, *[MOMENT_NOISE_M] * 3])
    plates = [
        plate(number, clock, wrench + rng.normal(size=wrench.shape) * grain)
        for number, wrench in enumerate(
            plate_wrenches(walked, foot_wrenches(walked, clock), clock), 1
        )
    ]
    write_c3d(
        path,
        Markers(time, subject.body.markers, position),
        plates,
        metadata={
            "subject": subject.person.name,
            "mass_kg": subject.person.mass_kg,
            "height_m": subject.person.height_m,
            "marker_set": subject.body.marker_set.name,
        },
    )
    feet = foot_wrenches(walked, time)
    return Truth(subject, walked.motion, time, q, feet["left"], feet["right"])
