"""The treadmill with its instruments: what these undergo when it moves, and what they record."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.spatial import Array, shift_wrench
from pipeline.io.recording import Analog, Metadata, Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.belts import Drives, carried_of_belts, make_drives, run_belts
from pipeline.virtual_lab.machine.instruments import (
    FRAME_HZ,
    PLATE_CENTERS_M,
    SENSOR_NAMES,
    Accelerometer,
    Clock,
    ForcePlate,
    Stream,
    add_noise,
    make_accelerometers,
    make_force_plate,
    measure_markers,
    misplaced,
    recorded_plate,
)
from pipeline.virtual_lab.machine.platform import Machine, Pair, TreadmillMotion
from pipeline.virtual_lab.machine.structure import (
    Response,
    Structure,
    frame_shape,
    make_structure,
    respond,
)

RATE_PPM: Final = 1.0
JITTER_S: Final = 0.00002
"""Error of each instrument's clock, and of the instants of the converter of plates and
accelerometers (SD); assumed, of instruments that are synchronised."""
STREAM_JITTER_S: Final = 0.0003
DOUBLED_PER_MINUTE: Final = 0.3
"""Of the stream of belt speed and platform channels, of which a sample is now and then a repetition
of the one before: 0.2 to 0.3 ms and one to three in six minutes are those of the recordings of Hnat
and van den Bogert (2014)."""
NOISE_MPS: Final = 0.005
"""Of the belts' speed channels; assumed."""
INSTRUMENT_STREAM: Final = 7
"""Number of the random numbers of the instruments, which are not those of a subject."""


@dataclass(frozen=True, slots=True)
class InstrumentedTreadmill:
    """A treadmill and its instruments with their errors.

    Attributes
    ----------
    machine
        Mechanical properties of the treadmill.
    structure
        How it yields; None for a rigid one.
    drives
        Motors of the left and the right belt; None for belts that answer linearly.
    faults
        Sizes of all errors.
    plates
        Left and right plate; their errors are about the platform's origin.
    sensors
        Accelerometers.
    """

    machine: Machine
    structure: Structure | None
    drives: Drives | None
    faults: Faults
    plates: tuple[ForcePlate, ForcePlate]
    sensors: tuple[Accelerometer, ...]


def make_treadmill(faults: Faults, seed: int) -> InstrumentedTreadmill:
    """Draw the instruments of a laboratory.

    Parameters
    ----------
    faults
        Sizes of their errors.
    seed
        Seed of the errors.

    Returns
    -------
    InstrumentedTreadmill
        Equal seeds give equal instruments; each has its own random numbers.
    """
    of_left, of_right, of_sensors, of_clocks, of_drives = np.random.default_rng(
        (seed, INSTRUMENT_STREAM)
    ).spawn(5)
    # the clocks of both plates and of every accelerometer that there can be
    delays = [*faults.plates.delays_s, *[faults.accelerometers.delay_s] * len(SENSOR_NAMES)]
    errors = 1e-6 * faults.clocks.scale * RATE_PPM * of_clocks.standard_normal(len(delays))
    left, right, *of_each = (
        Clock(delay_s, rate, faults.clocks.scale * JITTER_S)
        for delay_s, rate in zip(delays, errors.tolist(), strict=True)
    )
    flexibility = faults.machine.flexibility
    return InstrumentedTreadmill(
        Machine(sway_hz=faults.machine.sway_hz),
        make_structure(flexibility) if flexibility else None,
        make_drives(faults.belts, of_drives),
        faults,
        (
            make_force_plate(faults.plates, of_left, left),
            make_force_plate(faults.plates, of_right, right),
        ),
        make_accelerometers(faults.accelerometers, of_sensors, of_each),
    )


def undergo(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    rng: np.random.Generator,
    people: Pair | None = None,
    on_frame: Array | None = None,
) -> Response:
    """Give what plates, accelerometers and platform markers undergo in a trial.

    Parameters
    ----------
    treadmill
        The treadmill with its instruments.
    motion
        How the treadmill moves, N samples.
    rng
        Source of the rollers' angles and of the belts' rumble.
    people
        Ground reaction of the left and the right plate on people, in the platform frame about its
        origin, (N, 6) each [N, N·m]; None for an empty treadmill.
    on_frame
        Action of people on the frame beside the belts, likewise, (N, 6); None for nobody.

    Returns
    -------
    Response
        At the motion's samples.
    """
    rate_hz = motion.rate_hz
    belts = run_belts(treadmill.machine, treadmill.drives, motion.belt, rate_hz, rng, people)
    response = respond(
        treadmill.structure,
        motion.platform,
        carried_of_belts(belts),
        people,
        on_frame,
        tuple(sensor.place for sensor in treadmill.sensors),
        rate_hz,
        round(rate_hz / FRAME_HZ),
    )
    return replace(response, belts=belts)


PLATFORM_MARKERS_M: Final = {
    "ROT_REF": (1.10, 0.72, 0.06),
    "ROT_C1": (1.10, -0.72, 0.02),
    "ROT_C2": (-1.10, -0.72, 0.08),
    "ROT_C3": (-1.10, 0.72, 0.02),
    "ROT_C4": (0.35, 0.76, 0.05),
}
"""Markers on the platform's rim, in its frame; assumed, not all in one plane and not symmetric."""
BELT_CHANNELS: Final = ("Belt.Left", "Belt.Right")
SWAY_CHANNEL: Final = "Platform.Sway"
PITCH_CHANNEL: Final = "Platform.Pitch"
PULSE_CHANNEL: Final = "Perturbation"
PULSE_V: Final = 5.0
"""Height of the pulse that marks the onset of a perturbation: a logic level."""
PULSE_S: Final = 0.02
PULSE_NOISE_V: Final = 0.01
"""Duration of the pulse, and noise on its channel; assumed."""
Channels = tuple[tuple[str, ...], tuple[str, ...], Array]
"""Names, units and values, (N, C), of analog channels."""


Streams = tuple[np.random.Generator, np.random.Generator, np.random.Generator]
"""Sources of the noise of plates, accelerometers and belts."""


def recorded(
    name: str,
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    response: Response,
    belts: tuple[str, ...],
    streams: Streams,
    markers: Markers | None = None,
    more: Sequence[Channels] = (),
    metadata: Metadata | None = None,
) -> Recording:
    """Record plates, accelerometers and the speed of belts, by the names of their channels.

    Parameters
    ----------
    name
        Of the file.
    treadmill, motion, response
        The instruments, how the treadmill moved, and what they underwent.
    belts
        Channels of belt speed, the left one first.
    streams
        Sources of noise.
    markers
        What the cameras recorded; by default frames at their rate without a marker.
    more
        Other channels.
    metadata
        What the file states of a person.

    Returns
    -------
    Recording
        Plates and channels at the motion's rate.
    """
    of_plates, of_sensors, of_belts = streams
    rate_hz, faults = motion.rate_hz, treadmill.faults
    noises = of_sensors.spawn(len(treadmill.sensors))
    readings = [
        sensor.measure(felt, rate_hz, noise) / acceleration_in_mps2("g")
        for sensor, felt, noise in zip(treadmill.sensors, response.sensors, noises, strict=True)
    ]
    sensors = tuple(f"{sensor.name}.{axis}" for sensor in treadmill.sensors for axis in "XYZ")
    # a motor's reports are uneven already
    jitter_s = faults.clocks.scale * STREAM_JITTER_S if treadmill.drives is None else 0.0
    stream = Stream(0.0, jitter_s, faults.clocks.scale * DOUBLED_PER_MINUTE, held=True)
    noise_mps, speeds = faults.belts.roughness * NOISE_MPS, []
    for belt, noise, _ in zip(response.belts, of_belts.spawn(2), belts, strict=False):
        speeds.append(stream.sample(belt.reported_speed[:, None], rate_hz, noise.spawn(1)[0]))
        add_noise(speeds[-1], noise_mps, noise, rate_hz)
    names, units, columns = zip(
        (sensors, ("g",) * len(sensors), np.hstack(readings)),
        (belts, ("m/s",) * len(belts), np.hstack(speeds)),
        *more,
        strict=True,
    )
    plates = []
    for k, noise in enumerate(of_plates.spawn(2)):
        carried = misplaced(response.plates[k], faults.plates)
        measured = treadmill.plates[k].measure(carried, rate_hz, noise)
        about_center = shift_wrench(measured, PLATE_CENTERS_M[k])
        plates.append(recorded_plate(k + 1, motion.time, about_center))
    if markers is None:
        frames = motion.time[:: round(rate_hz / FRAME_HZ)]
        markers = Markers(frames, (), np.empty((len(frames), 0, 3)))
    return Recording(
        Path(name),
        markers,
        tuple(plates),
        Analog(motion.time, sum(names, ()), sum(units, ()), np.hstack(columns)),
        metadata=metadata or Metadata(),
    )


def measure_platform(
    treadmill: InstrumentedTreadmill,
    motion: TreadmillMotion,
    response: Response,
    rng: np.random.Generator,
) -> Markers:
    """Record the markers on the platform."""
    step = round(motion.rate_hz / FRAME_HZ)
    pose = motion.platform.every(step).pose
    places = []
    for place in map(np.array, PLATFORM_MARKERS_M.values()):
        moved = place + response.frame @ frame_shape(place)[:3].T
        places.append(pose.position + (pose.rotation @ moved[..., None])[..., 0])
    measured = measure_markers(np.stack(places, axis=1), treadmill.faults.cameras, rng, FRAME_HZ)
    return Markers(motion.time[::step], tuple(PLATFORM_MARKERS_M), measured)


def measure_pose(
    treadmill: InstrumentedTreadmill, motion: TreadmillMotion, rng: np.random.Generator
) -> Channels:
    """Record sway and pitch as the platform's controller reports them."""
    of_delay, of_stream = rng.spawn(2)
    sway_mm, pitch_deg = 1000 * motion.platform.sway[0], np.degrees(motion.platform.pitch[0])
    true = np.column_stack([sway_mm, pitch_deg])
    scale, faults = treadmill.faults.clocks.scale, treadmill.faults.platform
    most = faults.replay_frames
    late_s = faults.delay_s + float(of_delay.integers(-most, most, endpoint=True)) / FRAME_HZ
    stream = Stream(late_s, scale * STREAM_JITTER_S, scale * DOUBLED_PER_MINUTE)
    values = stream.sample(true, motion.rate_hz, of_stream)
    return (SWAY_CHANNEL, PITCH_CHANNEL), ("mm", "deg"), values


def measure_pulses(motion: TreadmillMotion, rng: np.random.Generator) -> Channels:
    """Record the pulses that mark the onsets of perturbations."""
    time, pulse = motion.time, np.zeros((len(motion.time), 1))
    for onset in motion.onsets:
        pulse[(time >= onset) & (time < onset + PULSE_S)] += PULSE_V
    add_noise(pulse, PULSE_NOISE_V, rng)
    return (PULSE_CHANNEL,), ("V",), pulse
