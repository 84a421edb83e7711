"""The treadmill of the walking study with its instruments, and what they record of a trial."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array, shift_wrench
from pipeline.io.recording import Analog, Metadata, Plate, Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.virtual_lab.faults import CameraFaults, Faults, PlatformFaults
from pipeline.virtual_lab.machine.artefacts import treadmill_wrenches
from pipeline.virtual_lab.machine.instruments.accelerometer import (
    Accelerometer,
    make_accelerometers,
)
from pipeline.virtual_lab.machine.instruments.belt_speed import BeltSpeedSensor
from pipeline.virtual_lab.machine.instruments.cameras import measure_markers
from pipeline.virtual_lab.machine.instruments.force_plate import (
    PLATE_CENTERS_M,
    ForcePlate,
    make_force_plate,
    misplaced,
    recorded_plate,
)
from pipeline.virtual_lab.machine.instruments.sampling import (
    ANALOG_HZ,
    FRAME_HZ,
    SAMPLES_PER_FRAME,
    delayed,
)
from pipeline.virtual_lab.machine.platform import specific_force
from pipeline.virtual_lab.machine.treadmill import Machine, TreadmillMotion
from pipeline.virtual_lab.person.body.kinematics import marker_positions, segment_poses
from pipeline.virtual_lab.person.ground_reaction import foot_wrenches, plate_wrenches
from pipeline.virtual_lab.person.soft_tissue import displace_markers
from pipeline.virtual_lab.person.walk import Walk

PLATFORM_MARKERS_M: Final = {
    "ROT_REF": (1.10, 0.72, 0.06),
    "ROT_C1": (1.10, -0.72, 0.02),
    "ROT_C2": (-1.10, -0.72, 0.08),
    "ROT_C3": (-1.10, 0.72, 0.02),
    "ROT_C4": (0.35, 0.76, 0.05),
}
"""Markers on the platform's rim, in its frame; assumed, not all in one plane and not symmetric."""
BELT_NOISE_MPS: Final = 0.005
"""Standard deviation of noise on the belt-speed channels; assumed."""
BELT_CHANNELS: Final = ("Belt.Left", "Belt.Right")
SWAY_CHANNEL: Final = "Platform.Sway"
PITCH_CHANNEL: Final = "Platform.Pitch"
PULSE_CHANNEL: Final = "Perturbation"
PULSE_V: Final = 5.0
"""Height of the pulse that marks the onset of a perturbation: a logic level."""
PULSE_S: Final = 0.02
PULSE_NOISE_V: Final = 0.01
"""Duration of the pulse, and noise on its channel; assumed."""
INSTRUMENT_STREAM: Final = 7
"""Number of the random numbers of the instruments, which are not those of a subject."""
CHUNK_SAMPLES: Final = 60_000
"""Samples of a minute are computed at a time, to bound memory in long trials."""


@dataclass(frozen=True, slots=True)
class InstrumentedTreadmill:
    """A treadmill and its instruments with their errors.

    Attributes
    ----------
    machine
        Mechanical properties of the treadmill.
    faults
        Sizes of all errors.
    plates
        Left and right plate; their errors are about the platform's origin.
    sensors
        Accelerometers.
    """

    machine: Machine
    faults: Faults
    plates: tuple[ForcePlate, ForcePlate]
    sensors: tuple[Accelerometer, ...]


def make_treadmill(
    faults: Faults, seed: int, machine: Machine | None = None
) -> InstrumentedTreadmill:
    """Draw the instruments of a laboratory.

    Parameters
    ----------
    faults
        Sizes of their errors.
    seed
        Seed of the errors.
    machine
        The treadmill; by default `Machine` with its default properties.

    Returns
    -------
    InstrumentedTreadmill
        Equal seeds give equal instruments.
    """
    rng = np.random.default_rng((seed, INSTRUMENT_STREAM))
    plates = make_force_plate(faults.plates, rng), make_force_plate(faults.plates, rng)
    sensors = make_accelerometers(faults.accelerometers, rng)
    return InstrumentedTreadmill(machine or Machine(), faults, plates, sensors)


def record(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    walk: Walk | None,
    name: str,
    rng: np.random.Generator,
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
        Source of all noise.

    Returns
    -------
    Recording
        Markers of person and platform at 100 Hz; plates, accelerometers, belt speeds, platform
        channels and pulses at 1000 Hz. No gait events: finding them is part of the processing.
    """
    frames = motion.time[::SAMPLES_PER_FRAME]
    plates = _plates(treadmill, motion, walk, rng)
    return Recording(
        source=Path(name),
        markers=_markers(treadmill, motion, walk, frames, rng),
        plates=plates,
        analog=_analog(treadmill, motion, rng),
        metadata=_metadata(walk) if walk else Metadata(),
    )


def _plates(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    walk: Walk | None,
    rng: np.random.Generator,
) -> tuple[Plate, ...]:
    faults, time = treadmill.faults.plates, motion.time
    own = treadmill_wrenches(treadmill.machine, motion)
    wrenches = [delayed(w, late, time) for w, late in zip(own, faults.delays_s, strict=True)]
    if walk is not None:
        for start in range(0, len(time), CHUNK_SAMPLES):
            part = slice(start, start + CHUNK_SAMPLES)
            for delay_s in set(faults.delays_s):
                sampled = np.maximum(time[part] - delay_s, 0.0)
                loads = plate_wrenches(walk, foot_wrenches(walk, sampled), sampled)
                for wrench, load, late in zip(wrenches, loads, faults.delays_s, strict=True):
                    if late == delay_s:
                        wrench[part] += load
    measured = [
        plate.measure(misplaced(wrench, faults), time, rng)
        for plate, wrench in zip(treadmill.plates, wrenches, strict=True)
    ]
    return tuple(
        recorded_plate(number, time, shift_wrench(wrench, center))
        for number, (wrench, center) in enumerate(
            zip(measured, PLATE_CENTERS_M, strict=True), start=1
        )
    )


def _markers(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    walk: Walk | None,
    frames: Array,
    rng: np.random.Generator,
) -> Markers:
    pose = motion.platform.pose
    rotation, position = pose.rotation[::SAMPLES_PER_FRAME], pose.position[::SAMPLES_PER_FRAME]
    rim = [position + rotation @ np.array(place) for place in PLATFORM_MARKERS_M.values()]
    rim_faults = CameraFaults(noise_m=treadmill.faults.platform.marker_noise_m, gaps_per_minute=0.0)
    platform = measure_markers(np.stack(rim, axis=1), rim_faults, rng, FRAME_HZ)
    if walk is None:
        return Markers(frames, tuple(PLATFORM_MARKERS_M), platform)
    body, cameras = walk.subject.skeleton, treadmill.faults.cameras
    q = walk.motion.at(frames).T
    segments = list(dict.fromkeys(body.marker_segment))
    poses = segment_poses(body, q, segments)
    orientation = {s: R for s, (R, _) in zip(segments, poses, strict=True)}
    walking = np.minimum(walk.placement.extent(frames), 1.0)
    bones = marker_positions(body, q)
    on_skin = displace_markers(
        bones, body.marker_segment, orientation, q, walking, cameras, rng, FRAME_HZ
    )
    person = measure_markers(on_skin, cameras, rng, FRAME_HZ)
    return Markers(
        frames, (*body.markers, *PLATFORM_MARKERS_M), np.concatenate([person, platform], axis=1)
    )


def _pose_delay(faults: PlatformFaults, rng: np.random.Generator) -> float:
    """Draw how late the platform's channels are in one recording [s]."""
    if faults.replay_frames == 0:
        return faults.delay_s
    frames = rng.integers(-faults.replay_frames, faults.replay_frames, endpoint=True)
    return faults.delay_s + float(frames) / FRAME_HZ


def _analog(
    treadmill: InstrumentedTreadmill, motion: TreadmillMotion, rng: np.random.Generator
) -> Analog:
    faults, time = treadmill.faults, motion.time
    names, units, columns = [], [], []
    for sensor in treadmill.sensors:
        reading = sensor.measure(specific_force(motion.platform, sensor.place), rng)
        in_g = reading / acceleration_in_mps2("g")
        columns.append(delayed(in_g, faults.accelerometers.delay_s, time))
        names += [f"{sensor.name}.{axis}" for axis in "XYZ"]
        units += ["g"] * 3
    belt = BeltSpeedSensor(BELT_NOISE_MPS)
    for channel in BELT_CHANNELS:
        columns.append(belt.measure(motion.belt, ANALOG_HZ, rng)[:, None])
        names.append(channel)
        units.append("m/s")
    sway_mm, pitch_deg = 1000 * motion.platform.sway[0], np.degrees(motion.platform.pitch[0])
    columns.append(
        delayed(np.column_stack([sway_mm, pitch_deg]), _pose_delay(faults.platform, rng), time)
    )
    pulse = PULSE_NOISE_V * rng.normal(size=len(time))
    for onset in motion.onsets:
        pulse[(time >= onset) & (time < onset + PULSE_S)] += PULSE_V
    columns.append(pulse[:, None])
    names += [SWAY_CHANNEL, PITCH_CHANNEL, PULSE_CHANNEL]
    units += ["mm", "deg", "V"]
    return Analog(time, tuple(names), tuple(units), np.hstack(columns))


def _metadata(walk: Walk) -> Metadata:
    person = walk.subject.person
    return Metadata(
        subject=person.name,
        mass_kg=person.mass_kg,
        height_m=person.height_m,
        marker_set=walk.subject.marker_set,
    )
