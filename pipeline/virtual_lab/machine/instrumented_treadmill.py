"""The treadmill with its instruments: what these undergo when it moves, and what they record.

Plates, accelerometers, streams and cameras with their errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.signal import lfilter

from hbm.markers import Markers
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array, rotation_about, shift_wrench, transform_wrench
from pipeline.io.recording import Analog, Metadata, Plate, Recording
from pipeline.io.units import acceleration_in_mps2
from pipeline.virtual_lab.faults import AccelerometerFaults, CameraFaults, Faults, PlateFaults
from pipeline.virtual_lab.machine.belts import Drives, carried_of_belts, make_drives, run_belts
from pipeline.virtual_lab.machine.platform import Machine, Pair, TreadmillMotion
from pipeline.virtual_lab.machine.structure import (
    Response,
    Structure,
    frame_shape,
    make_structure,
    respond,
)

PLATE: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "plate")
CONVERTERS: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "converters")
STREAMS: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "streams")
CAMERAS: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "cameras")
SENSORS: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "accelerometers")

ANALOG_HZ: Final = 1000.0
FRAME_HZ: Final = 100.0
"""Sampling rate of plates and analog channels, and frame rate of the cameras: the thesis'. Standard
deviations of noise on plates and analog channels are stated for `ANALOG_HZ`."""
SAMPLES_PER_FRAME: Final = round(ANALOG_HZ / FRAME_HZ)


@dataclass(frozen=True, slots=True)
class Clock:
    """When an instrument samples.

    Attributes
    ----------
    delay_s
        How much later its readings are than what they show [s].
    rate
        Error of its clock, as a fraction of the time.
    jitter_s
        Standard deviation of its instants [s].
    """

    delay_s: float = 0.0
    rate: float = 0.0
    jitter_s: float = 0.0

    def sample(self, values: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Give what the instrument samples of what happens, (N, C), at ``rate_hz``, (N, C)."""
        # where in the true samples each reading is taken: by a clock that runs fast and lags
        position = np.arange(len(values), dtype=np.float64)
        position *= 1 + self.rate
        position -= self.delay_s * rate_hz
        if self.jitter_s > 0:
            position += rate_hz * jitter(len(values), self.jitter_s, rng)
        return interpolated(values, position)


def jitter(count: int, sd_s: float, rng: np.random.Generator) -> Array:
    """Draw errors of instants, 2 ms at most, (N,) [s]."""
    most = CONVERTERS.largest_jitter
    return np.clip(sd_s * rng.standard_normal(count), -most, most)


def interpolated(values: Array, position: Array) -> Array:
    """Give values between samples, of the cubic through the four around each.

    Parameters
    ----------
    values
        (N, C).
    position
        Places in samples, (K,); before the first and after the last it is held.

    Returns
    -------
    Array
        (K, C); at a sample exactly that.
    """
    last = len(values) - 1
    here = np.clip(position, 0, last)
    below = np.minimum(here.astype(int), max(last - 1, 0))
    f = here - below
    # Lagrange's polynomials through the samples at -1, 0, 1 and 2
    weights = (
        -f * (f - 1) * (f - 2) / 6,
        (f + 1) * (f - 1) * (f - 2) / 2,
        -(f + 1) * f * (f - 2) / 2,
        (f + 1) * f * (f - 1) / 6,
    )
    total = np.zeros((len(here), values.shape[1]))
    for k, weight in enumerate(weights):
        total += weight[:, None] * values[np.clip(below + k - 1, 0, last)]
    return total


def add_noise(
    values: Array, sd: Array | float, rng: np.random.Generator, rate_hz: float = ANALOG_HZ
) -> None:
    """Add white noise to readings in place, (N, C), with one standard deviation or one of each.

    It is stated for `ANALOG_HZ`; at other rates the density stays the same.
    """
    if np.any(sd):
        values += sd * np.sqrt(rate_hz / ANALOG_HZ) * rng.standard_normal(values.shape)


def wander(count: int, rate_hz: float, channels: int, rng: np.random.Generator) -> Array:
    """Draw zeros that wander below 0.5 Hz, with standard deviation 1, (N, channels)."""
    update_hz = 10.0  # how often a zero is drawn; in between it is straight
    step = max(round(rate_hz / update_hz), 1)
    # a low-pass of first order keeps the variance at 1 if its input has 1 - kept²
    kept = np.exp(-2 * np.pi * PLATE.wander_corner / update_hz)
    drawn = rng.standard_normal((count // step + 2, channels))
    drawn[1:] *= np.sqrt(1 - kept**2)
    drawn = np.asarray(lfilter([1.0], [1.0, -kept], drawn, axis=0))
    fraction = np.arange(step)[:, None] / step
    between = drawn[:-1, None] + fraction * np.diff(drawn, axis=0)[:, None]
    return np.asarray(between.reshape(-1, channels)[:count])


def quantised(values: Array, largest: Array | float, bits: int) -> Array:
    """Round readings to the steps of a converter's range; 0 bits: not at all."""
    if bits == 0:
        return values
    step = np.asarray(largest) / 2 ** (bits - 1)
    return np.asarray(np.rint(values / step) * step)


def add_interference(values: Array, rms: Array | float, rng: np.random.Generator) -> None:
    """Add interference from above half the sampling rate to readings in place, (N, C).

    Sampled without a filter it appears as a tone at any frequency below that; in each recording
    and channel there is some of it.
    """
    by_channel = rms * rng.standard_normal(values.shape[1])
    if np.any(rms):
        frequency, phase = rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
        tone = np.sqrt(2) * np.sin(frequency * np.arange(len(values)) + phase)
        values += tone[:, None] * by_channel


@dataclass(frozen=True, slots=True)
class Stream:
    """When a controller reads what it streams.

    Attributes
    ----------
    delay_s
        How much later its values arrive than what they show [s].
    jitter_s
        Standard deviation of its instants, one every 5 ms [s].
    doubled_per_minute
        How often a value is repeated instead of read anew.
    held
        Whether a value stays until the next; else the channel goes on between its instants.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    doubled_per_minute: float = 0.0
    held: bool = False

    def sample(self, values: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Give what the recorder holds of what happens, (N, C), at ``rate_hz``, (N, C)."""
        step = max(round(rate_hz / STREAMS.update_rate), 1)
        count = len(values)
        # how late each value is, in samples: a repeated one is that of the instant before
        first = np.arange(0, count, step)
        of_jitter, of_doubled = rng.spawn(2)
        late = np.full(len(first), -self.delay_s * rate_hz)
        late += rate_hz * jitter(len(first), self.jitter_s, of_jitter)
        seconds = step / rate_hz
        doubled = of_doubled.random(len(first)) < self.doubled_per_minute / 60 * seconds
        late[doubled] -= step
        if self.held:
            return np.repeat(interpolated(values, first + late), step, axis=0)[:count]
        return interpolated(values, np.arange(count) + np.repeat(late, step)[:count])


def measure_markers(
    position: Array, faults: CameraFaults, rng: np.random.Generator, rate_hz: float
) -> Array:
    """Report marker positions with noise and gaps (NaN).

    Parameters
    ----------
    position
        True positions, (T, M, 3) [m].
    faults
        Sizes and rates of the errors.
    rng
        Source of chance.
    rate_hz
        Frame rate [Hz].

    Returns
    -------
    Array
        Reported positions, (T, M, 3) [m].
    """
    frames, markers = position.shape[:2]
    measured = position + faults.noise_m * rng.normal(size=position.shape)
    # gaps of random length in random markers, their number by time and markers
    minutes = frames / rate_hz / 60
    for _ in range(rng.poisson(faults.gaps_per_minute * minutes * markers / CAMERAS.markers)):
        start = rng.integers(frames)
        length = max(1, round(rng.exponential(CAMERAS.gap) * rate_hz))
        measured[start : start + length, rng.integers(markers)] = np.nan
    return measured


PLATE_CENTERS_M: Final = np.array([[0.0, PLATE.width / 2, 0.0], [0.0, -PLATE.width / 2, 0.0]])
"""Centres of the left and the right plate's surface with the platform in neutral."""
ERROR_SCALE: Final = np.array([1.0, 1.0, 1.0, *[1 / 3] * 3])
"""By which errors drawn for forces are multiplied: those of moments [N·m per N] by about how far
the load cells are from the centre of a plate."""


@dataclass(frozen=True, slots=True)
class ForcePlate:
    """How a plate's load cells report a wrench: all errors are about one point of the plate.

    Attributes
    ----------
    gain
        Cross-talk and gain: measured = gain @ true, (6, 6).
    curvature
        Vertical force too large by this fraction at full scale, growing with its square.
    full_scale_n
        Vertical force at which ``curvature`` is stated [N].
    offset
        Zero error, (6,) [N, N·m].
    drift
        Change of the zero, (6,) [N/s, N·m/s].
    noise
        Standard deviation of white noise from sample to sample at `ANALOG_HZ`, (6,) [N, N·m].
    wander
        Standard deviation of a zero that wanders, (6,) [N, N·m].
    zero_shift
        Standard deviation of the zero from recording to recording, (6,) [N, N·m].
    alias
        Root mean square of interference from above half the sampling rate, (6,) [N, N·m]; in each
        recording some of it.
    bits
        Of its converter over its range either way; 0 for a perfect one.
    clock
        When it samples.
    """

    gain: Array = field(default_factory=lambda: np.eye(6))
    curvature: float = 0.0
    full_scale_n: float = 1.0
    offset: Array = field(default_factory=lambda: np.zeros(6))
    drift: Array = field(default_factory=lambda: np.zeros(6))
    noise: Array = field(default_factory=lambda: np.zeros(6))
    wander: Array = field(default_factory=lambda: np.zeros(6))
    zero_shift: Array = field(default_factory=lambda: np.zeros(6))
    alias: Array = field(default_factory=lambda: np.zeros(6))
    bits: int = 0
    clock: Clock = field(default_factory=Clock)

    def measure(self, wrench: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Report true wrenches.

        Parameters
        ----------
        wrench
            What the load cells carry, (N, 6) [N, N·m].
        rate_hz
            Sampling rate [Hz]. White noise keeps its density at any.
        rng
            Source of the noise.

        Returns
        -------
        Array
            (N, 6) [N, N·m], about the same point.
        """
        # sampled, changed by gains and curvature, then zero, interference, noise and converter
        of_clock, of_zero, of_wander, of_alias = rng.spawn(4)
        measured = self.clock.sample(wrench, rate_hz, of_clock) @ self.gain.T
        measured[:, 2] += self.curvature / self.full_scale_n * measured[:, 2] ** 2
        measured += self.offset + self.zero_shift * of_zero.standard_normal(6)
        measured += np.arange(len(wrench))[:, None] / rate_hz * self.drift
        if self.wander.any():
            measured += wander(len(wrench), rate_hz, 6, of_wander) * self.wander
        add_interference(measured, self.alias, of_alias)
        add_noise(measured, self.noise, rng, rate_hz)
        return quantised(measured, PLATE.full_scale * ERROR_SCALE, self.bits)


def make_force_plate(
    faults: PlateFaults, rng: np.random.Generator, clock: Clock | None = None
) -> ForcePlate:
    """Draw a plate's errors.

    Parameters
    ----------
    faults
        Their standard deviations.
    rng
        Source of chance.
    clock
        When it samples; by default late by the left plate's delay.

    Returns
    -------
    ForcePlate
        Errors of moments are a third of those of forces, in N·m and N (`ERROR_SCALE`).
    """
    cross_talk = faults.gain_scale * PLATE.cross_talk * rng.normal(size=(6, 6))
    return ForcePlate(
        gain=np.eye(6) + cross_talk * ERROR_SCALE[:, None],
        curvature=faults.gain_scale * CONVERTERS.curvature * rng.normal(),
        full_scale_n=PLATE.full_scale,
        offset=faults.zero_scale * PLATE.offset * rng.normal(size=6) * ERROR_SCALE,
        drift=faults.zero_scale * PLATE.drift / 60 * rng.normal(size=6) * ERROR_SCALE,
        noise=faults.noise_scale * np.repeat([PLATE.force_noise, PLATE.moment_noise], 3),
        wander=faults.fine_scale * PLATE.wander * ERROR_SCALE,
        zero_shift=faults.zero_scale * PLATE.zero_shift * ERROR_SCALE,
        alias=faults.fine_scale * PLATE.interference * ERROR_SCALE,
        bits=CONVERTERS.bits if faults.fine_scale else 0,
        clock=clock or Clock(faults.delay_s),
    )


def misplaced(wrench: Array, faults: PlateFaults) -> Array:
    """Give wrenches as plates see them that are not where the cameras' coordinates say.

    Parameters
    ----------
    wrench
        In the platform frame about its origin, (N, 6) [N, N·m].
    faults
        Rotation and offset from the cameras' to the plates' coordinates.

    Returns
    -------
    Array
        In the plates' frame about its origin, (N, 6) [N, N·m]: what a force plate reports as if it
        were in the platform frame.
    """
    offset = np.array([faults.placement_forward_m, faults.placement_left_m, 0.0])
    turned = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(faults.placement_deg))
    return transform_wrench(wrench, turned, offset)


def recorded_plate(number: int, time: Array, wrench_in_plate: Array) -> Plate:
    """Give a plate as a recording holds it.

    Parameters
    ----------
    number
        1 for the left plate, 2 for the right.
    time
        Sample times, (N,) [s].
    wrench_in_plate
        In the platform's axes about the plate's centre, (N, 6) [N, N·m].

    Returns
    -------
    Plate
        Its axes are parallel to the platform's.
    """
    center = PLATE_CENTERS_M[number - 1]
    x, y = PLATE.length / 2, PLATE.width / 2
    corners = center + np.array([[x, y, 0], [x, -y, 0], [-x, -y, 0], [-x, y, 0]])
    return Plate(number, time, wrench_in_plate, np.eye(3), center, corners)


PLACES_M: Final = {
    "rear_left": (-0.90, 0.62, -0.20),
    "front_right": (0.95, -0.58, -0.20),
    "front_left": (0.88, 0.60, -0.06),
    "rear_right": (-0.86, -0.63, -0.32),
}
"""Name and place in the platform frame: the first two at opposite corners, as in the thesis; the
other two, assumed, at other heights, so that they distinguish rotations."""
SENSOR_NAMES: Final = tuple(PLACES_M)


@dataclass(frozen=True, slots=True)
class Accelerometer:
    """A triaxial accelerometer fixed to the platform.

    Attributes
    ----------
    name
        Where it is.
    place
        In the platform frame, (3,) [m].
    sensitivity
        Reading = sensitivity @ specific force + offset, (3, 3); holds gains, misaligned axes, and
        what each channel shows of the other two axes.
    offset
        (3,) [m/s²].
    noise
        Standard deviation of white noise from sample to sample at `ANALOG_HZ` [m/s²].
    limit
        Where it clips [m/s²].
    curvature
        Reading too large by this fraction of ``limit`` there, growing with its square, (3,).
    drift
        Change of the offset, (3,) [m/s² per s].
    alias
        Root mean square of interference from above half the sampling rate [m/s²]; in each recording
        and channel some of it.
    bits
        Of its converter over ``limit`` either way; 0 for a perfect one.
    clock
        When it samples.
    """

    name: str
    place: Array
    sensitivity: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    noise: float = 0.0
    limit: float = np.inf
    curvature: Array = field(default_factory=lambda: np.zeros(3))
    drift: Array = field(default_factory=lambda: np.zeros(3))
    alias: float = 0.0
    bits: int = 0
    clock: Clock = field(default_factory=Clock)

    def measure(self, specific_force: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """Report the specific force at its place, (N, 3) [m/s²], by its three channels.

        White noise keeps its density at any sampling rate; the drift counts from the first sample.
        """
        of_clock, of_alias = rng.spawn(2)
        measured = self.clock.sample(specific_force, rate_hz, of_clock) @ self.sensitivity.T
        measured += self.curvature / self.limit * measured**2
        measured += self.offset
        measured += np.arange(len(measured))[:, None] / rate_hz * self.drift
        add_interference(measured, self.alias, of_alias)
        add_noise(measured, self.noise, rng, rate_hz)
        return quantised(np.clip(measured, -self.limit, self.limit), self.limit, self.bits)


def make_accelerometers(
    faults: AccelerometerFaults, rng: np.random.Generator, clocks: Sequence[Clock] = ()
) -> tuple[Accelerometer, ...]:
    """Draw the accelerometers of a laboratory.

    Parameters
    ----------
    faults
        How many there are, and the standard deviations of their errors.
    rng
        Source of chance.
    clocks
        When each samples; by default late by the stated delay.

    Returns
    -------
    tuple of Accelerometer
        In the order of `PLACES_M`.
    """
    clocks = clocks or [Clock(faults.delay_s)] * faults.sensors
    scale = faults.error_scale
    sensors = []
    for (name, place), clock in zip(list(PLACES_M.items())[: faults.sensors], clocks, strict=False):
        # turned about a random axis; each channel has its gain, and shows some of the other two
        axis = rng.normal(size=3)
        angle = np.radians(scale * SENSORS.misalignment) * rng.normal()
        misalignment = rotation_about(axis / np.linalg.norm(axis), angle)
        gain = np.diag(1 + scale * SENSORS.gain * rng.normal(size=3))
        offset = scale * SENSORS.offset * rng.normal(size=3)
        others = scale * SENSORS.cross_axis * rng.normal(size=(3, 3)) * (1 - np.eye(3))
        sensors.append(
            Accelerometer(
                name,
                np.array(place),
                sensitivity=(gain + others) @ misalignment,
                offset=offset,
                noise=faults.noise_scale * SENSORS.noise,
                limit=SENSORS.range * GRAVITY_MPS2,
                curvature=scale * CONVERTERS.curvature * rng.normal(size=3),
                drift=scale * SENSORS.drift / 60 * rng.normal(size=3),
                alias=scale * SENSORS.interference,
                bits=CONVERTERS.bits if faults.noise_scale else 0,
                clock=clock,
            )
        )
    return tuple(sensors)


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
    rng = np.random.default_rng((seed, 7))  # not the random numbers of a subject
    of_left, of_right, of_sensors, of_clocks, of_drives = rng.spawn(5)
    # the clocks of both plates and of every accelerometer that there can be
    delays = [*faults.plates.delays_s, *[faults.accelerometers.delay_s] * len(SENSOR_NAMES)]
    rate_sd = 1e-6 * faults.clocks.scale * CONVERTERS.clock_rate
    errors = rate_sd * of_clocks.standard_normal(len(delays))
    left, right, *of_each = (
        Clock(delay_s, rate, faults.clocks.scale * CONVERTERS.jitter)
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
        sensor.measure(at_sensor, rate_hz, noise) / acceleration_in_mps2("g")
        for sensor, at_sensor, noise in zip(
            treadmill.sensors, response.sensors, noises, strict=True
        )
    ]
    sensors = tuple(f"{sensor.name}.{axis}" for sensor in treadmill.sensors for axis in "XYZ")
    # a motor's reports are uneven already
    jitter_s = faults.clocks.scale * STREAMS.jitter if treadmill.drives is None else 0.0
    stream = Stream(0.0, jitter_s, faults.clocks.scale * STREAMS.doubled, held=True)
    noise_mps, speeds = faults.belts.roughness * STREAMS.belt_noise, []
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
    # plates err about the platform's origin, and are recorded about their centres
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
    # the frame's bending moves a marker on the platform, the platform's pose brings it to the lab
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
    # a repetition of the motion starts some whole frames earlier or later
    most = faults.replay_frames
    late_s = faults.delay_s + float(of_delay.integers(-most, most, endpoint=True)) / FRAME_HZ
    stream = Stream(late_s, scale * STREAMS.jitter, scale * STREAMS.doubled)
    values = stream.sample(true, motion.rate_hz, of_stream)
    return (SWAY_CHANNEL, PITCH_CHANNEL), ("mm", "deg"), values


def measure_pulses(motion: TreadmillMotion, rng: np.random.Generator) -> Channels:
    """Record the pulses that mark the onsets of perturbations."""
    time, pulse = motion.time, np.zeros((len(motion.time), 1))
    for onset in motion.onsets:
        pulse[(time >= onset) & (time < onset + STREAMS.pulse_duration)] += STREAMS.pulse_height
    add_noise(pulse, STREAMS.pulse_noise, rng)
    return (PULSE_CHANNEL,), ("V",), pulse
