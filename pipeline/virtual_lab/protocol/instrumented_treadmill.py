"""What the instrumented treadmill and the cameras record of a trial, with a person or empty."""

from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array
from pipeline.io.recording import Analog, Metadata, Recording
from pipeline.virtual_lab.faults import CameraFaults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
    undergo,
)
from pipeline.virtual_lab.machine.instruments.cameras import measure_markers
from pipeline.virtual_lab.machine.instruments.sampling import FRAME_HZ
from pipeline.virtual_lab.machine.readings import (
    BELT_CHANNELS,
    PITCH_CHANNEL,
    PLATFORM_MARKERS_M,
    PULSE_CHANNEL,
    SWAY_CHANNEL,
    measure_accelerations,
    measure_belts,
    measure_plates,
    measure_platform,
    measure_pose,
    measure_pulses,
)
from pipeline.virtual_lab.machine.treadmill import TreadmillMotion
from pipeline.virtual_lab.machine.vibration import Pair, Response
from pipeline.virtual_lab.person.body.kinematics import marker_positions, segment_poses
from pipeline.virtual_lab.person.ground_reaction import foot_wrenches, plate_wrenches
from pipeline.virtual_lab.person.soft_tissue import displace_markers
from pipeline.virtual_lab.person.walk import Walk

__all__ = [
    "BELT_CHANNELS",
    "PITCH_CHANNEL",
    "PLATFORM_MARKERS_M",
    "PULSE_CHANNEL",
    "SWAY_CHANNEL",
    "InstrumentedTreadmill",
    "make_treadmill",
    "person_loads",
    "record",
    "undergo",
]

CHUNK_SAMPLES: Final = 60_000
"""Samples of a minute are computed at a time, to bound memory in long trials."""


def person_loads(walk: Walk, time: Array) -> Pair:
    """Give the ground reaction of the left and the right plate on a person, (N, 6) each."""
    loads = np.empty((2, len(time), 6))
    for start in range(0, len(time), CHUNK_SAMPLES):
        now = time[start : start + CHUNK_SAMPLES]
        loads[:, start : start + CHUNK_SAMPLES] = plate_wrenches(
            walk, foot_wrenches(walk, now), now
        )
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
    markers = measure_platform(treadmill, motion, response, of_rim)
    if walk is not None:
        markers = _with_person(markers, walk, treadmill.faults.cameras, of_person)
    channels = [
        measure_accelerations(treadmill, motion, response, of_sensors),
        measure_belts(treadmill, motion, response, BELT_CHANNELS, of_belts),
        measure_pose(treadmill, motion, of_platform),
        measure_pulses(motion, of_pulse),
    ]
    names, units, columns = zip(*channels, strict=True)
    return Recording(
        source=Path(name),
        markers=markers,
        plates=measure_plates(treadmill, motion, response, of_plates),
        analog=Analog(motion.time, sum(names, ()), sum(units, ()), np.hstack(columns)),
        metadata=_metadata(walk) if walk else Metadata(),
    )


def _with_person(
    platform: Markers, walk: Walk, cameras: CameraFaults, rng: np.random.Generator
) -> Markers:
    """Add the markers on a person before those on the platform."""
    frames, body = platform.time, walk.subject.skeleton
    of_skin, of_cameras = rng.spawn(2)
    q = walk.motion.at(frames).T
    segments = list(dict.fromkeys(body.marker_segment))
    poses = segment_poses(body, q, segments)
    orientation = {s: R for s, (R, _) in zip(segments, poses, strict=True)}
    walking = np.minimum(walk.placement.extent(frames), 1.0)
    bones = marker_positions(body, q)
    on_skin = displace_markers(
        bones, body.marker_segment, orientation, q, walking, cameras, of_skin, FRAME_HZ
    )
    person = measure_markers(on_skin, cameras, of_cameras, FRAME_HZ)
    return Markers(
        frames,
        (*body.markers, *platform.names),
        np.concatenate([person, platform.position], axis=1),
    )


def _metadata(walk: Walk) -> Metadata:
    person = walk.subject.person
    return Metadata(
        subject=person.name,
        mass_kg=person.mass_kg,
        height_m=person.height_m,
        marker_set=walk.subject.marker_set,
    )
