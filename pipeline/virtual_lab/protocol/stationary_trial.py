"""One trial on a stationary treadmill: T-pose, then walking, written as a C3D file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.coordinates import N_Q
from hbm.markers import Markers
from hbm.spatial import Array, shift_wrench
from pipeline.io.c3d.write import write_c3d
from pipeline.virtual_lab.faults import CameraFaults
from pipeline.virtual_lab.machine.instruments import (
    ANALOG_HZ,
    FRAME_HZ,
    PLATE_CENTERS_M,
    ForcePlate,
    measure_markers,
    recorded_plate,
)
from pipeline.virtual_lab.machine.platform import BeltRamp, stationary_platform
from pipeline.virtual_lab.person.body import marker_positions
from pipeline.virtual_lab.person.gait import schedule
from pipeline.virtual_lab.person.subject import Person, VirtualSubject, make_subject
from pipeline.virtual_lab.person.walk import foot_wrenches, plate_wrenches, simulate_walk
from pipeline.virtual_lab.protocol.walking_trial import stated
from pipeline.virtual_lab.trajectories import Trajectory

STANDING_S: Final = 2.5
"""Standing before the belts start: the T-pose, then lowering the arms."""
STARTING_S: Final = 3.5
"""Time that the belts take to their speed."""
MOMENT_NOISE_M: Final = 0.3
"""Noise of a plate's moments per noise of its forces [N·m per N]: about the distance of the load
cells from its centre."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What really happened in a trial.

    Attributes
    ----------
    subject
        Who walk.
    motion
        All coordinates as functions of time, 55 columns [rad, m].
    time
        Frame times, (T,) [s].
    q
        Coordinates at the frames, (T, 46) [rad, m].
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
    Truth
        What really happened.
    """
    rng = np.random.default_rng(seed)
    subject = make_subject(person or Person())
    steps = schedule(subject.step_parameters, speed_mps, STANDING_S, duration_s, rng)
    belt = BeltRamp(speed_mps, STANDING_S, STARTING_S)
    walk = simulate_walk(subject, steps, belt, stationary_platform(), duration_s, rng)

    frames = np.arange(round(duration_s * FRAME_HZ)) / FRAME_HZ
    q = walk.motion.at(frames)
    cameras = CameraFaults(noise_m=marker_noise_m, gaps_per_minute=0.0)
    markers = measure_markers(marker_positions(subject.skeleton, q.T), cameras, rng, FRAME_HZ)
    time = np.arange(round(duration_s * ANALOG_HZ)) / ANALOG_HZ
    plate = ForcePlate(noise=plate_noise_n * np.repeat([1.0, MOMENT_NOISE_M], 3))
    wrenches = plate_wrenches(walk, foot_wrenches(walk, time), time)
    plates = [
        recorded_plate(number, time, shift_wrench(plate.measure(wrench, ANALOG_HZ, rng), center))
        for number, (wrench, center) in enumerate(zip(wrenches, PLATE_CENTERS_M, strict=True), 1)
    ]
    write_c3d(
        path,
        Markers(frames, subject.skeleton.markers, markers),
        plates,
        metadata=stated(subject),
    )
    feet = foot_wrenches(walk, frames)
    return Truth(subject, walk.motion, frames, q[:, :N_Q], feet["left"], feet["right"])
