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
from hbm.numbers import read_numbers
from hbm.spatial import GRAVITY_MPS2, Array, shift_wrench, transform_wrench
from pipeline.config.plate_study import FILE
from pipeline.io.write import write_text
from pipeline.virtual_lab.faults import CameraFaults
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    FRAME_HZ,
    PLATE,
    PLATE_CENTERS_M,
    SAMPLES_PER_FRAME,
    Clock,
    ForcePlate,
    measure_markers,
    recorded_plate,
)

HAMMER: Final = read_numbers("pipeline.virtual_lab.protocol", "parameters.toml", "hammer")
WEIGHT: Final = read_numbers("pipeline.virtual_lab.protocol", "parameters.toml", "weight")
STEPS_HZ: Final = 20_000.0
"""Rate of the integration of a blow: 40 steps in the shortest contact."""


class Blows(NamedTuple):
    """Blows with a hammer, each in its own time, 0 where the head first touches.

    Attributes
    ----------
    contact_s
        How long the first contact lasts, (n,) [s]; its force is nearly half a sine.
    speed_mps
        With which the head arrives, (n,) [m/s].
    restitution
        About the fraction of that speed with which it leaves, (n,) [1].
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
    stiffness = HAMMER.head * (np.pi / blows.contact_s) ** 2
    damping = 1.5 * (1 - blows.restitution) / blows.speed_mps * stiffness
    # the hand swings the head down from rest where it is held
    step, begins = 1 / STEPS_HZ, blows.speed_mps / -blows.swing_mps2
    held = blows.speed_mps * begins / 2
    time = np.arange(-np.ceil(begins.max() / step), (HAMMER.free + HAMMER.lift) / step) * step
    t = time[:, None]
    # the hand and gravity move the head
    moved = np.where(t >= 0, blows.hand_mps2 - GRAVITY_MPS2, blows.swing_mps2 * (t >= -begins))
    height, force = np.zeros((2, len(time), len(held)))
    z, speed = held.copy(), np.zeros(len(held))
    for k, free in enumerate(moved):
        height[k], pressed = z, np.minimum(z, 0.0)
        # the surface only pushes, by spring and damping
        if pressed.any():
            force[k] = np.maximum(-stiffness * pressed + damping * pressed * speed, 0.0)
        speed += step * (free + force[k] / HAMMER.head)
        z += step * speed
    # smoothly back to the height held, 3u² - 2u³, after which it is at rest
    lifted = np.clip((t - HAMMER.free) / HAMMER.lift, 0, 1)
    height += (held - height) * lifted**2 * (3 - 2 * lifted)
    return time, height, np.where(t < HAMMER.free, force, 0.0)


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
    time = np.arange(round(HAMMER.duration * ANALOG_HZ)) / ANALOG_HZ
    spread = rng.uniform(-HAMMER.spread, HAMMER.spread, HAMMER.blows)
    ranges = ((shortest_s, longest_s), *HAMMER.ranges)
    blows = Blows(*(rng.uniform(low, high, HAMMER.blows) for low, high in ranges))
    since, height, force = strike(blows)
    head, load = np.full(len(time), np.nan), np.zeros(len(time))
    for k, blow in enumerate(HAMMER.interval * np.arange(1, HAMMER.blows + 1) + spread):
        # a blow's own time on that of cameras and, later, of the plate
        struck = np.interp(time - blow, since, height[:, k], left=np.nan, right=np.nan)
        head = np.where(np.isfinite(struck), struck, head)
        late = time - blow - delay_s
        load += np.interp(late, since, force[:, k], left=0.0, right=0.0)
    held = np.isfinite(head)
    return np.interp(time, time[held], head[held]), load


PLATES: Final = {"left": 0, "right": 1}

FULL_SCALE_N: Final = 510.0
"""Full scale of the plates' linearity, as in the thesis."""
SUPPORTED_VIBRATION: Final = 0.25
"""What is left of the vibration with the metal supports; assumed, the thesis states less of it
without a number for the vibration alone."""


@dataclass(frozen=True, slots=True)
class PlateErrors:
    """What is wrong with a plate and its mounting.

    Attributes
    ----------
    cross_talk
        (measured, true) component, such as (0, 2) for Fz in Fx -> fraction [1, m or 1/m].
    angle_rad, offset_m
        Plate from camera coordinates: rotation about the vertical, and offset, as
        `compensation.accuracy.PlateAlignment`.
    delay_s
        How much later the plate is than the cameras.
    curvature
        Vertical force too large by this fraction at full scale, growing with its square.
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
        return self.noise_n * np.repeat([1.0, 0.2], 3)

    @property
    def plate(self) -> ForcePlate:
        """A plate with these errors, about its centre."""
        gain = np.eye(6)
        for (measured, true), fraction in self.cross_talk.items():
            gain[measured, true] += fraction
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
    speeds: Sequence[float] = (0.3, 0.7, 1.0),
    weights: Sequence[float] = (13.44, 22.56, 36.00, 45.08),
    positions: Sequence[float] = (0.15, 0.25, 0.35),
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
        Of the recordings, in all combinations: [m/s], [kg], from the belt's outer edge [m]; speeds
        and weights are the thesis', which has three positions per belt too.
        Supports take three quarters of the vibration away.
    """
    of_belt = errors if isinstance(errors, Mapping) else dict.fromkeys(belts, errors)
    rng = np.random.default_rng(seed)
    benches = {
        belt: _Bench(folder, belt, of_belt.get(belt) or PlateErrors(), rng) for belt in belts
    }
    lines = ['name = "virtual plates"', 'axes = "left,back,up"']
    lines += [f"center_height_m = {WEIGHT.center_height}", f"full_scale_n = {FULL_SCALE_N}", ""]
    for belt, bench in benches.items():
        bench.static()
        bench.hammer()
        for part in ("static", "hammer"):
            lines += [f"[[{part}]]", f'file = "{part}_{belt}.c3d"', f'belt = "{belt}"', ""]
    combinations = product(belts, speeds, profiles, positions, weights, supports)
    for n, (belt, speed, profile, position, mass, supported) in enumerate(combinations):
        name = f"weight_{n + 1:03d}.c3d"
        lateral = (1 if belt == "left" else -1) * (PLATE.width - position)
        place = _path_of_marker(speed, profile, lateral)
        benches[belt].weight(name, place, mass, SUPPORTED_VIBRATION if supported else 1.0)
        lines += ["[[weights]]", f'file = "{name}"', f"mass_kg = {mass}", f"speed_mps = {speed}"]
        lines += [f'profile = "{profile}"', f"position_m = {position}", f'belt = "{belt}"']
        lines += [f"supports = {str(supported).lower()}", ""]
    write_text("\n".join(lines), folder / FILE)


def _path_of_marker(speed: float, profile: str, lateral: float) -> Array:
    """Give the marker's place over time at 1000 Hz, back and forth, (N, 3) [m]."""
    if profile == "sine":
        # the speed is a sine with that amplitude
        period = WEIGHT.travel * np.pi / speed
        time = np.arange(round(WEIGHT.repetitions * period * ANALOG_HZ)) / ANALOG_HZ
        x = WEIGHT.start - WEIGHT.travel / 2 * (1 - np.cos(2 * np.pi * time / period))
    else:
        # the speed turns within the belts' acceleration, and then without corners
        half = round(WEIGHT.travel / speed * ANALOG_HZ)
        commanded = np.tile(np.repeat([-speed, speed], half), WEIGHT.repetitions)
        ramp = round(2 * speed / WEIGHT.acceleration * ANALOG_HZ)
        kernel = np.ones(ramp) / ramp
        limited = np.convolve(np.pad(commanded, ramp, mode="edge"), kernel, mode="same")[ramp:-ramp]
        smooth = gaussian_filter1d(limited, WEIGHT.rounding * ANALOG_HZ, mode="nearest")
        x = WEIGHT.start + np.cumsum(smooth) / ANALOG_HZ
    count = len(x) // SAMPLES_PER_FRAME * SAMPLES_PER_FRAME
    return np.column_stack(
        [x[:count], np.full(count, lateral), np.full(count, WEIGHT.marker_height)]
    )


class _Bench(NamedTuple):
    """A belt with a plate on trial: where its recordings go, its errors, and the noise."""

    folder: Path
    belt: str
    errors: PlateErrors
    rng: np.random.Generator

    def weight(self, name: str, place: Array, mass: float, vibration: float) -> None:
        """Write a weight that the belt carries along a way of its marker, with some vibration."""
        step, errors = 1 / ANALOG_HZ, self.errors
        acceleration = np.gradient(np.gradient(place, step, axis=0), step, axis=0)
        force = mass * (acceleration + np.array([0, 0, GRAVITY_MPS2]))
        center = place - [0, 0, WEIGHT.marker_height - WEIGHT.center_height]
        wrench = np.hstack([force, np.cross(center, force)])
        angle = 2 * np.pi * errors.vibration_hz * (np.arange(len(place)) / ANALOG_HZ)
        angle += self.rng.uniform(0, 6.3)  # anywhere in a cycle
        # a pressure that moves forward by x adds -x Fz to the moment about the left axis
        wrench[:, 4] -= wrench[:, 2] * (vibration * errors.vibration_m * np.sin(angle))
        self._save(name, "WEIGHT", self._seen(place), errors.measure(wrench, self.belt, self.rng))

    def static(self) -> None:
        """Write a weight that stands at each place of the grid and is lifted in between."""
        samples, middle = round(WEIGHT.standing * ANALOG_HZ), _center(self.belt)[1]
        places, loads = [], []
        # 55 places on each belt and a mass of 22.56 kg, as in the thesis
        all_along, all_across = np.linspace(-0.75, 0.75, 11), np.linspace(-0.18, 0.18, 5)
        last = np.array([all_along[0], middle + all_across[0], WEIGHT.marker_height])
        for along, across in product(all_along, all_across):
            here = np.array([along, middle + across, WEIGHT.marker_height])
            # on its way to the next place it is in the air: the plate is unloaded
            fraction = np.linspace(0, 1, samples)[:, None]
            lift = np.array([0, 0, WEIGHT.lift]) * np.sin(np.pi * fraction)
            places += [last + (here - last) * fraction + lift, np.broadcast_to(here, (samples, 3))]
            loads += [np.zeros(samples), np.full(samples, 22.56 * GRAVITY_MPS2)]
            last = here
        place, load = np.vstack(places), np.concatenate(loads)
        force = load[:, None] * [0, 0, 1]
        wrench = np.hstack([force, np.cross(place * [1, 1, 0], force)])
        marker = self._seen(place)
        measured = self.errors.measure(wrench, self.belt, self.rng)
        self._save(f"static_{self.belt}.c3d", "WEIGHT", marker, measured)

    def hammer(self) -> None:
        """Write blows with a hammer that carries a marker."""
        shortest_s, longest_s = HAMMER.contact
        head, load = strike_belt(shortest_s, longest_s, self.errors.delay_s, self.rng)
        wrench = load[:, None] * np.eye(6)[2]
        plate, center = ForcePlate(noise=self.errors.noise), _center(self.belt)
        measured = shift_wrench(plate.measure(wrench, ANALOG_HZ, self.rng), center)
        place = np.column_stack([0 * head, 0 * head + center[1], head + HAMMER.marker])
        self._save(f"hammer_{self.belt}.c3d", "HAMMER", self._seen(place), measured)

    def _seen(self, place: Array) -> Array:
        """Record a marker whose place at 1000 Hz is given, (T, 1, 3) [m]."""
        cameras = CameraFaults(noise_m=0.0001, gaps_per_minute=0.0)
        return measure_markers(place[::SAMPLES_PER_FRAME, None], cameras, self.rng, FRAME_HZ)

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
