"""One trial of one person: T-pose, then walking, written as a C3D file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.coordinates import SEGMENTS
from hbm.markers import Markers
from hbm.native import kernels
from hbm.spatial import Array, transform_wrench
from pipeline.c3d_writer import write_c3d
from pipeline.recording import Plate
from pipeline.virtual_lab.gait import posture
from pipeline.virtual_lab.spline import Trajectory, fit_trajectory
from pipeline.virtual_lab.walker import Person, Walker, make_walker

FRAME_HZ: Final = 100.0
ANALOG_HZ: Final = 1000.0
STANDING_S: Final = 2.0
STARTING_S: Final = 4.0
STRIDE_S: Final = 1.08
PLATE_M: Final = (1.8, 0.5)


@dataclass(frozen=True, slots=True)
class Truth:
    """What really happened in a trial.

    Attributes
    ----------
    walker
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

    walker: Walker
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
        Who walks; by default a man of 74.6 kg and 1.78 m.
    duration_s
        Length of the trial [s].
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
    walker = make_walker(person or Person())
    time = np.arange(round(duration_s * FRAME_HZ)) / FRAME_HZ
    motion = _walk(walker, time)
    position = _marker_positions(walker, motion.at(time))
    position += rng.normal(0, marker_noise_m, position.shape)

    analog_time = np.arange(round(duration_s * ANALOG_HZ)) / ANALOG_HZ
    wrench = _ground_wrench(walker, motion, analog_time)
    share = _left_share(analog_time)[:, None]
    plates = []
    for number, (side, part) in enumerate(((1, share), (-1, 1 - share)), start=1):
        noise = rng.normal(0, plate_noise_n, wrench.shape) * [1, 1, 1, 0.3, 0.3, 0.3]
        plates.append(_plate(number, side, analog_time, part * wrench + noise))
    write_c3d(
        path,
        Markers(time, walker.body.markers, position),
        plates,
        metadata={
            "subject": walker.person.name,
            "mass_kg": walker.person.mass_kg,
            "height_m": walker.person.height_m,
            "marker_set": walker.body.marker_set.name,
        },
    )
    wrench = _ground_wrench(walker, motion, time)
    share = _left_share(time)[:, None]
    return Truth(walker, motion, time, motion.at(time), share * wrench, (1 - share) * wrench)


def _ramp(x: Array) -> Array:
    x = np.clip(x, 0, 1)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


def _phase(time: Array) -> Array:
    return (time - STANDING_S) / STRIDE_S


def _walk(walker: Walker, time: Array) -> Trajectory:
    arms = _ramp((time - STANDING_S / 2) / STANDING_S)[:, None]
    extent = _ramp((time - STANDING_S) / STARTING_S)
    still = walker.t_pose + arms * (walker.standing - walker.t_pose)
    phase = _phase(time)
    q = still + posture(phase, extent, walker.standing) - walker.standing
    q[:, 1] += 0.03 * extent * np.sin(2 * np.pi * (phase - 0.02))
    q[:, 2] -= 0.02 * extent * (1 + np.cos(4 * np.pi * (phase - 0.04)))
    return fit_trajectory(q, FRAME_HZ)


def _ground_wrench(walker: Walker, motion: Trajectory, time: Array) -> Array:
    """Wrench that the ground must exert so that the equations of motion hold, (T, 6)."""
    body = walker.body
    state = (motion.at(time, k) for k in range(3))
    _, wrench, _ = kernels().newton_euler(*state, body.geometry, body.inertia_vector)
    return wrench


def _left_share(time: Array) -> Array:
    """Share of the left foot: all in single support, smoothly exchanged in double support."""
    cycle = _phase(time) % 1
    share = _ramp((cycle - 0.5) / 0.12) + 1 - _ramp(cycle / 0.12)
    walking = _ramp(_phase(time))
    return np.asarray(0.5 + walking * (share - 0.5))


def _marker_positions(walker: Walker, q: Array) -> Array:
    body = walker.body
    poses = kernels().segment_poses(q, body.geometry)[0].reshape(len(q), len(SEGMENTS), 4, 3)
    own = [SEGMENTS.index(s) for s in body.marker_segment]
    local = np.column_stack([body.marker_position, np.ones(len(own))])
    return np.asarray(np.einsum("tkai,ka->tki", poses[:, own], local))


def _plate(number: int, side: int, time: Array, wrench: Array) -> Plate:
    """A belt beside the middle, with the wrench given about the lab origin."""
    length, width = PLATE_M
    center = np.array([0.0, side * width / 2, 0.0])
    x, y = length / 2, width / 2
    corners = center + np.array([[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]])
    in_plate = transform_wrench(wrench, np.eye(3), -center)
    return Plate(number, time, in_plate, np.eye(3), center, corners)
