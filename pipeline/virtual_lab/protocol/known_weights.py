"""Experiment 1 in the virtual laboratory: known weights and a hammer on plates with known errors.

The weights, speeds and profiles are those of van de Loosdrecht (2018), II.A.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2, Array, shift_wrench, transform_wrench
from pipeline.config.plate_study import FILE
from pipeline.io.write import write_text
from pipeline.virtual_lab.faults import CameraFaults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    FRAME_HZ,
    PLATE_CENTERS_M,
    PLATE_WIDTH_M,
    SAMPLES_PER_FRAME,
    Clock,
    ForcePlate,
    measure_markers,
    recorded_plate,
)

HEAD_KG: Final = 0.5
"""Mass of the hammer's head; assumed."""
STEPS_HZ: Final = 20_000.0
"""Rate of the integration: 20 steps in the shortest contact."""
FREE_S: Final = 0.2
"""How long the head moves freely after a blow, until the hand lifts it again."""
LIFT_S: Final = 0.4
"""How long the hand lifts it; less than there is between blows."""

BLOWS: Final = 15
BLOW_RANGES: Final = (1.0, 2.5), (0.2, 0.7), (-25.0, -8.0), (-10.0, 15.0)
"""Between which `Blows` are drawn after the duration of their contact; assumed."""
BLOW_INTERVAL_S: Final = 2.0
BLOW_SPREAD_S: Final = 0.3
HAMMER_S: Final = 33.0
"""Blows with the hammer on a belt (the thesis' number), mean time between them, how far the time of
a blow is from that, and duration of the recording; assumed."""


class Blows(NamedTuple):
    """Blows with a hammer, each in its own time, 0 where the head first touches.

    Attributes
    ----------
    contact_s
        How long the first contact lasts, (n,) [s]; its force is nearly half a sine.
    speed_mps
        With which the head arrives, (n,) [m/s].
    restitution
        About the share of that speed with which it leaves, (n,) [1].
    swing_mps2
        Acceleration before a blow, by hand and gravity, (n,), negative: down.
    hand_mps2
        Acceleration by the hand after a blow, (n,), beside gravity's: where it presses down, the
        head bounces.
    """

    contact_s: Array
    speed_mps: Array
    restitution: Array
    swing_mps2: Array
    hand_mps2: Array


def strike(blows: Blows) -> tuple[Array, Array, Array]:
    """Integrate the equation of motion of the head from rest in the hand to rest in the hand.

    Parameters
    ----------
    blows
        The blows.

    Returns
    -------
    time
        (S,) [s], 0 at the first contact.
    height
        Of the head above the plate, (S, n) [m].
    force
        On the plate, upwards on the head, (S, n) [N].

    Notes
    -----
    Contact after Hunt and Crossley (1975): a spring whose half period is the duration of the
    contact, with damping in proportion to its compression, so that the force begins and ends at
    zero; it never pulls. The hand holds the head, swings it down at constant acceleration, leaves
    it nearly alone for 0.2 s and lifts it.
    """
    stiffness = HEAD_KG * (np.pi / blows.contact_s) ** 2
    damping = 1.5 * (1 - blows.restitution) / blows.speed_mps * stiffness
    step, begins = 1 / STEPS_HZ, blows.speed_mps / -blows.swing_mps2
    held = blows.speed_mps * begins / 2
    time = np.arange(-np.ceil(begins.max() / step), (FREE_S + LIFT_S) / step) * step
    height, force = np.empty((2, len(time), len(held)))
    z, speed = held.copy(), np.zeros(len(held))
    for k, t in enumerate(time):
        pressed = np.minimum(z, 0.0)
        push = np.maximum(-stiffness * pressed + damping * pressed * speed, 0.0)
        free = blows.hand_mps2 - GRAVITY_MPS2 if t >= 0 else blows.swing_mps2 * (t >= -begins)
        lifted = np.clip((t - FREE_S) / LIFT_S, 0, 1)
        height[k], force[k] = z + (held - z) * lifted**2 * (3 - 2 * lifted), push
        speed += step * (free + push / HEAD_KG)
        z += step * speed
    return time, height, np.where(time[:, None] < FREE_S, force, 0.0)


def strike_belt(
    shortest_s: float, longest_s: float, delay_s: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Strike a belt fifteen times, and hold the hammer above it in between.

    Parameters
    ----------
    shortest_s, longest_s
        Of the contacts [s].
    delay_s
        By how much the plate is later than the cameras [s].
    rng
        Source of the blows and their times.

    Returns
    -------
    height
        Of the head above the plate as cameras time it, at 1000 Hz, (N,) [m].
    force
        On the plate as the plate times it, at 1000 Hz, (N,) [N].
    """
    time = np.arange(round(HAMMER_S * ANALOG_HZ)) / ANALOG_HZ
    spread = rng.uniform(-BLOW_SPREAD_S, BLOW_SPREAD_S, BLOWS)
    ranges = ((shortest_s, longest_s), *BLOW_RANGES)
    blows = Blows(*(rng.uniform(low, high, BLOWS) for low, high in ranges))
    since, height, force = strike(blows)
    head, load = np.full(len(time), np.nan), np.zeros(len(time))
    for k, blow in enumerate(BLOW_INTERVAL_S * np.arange(1, BLOWS + 1) + spread):
        struck = np.interp(time - blow, since, height[:, k], left=np.nan, right=np.nan)
        head = np.where(np.isfinite(struck), struck, head)
        late = time - blow - delay_s
        load += np.interp(late, since, force[:, k], left=0.0, right=0.0)
    held = np.isfinite(head)
    return np.interp(time, time[held], head[held]), load


PLATES: Final = {"left": 0, "right": 1}

WEIGHTS_KG: Final = (13.44, 22.56, 36.00, 45.08)
SPEEDS_MPS: Final = (0.3, 0.7, 1.0)
POSITIONS_M: Final = (0.15, 0.25, 0.35)
"""Masses, belt speeds, and distances from the belt's outer edge; masses and speeds are the
thesis', which has three positions per belt too."""
FULL_SCALE_N: Final = 510.0
"""Full scale of the plates' linearity, as in the thesis."""
MAX_ACCELERATION_MPS2: Final = 4.0
"""Of the belts in square profiles, as in the thesis."""
TRAVEL_M: Final = 1.5
START_M: Final = 0.65
"""How far the belt carries the weight back and forth, and how far ahead of the plate's middle it
starts: nearly the whole plate."""
REPETITIONS: Final = 3
"""Of the weight's way back and forth in a recording."""
SMOOTHING_S: Final = 0.02
"""Standard deviation of the Gaussian that rounds the corners of a square profile's speed."""
CENTER_HEIGHT_M: Final = 0.15
MARKER_HEIGHT_M: Final = 0.35
"""Heights of the weight's centre of mass and of the marker on its pole above the belt; assumed."""
SUPPORTED_VIBRATION: Final = 0.25
"""Share of the vibration that is left with the metal supports; assumed, the thesis states less of
it without a number for the vibration alone."""
MAX_PHASE_RAD: Final = 6.3
"""The vibration starts anywhere in a cycle."""

STATIC_MASS_KG: Final = WEIGHTS_KG[1]
STATIC_ALONG_M: Final = np.linspace(-0.75, 0.75, 11)
STATIC_ACROSS_M: Final = np.linspace(-0.18, 0.18, 5)
"""Mass and places of the static calibration: 55 places on each belt, as in the thesis."""
STATIC_S: Final = 1.0
LIFT_M: Final = 0.3
"""How long the weight stands at a place and is on the way to the next, and how high it is lifted;
assumed."""

CONTACT_S: Final = (0.002, 0.006)
"""Shortest and longest contact of the hammer; assumed."""
HAMMER_MARKER_M: Final = 0.25
"""Height of the marker above the head of the hammer."""

CAMERAS: Final = CameraFaults(noise_m=0.0001, gaps_per_minute=0.0)
MOMENT_NOISE_M: Final = 0.2
"""Noise of a plate's moments per noise of its forces [N·m per N]; assumed."""


@dataclass(frozen=True, slots=True)
class PlateErrors:
    """What is wrong with a plate and its mounting.

    Attributes
    ----------
    cross_talk
        (measured, true) component, such as (0, 2) for Fz in Fx -> share [1, m or 1/m].
    angle_rad, offset_m
        Plate from camera coordinates: rotation about the vertical, and offset, as
        `compensation.accuracy.PlateAlignment`.
    delay_s
        How much later the plate is than the cameras.
    curvature
        Vertical force too large by this share at full scale, growing with its square.
    vibration_m, vibration_hz
        Amplitude and frequency of the centre of pressure along the belt, without supports.
    drift_n_per_s
        Of the vertical force within a recording.
    zero
        What the unloaded plate measures, (6,) [N, N·m].
    noise_n
        White noise of the forces at 1000 Hz, SD; of the moments, a fifth as many N·m.
    """

    cross_talk: Mapping[tuple[int, int], float] = field(default_factory=dict)
    angle_rad: float = 0.0
    offset_m: tuple[float, float] = (0.0, 0.0)
    delay_s: float = 0.0
    curvature: float = 0.0
    vibration_m: float = 0.0
    vibration_hz: float = 3.0
    drift_n_per_s: float = 0.0
    zero: tuple[float, ...] = (0.0,) * 6
    noise_n: float = 1.0

    @property
    def noise(self) -> Array:
        """Standard deviation of a plate's white noise, (6,) [N, N·m]."""
        return self.noise_n * np.repeat([1.0, MOMENT_NOISE_M], 3)

    @property
    def plate(self) -> ForcePlate:
        """A plate with these errors, about its centre."""
        gain = np.eye(6)
        for (measured, true), share in self.cross_talk.items():
            gain[measured, true] += share
        drift = np.array([0.0, 0.0, self.drift_n_per_s, 0.0, 0.0, 0.0])
        zero = np.array(self.zero)
        return ForcePlate(gain, self.curvature, FULL_SCALE_N, zero, drift, self.noise)

    def measure(self, wrench: Array, belt: str, rng: np.random.Generator) -> Array:
        """Record a wrench about the cameras' origin by a plate about its centre, (N, 6)."""
        late = Clock(self.delay_s).sample(wrench, ANALOG_HZ, rng)
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        aligned = transform_wrench(late, rotation, np.array([*self.offset_m, 0.0]))
        return self.plate.measure(shift_wrench(aligned, _center(belt)), ANALOG_HZ, rng)


THESIS_ERRORS: Final = PlateErrors(
    angle_rad=math.radians(0.19),
    offset_m=(0.0018, -0.0015),
    delay_s=0.004,
    vibration_m=0.015,
    vibration_hz=3.0,
)
"""What van de Loosdrecht (2018) found of the plates: rotation and offset by the static calibration,
delay of the left belt, and a centre of pressure up to 3 cm wide where supports were missing. Its
offset of 1.5 mm in x and -1.8 mm in z is 1.5 mm to the right and 1.8 mm forward: its treadmill has
x to the right, y up and z to the back, as in its Table I and in ``thesis.toml``."""


def simulate_plates(
    folder: Path,
    errors: PlateErrors | Mapping[str, PlateErrors] | None = None,
    *,
    seed: int = 0,
    speeds: Sequence[float] = SPEEDS_MPS,
    weights: Sequence[float] = WEIGHTS_KG,
    positions: Sequence[float] = POSITIONS_M,
    profiles: Sequence[str] = ("sine", "square"),
    belts: Sequence[str] = tuple(PLATES),
    supports: Sequence[bool] = (True, False),
) -> None:
    """Write a folder with ``plates.toml`` and its recordings for `hbm plates`.

    Parameters
    ----------
    folder
        To write to.
    errors
        Of both plates, or belt -> those of its plate; by default only noise.
    seed
        Seed of the noise.
    speeds, weights, positions, profiles, belts, supports
        Of the recordings, in all combinations: [m/s], [kg], from the belt's outer edge [m].
        Supports take three quarters of the vibration away.
    """
    of_belt = errors if isinstance(errors, Mapping) else dict.fromkeys(belts, errors)
    rng = np.random.default_rng(seed)
    benches = {
        belt: _Bench(folder, belt, of_belt.get(belt) or PlateErrors(), rng) for belt in belts
    }
    lines = ['name = "virtual plates"', 'axes = "left,back,up"']
    lines += [f"center_height_m = {CENTER_HEIGHT_M}", f"full_scale_n = {FULL_SCALE_N}", ""]
    for belt, bench in benches.items():
        bench.static()
        bench.hammer()
        for part in ("static", "hammer"):
            lines += [f"[[{part}]]", f'file = "{part}_{belt}.c3d"', f'belt = "{belt}"', ""]
    combinations = product(belts, speeds, profiles, positions, weights, supports)
    for n, (belt, speed, profile, position, mass, supported) in enumerate(combinations):
        name = f"weight_{n + 1:03d}.c3d"
        lateral = (1 if belt == "left" else -1) * (PLATE_WIDTH_M - position)
        place = _path_of_marker(speed, profile, lateral)
        benches[belt].weight(name, place, mass, SUPPORTED_VIBRATION if supported else 1.0)
        lines += ["[[weights]]", f'file = "{name}"', f"mass_kg = {mass}", f"speed_mps = {speed}"]
        lines += [f'profile = "{profile}"', f"position_m = {position}", f'belt = "{belt}"']
        lines += [f"supports = {str(supported).lower()}", ""]
    write_text("\n".join(lines), folder / FILE)


def _path_of_marker(speed: float, profile: str, lateral: float) -> Array:
    """Give the marker's place over time at 1000 Hz, back and forth, (N, 3) [m]."""
    if profile == "sine":
        period = TRAVEL_M * np.pi / speed
        time = np.arange(round(REPETITIONS * period * ANALOG_HZ)) / ANALOG_HZ
        x = START_M - TRAVEL_M / 2 * (1 - np.cos(2 * np.pi * time / period))
    else:
        half = round(TRAVEL_M / speed * ANALOG_HZ)
        wanted = np.tile(np.repeat([-speed, speed], half), REPETITIONS)
        ramp = round(2 * speed / MAX_ACCELERATION_MPS2 * ANALOG_HZ)
        kernel = np.ones(ramp) / ramp
        limited = np.convolve(np.pad(wanted, ramp, mode="edge"), kernel, mode="same")[ramp:-ramp]
        smooth = gaussian_filter1d(limited, SMOOTHING_S * ANALOG_HZ, mode="nearest")
        x = START_M + np.cumsum(smooth) / ANALOG_HZ
    count = len(x) // SAMPLES_PER_FRAME * SAMPLES_PER_FRAME
    return np.column_stack([x[:count], np.full(count, lateral), np.full(count, MARKER_HEIGHT_M)])


class _Bench(NamedTuple):
    """A belt with a plate on trial: where its recordings go, its errors, and the noise."""

    folder: Path
    belt: str
    errors: PlateErrors
    rng: np.random.Generator

    def weight(self, name: str, place: Array, mass: float, share: float) -> None:
        """Write a weight that the belt carries along a way of its marker, with some vibration."""
        step, errors = 1 / ANALOG_HZ, self.errors
        acceleration = np.gradient(np.gradient(place, step, axis=0), step, axis=0)
        force = mass * (acceleration + np.array([0, 0, GRAVITY_MPS2]))
        center = place - [0, 0, MARKER_HEIGHT_M - CENTER_HEIGHT_M]
        wrench = np.hstack([force, np.cross(center, force)])
        angle = 2 * np.pi * errors.vibration_hz * (np.arange(len(place)) / ANALOG_HZ)
        angle += self.rng.uniform(0, MAX_PHASE_RAD)
        wrench[:, 4] -= wrench[:, 2] * (share * errors.vibration_m * np.sin(angle))
        self._save(name, "WEIGHT", self._seen(place), errors.measure(wrench, self.belt, self.rng))

    def static(self) -> None:
        """Write a weight that stands at each place of the grid and is lifted in between."""
        samples, middle = round(STATIC_S * ANALOG_HZ), _center(self.belt)[1]
        places, loads = [], []
        last = np.array([STATIC_ALONG_M[0], middle + STATIC_ACROSS_M[0], MARKER_HEIGHT_M])
        for along, across in product(STATIC_ALONG_M, STATIC_ACROSS_M):
            here = np.array([along, middle + across, MARKER_HEIGHT_M])
            share = np.linspace(0, 1, samples)[:, None]
            lift = np.array([0, 0, LIFT_M]) * np.sin(np.pi * share)
            places += [last + (here - last) * share + lift, np.broadcast_to(here, (samples, 3))]
            loads += [np.zeros(samples), np.full(samples, STATIC_MASS_KG * GRAVITY_MPS2)]
            last = here
        place, load = np.vstack(places), np.concatenate(loads)
        force = load[:, None] * [0, 0, 1]
        wrench = np.hstack([force, np.cross(place * [1, 1, 0], force)])
        seen = self._seen(place)
        measured = self.errors.measure(wrench, self.belt, self.rng)
        self._save(f"static_{self.belt}.c3d", "WEIGHT", seen, measured)

    def hammer(self) -> None:
        """Write blows with a hammer that carries a marker."""
        head, load = strike_belt(*CONTACT_S, self.errors.delay_s, self.rng)
        wrench = load[:, None] * np.eye(6)[2]
        plate, center = ForcePlate(noise=self.errors.noise), _center(self.belt)
        measured = shift_wrench(plate.measure(wrench, ANALOG_HZ, self.rng), center)
        middle = np.full(len(head), center[1])
        place = np.column_stack([0 * head, middle, head + HAMMER_MARKER_M])
        self._save(f"hammer_{self.belt}.c3d", "HAMMER", self._seen(place), measured)

    def _seen(self, place: Array) -> Array:
        """Record a marker whose place at 1000 Hz is given, (T, 1, 3) [m]."""
        return measure_markers(place[::SAMPLES_PER_FRAME, None], CAMERAS, self.rng, FRAME_HZ)

    def _save(self, name: str, marker: str, position: Array, wrench_in_plate: Array) -> None:
        """Write a recording; the other plate measures nothing."""
        frames = np.arange(len(position)) / FRAME_HZ
        time = np.arange(len(wrench_in_plate)) / ANALOG_HZ
        plates = [
            recorded_plate(
                k + 1, time, wrench_in_plate if belt == self.belt else 0 * wrench_in_plate
            )
            for belt, k in PLATES.items()
        ]
        write_c3d(self.folder / name, Markers(frames, (marker,), position), plates)


def _center(belt: str) -> Array:
    """Give the centre of a belt's plate, (3,) [m]."""
    return np.asarray(PLATE_CENTERS_M[PLATES[belt]])
