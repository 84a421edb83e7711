"""The laboratory's instruments: drawn once, then they record trial after trial."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.poses import marker_positions
from hbm.spatial import Array
from pipeline.io.recording import Analog, Event, Plate, Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.cameras import move_skin, see
from pipeline.virtual_lab.machine.instruments import (
    Accelerometer,
    LoadCells,
    make_accelerometers,
    make_load_cells,
)
from pipeline.virtual_lab.machine.motion import ANALOG_HZ, TreadmillMotion
from pipeline.virtual_lab.machine.treadmill import Machine, assembly_wrench, belt_moment
from pipeline.virtual_lab.person.ground_reaction import foot_wrenches
from pipeline.virtual_lab.person.walk import Walk, segment_poses
from pipeline.virtual_lab.protocol.plate_loads import plate, plate_wrenches

FRAME_HZ: Final = 100.0
PER_FRAME: Final = 10
BELT_HZ: Final = 200.0
G_MPS2: Final = 9.80665
PLATFORM_MARKERS: Final = {  # on the platform's rim, in its frame [m]
    "ROT_REF": (1.10, 0.72, 0.06),
    "ROT_C1": (1.10, -0.72, 0.02),
    "ROT_C2": (-1.10, -0.72, 0.08),
    "ROT_C3": (-1.10, 0.72, 0.02),
    "ROT_C4": (0.35, 0.76, 0.05),
}
SENSORS: Final = ("rear_left", "front_right", "front_left", "rear_right")
PULSE_CHANNEL: Final = "Perturbation"
SWAY_CHANNEL: Final = "Platform.Sway"
PITCH_CHANNEL: Final = "Platform.Pitch"
BELT_CHANNELS: Final = ("Belt.Left", "Belt.Right")
PULSE_V, PULSE_S = 5.0, 0.02
BELT_NOISE_MPS: Final = 0.005
CHANNEL_NOISE: Final = 0.01
CHUNK: Final = 60_000


@dataclass(frozen=True, slots=True)
class InstrumentedTreadmill:
    """Instruments with their errors.

    Attributes
    ----------
    machine
        What the treadmill is made of.
    faults
        Sizes of all errors.
    cells
        Left and right plate.
    sensors
        Accelerometers.
    """

    machine: Machine
    faults: Faults
    cells: tuple[LoadCells, LoadCells]
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
        Of the drawing.
    machine
        The treadmill; by default as it comes.

    Returns
    -------
    InstrumentedTreadmill
        Ready to record.
    """
    rng = np.random.default_rng((seed, 7))
    cells = make_load_cells(faults.plates, rng), make_load_cells(faults.plates, rng)
    return InstrumentedTreadmill(
        machine or Machine(), faults, cells, make_accelerometers(faults.accelerometers, rng)
    )


def treadmill_wrenches(treadmill: InstrumentedTreadmill, motion: TreadmillMotion) -> list[Array]:
    """Give what each plate's cells carry of the treadmill itself, (N, 6), in the platform frame."""
    pitching = belt_moment(treadmill.machine, np.gradient(motion.belt, 1 / ANALOG_HZ), ANALOG_HZ)
    wrenches = [assembly_wrench(motion.platform, part) for part in treadmill.machine.assemblies]
    for wrench in wrenches:
        wrench[:, 4] += pitching
    return wrenches


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
        What the treadmill does.
    walk
        The person on it; None for an empty treadmill.
    name
        Of the file.
    rng
        Source of all noise.

    Returns
    -------
    Recording
        Markers of person and platform at 100 Hz; plates, accelerometers, belt speeds, pose channels
        and pulses at 1000 Hz.
    """
    frames = motion.time[::PER_FRAME]
    plates = _plates(treadmill, motion, walk, rng)
    return Recording(
        source=Path(name),
        markers=_markers(treadmill, motion, walk, frames, rng),
        plates=plates,
        analog=_analog(treadmill, motion, rng),
        events=_events(walk, frames[-1]) if walk else (),
        metadata=_metadata(walk) if walk else {},
    )


def _plates(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    walk: Walk | None,
    rng: np.random.Generator,
) -> tuple[Plate, ...]:
    late, time = treadmill.faults.plates.delay_s, motion.time
    measured = [_delayed(wrench, late, time) for wrench in treadmill_wrenches(treadmill, motion)]
    if walk is not None:
        for start in range(0, len(time), CHUNK):
            part = slice(start, start + CHUNK)
            when = np.maximum(time[part] - late, 0.0)
            loads = plate_wrenches(walk, foot_wrenches(walk, when), when)
            for wrench, load in zip(measured, loads, strict=True):
                wrench[part] += load
    return tuple(
        plate(number, time, cells.measure(wrench, time, rng))
        for number, (cells, wrench) in enumerate(
            zip(treadmill.cells, measured, strict=True), start=1
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
    rotation, position = pose.rotation[::PER_FRAME], pose.position[::PER_FRAME]
    rim = np.stack([position + rotation @ np.array(p) for p in PLATFORM_MARKERS.values()], axis=1)
    rim += treadmill.faults.platform.marker_noise_m * rng.normal(size=rim.shape)
    if walk is None:
        return Markers(frames, tuple(PLATFORM_MARKERS), rim)
    body, cameras = walk.subject.body, treadmill.faults.cameras
    q = walk.motion.at(frames)
    true = marker_positions(body, q)
    names = list(dict.fromkeys(body.marker_segment))
    turned = {s: R for s, (R, _) in zip(names, segment_poses(walk.subject, q, names), strict=True)}
    phase = walk.placement.phase("right", np.maximum(frames, walk.placement.steps.contact[0]))
    skin = move_skin(true, body.marker_segment, turned, phase, cameras, rng, FRAME_HZ)
    seen = see(skin, cameras, rng, FRAME_HZ)
    return Markers(frames, (*body.markers, *PLATFORM_MARKERS), np.concatenate([seen, rim], axis=1))


def _analog(
    treadmill: InstrumentedTreadmill, motion: TreadmillMotion, rng: np.random.Generator
) -> Analog:
    faults, time, count = treadmill.faults, motion.time, len(motion.time)
    names, units, columns = [], [], []
    for sensor in treadmill.sensors:
        reading = sensor.read(motion.platform, rng) / G_MPS2
        columns.append(_delayed(reading, faults.accelerometers.delay_s, time))
        names += [f"{sensor.name}.{axis}" for axis in "XYZ"]
        units += ["g"] * 3
    held = np.repeat(motion.belt[:: round(ANALOG_HZ / BELT_HZ)], round(ANALOG_HZ / BELT_HZ))
    for channel in BELT_CHANNELS:
        columns.append((held[:count] + BELT_NOISE_MPS * rng.normal(size=count))[:, None])
        names.append(channel)
        units.append("m/s")
    told = np.column_stack([1000 * motion.platform.sway[0], np.degrees(motion.platform.pitch[0])])
    columns.append(_delayed(told, faults.platform.delay_s, time))
    pulse = CHANNEL_NOISE * rng.normal(size=count)
    for onset in motion.onsets:
        pulse[(time >= onset) & (time < onset + PULSE_S)] += PULSE_V
    columns.append(pulse[:, None])
    names += [SWAY_CHANNEL, PITCH_CHANNEL, PULSE_CHANNEL]
    units += ["mm", "deg", "V"]
    return Analog(time, tuple(names), tuple(units), np.hstack(columns))


def _delayed(values: Array, late: float, time: Array) -> Array:
    """Give what a device that is late reports at the times of the others, (N, C)."""
    if late == 0:
        return values
    return np.column_stack([np.interp(time - late, time, column) for column in values.T])


def _events(walk: Walk, end: float) -> tuple[Event, ...]:
    steps, found = walk.placement.steps, []
    for k in range(1, len(steps.contact)):
        side = steps.side(k)
        for time, label in ((steps.contact[k], "foot_strike"), (steps.off[k], "foot_off")):
            if time <= end:
                found.append(Event(float(time), label, side))
    return tuple(sorted(found, key=lambda event: event.time))


def _metadata(walk: Walk) -> dict[str, object]:
    person = walk.subject.person
    return {
        "subject": person.name,
        "mass_kg": person.mass_kg,
        "height_m": person.height_m,
        "marker_set": walk.subject.body.marker_set.name,
    }
