"""Experiment 1 in the virtual laboratory: known weights on plates with known errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from hbm.markers import Markers
from hbm.spatial import GRAVITY_MPS2, Array, shift_wrench, transform_wrench
from pipeline.config.plate_study import FILE
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Plate

FRAME_HZ: Final = 100.0
PER_FRAME: Final = 10
TRAVEL_M: Final = 1.5
START_M: Final = 0.65
HARDEST: Final = 4.0
CENTER_M: Final = 0.15
TOP_M: Final = 0.35
CENTERS: Final = {"left": 0.25, "right": -0.25}
WEIGHTS_KG: Final = (13.44, 22.56, 36.00, 45.08)
SPEEDS_MPS: Final = (0.3, 0.7, 1.0)
FULL_SCALE_N: Final = 510.0
CORNERS: Final = ((0.9, 0.25, 0), (0.9, -0.25, 0), (-0.9, -0.25, 0), (-0.9, 0.25, 0))


@dataclass(frozen=True, slots=True)
class PlateErrors:
    """What is wrong with a plate.

    Attributes
    ----------
    cross_talk
        (measured, true) component, such as (0, 2) for Fz in Fx -> share [1, m or 1/m].
    angle_rad, offset_m
        Plate from camera coordinates: rotation about the vertical, and offset, as
        `compensation.PlateCalibration`.
    delay_s
        How much later the plate is than the cameras.
    curvature
        Vertical force too large by this share at full scale, growing with its square.
    vibration_m, vibration_hz
        Amplitude and frequency of the centre of pressure along the belt, without supports.
    drift_n_per_s
        Of the vertical force within a recording.
    noise_n
        White noise of the forces at 1000 Hz, SD; of the moments, a fifth as many N·m.
    """

    cross_talk: dict[tuple[int, int], float] = field(default_factory=dict)
    angle_rad: float = 0.0
    offset_m: tuple[float, float] = (0.0, 0.0)
    delay_s: float = 0.0
    curvature: float = 0.0
    vibration_m: float = 0.0
    vibration_hz: float = 3.0
    drift_n_per_s: float = 0.0
    noise_n: float = 1.0


THESIS_ERRORS: Final = PlateErrors(
    angle_rad=math.radians(0.19),
    offset_m=(0.0015, -0.0018),
    delay_s=0.004,
    vibration_m=0.015,
    vibration_hz=3.0,
)
"""What van de Loosdrecht (2018) found of the plates: rotation and offset by the static calibration,
delay of the left belt, and a centre of pressure up to 3 cm wide where supports were missing."""


def simulate_plates(
    folder: Path,
    errors: PlateErrors | None = None,
    *,
    seed: int = 0,
    speeds: Sequence[float] = SPEEDS_MPS,
    weights: Sequence[float] = WEIGHTS_KG,
    positions: Sequence[float] = (0.15, 0.25, 0.35),
    profiles: Sequence[str] = ("sine", "square"),
    belts: Sequence[str] = ("left", "right"),
    supports: Sequence[bool] = (True, False),
    marker_noise_m: float = 0.0001,
) -> None:
    """Write a folder with ``plates.toml`` and its recordings for `hbm plates`.

    Parameters
    ----------
    folder
        To write to.
    errors
        Of both plates; by default only noise.
    seed
        Of the noise.
    speeds, weights, positions, profiles, belts, supports
        Of the recordings, in all combinations; positions are from the belt's outer edge [m].
        Supports take three quarters of the vibration away.
    marker_noise_m
        White noise of the cameras at 100 Hz, SD [m].
    """
    folder.mkdir(parents=True, exist_ok=True)
    errors, rng = errors or PlateErrors(), np.random.default_rng(seed)
    lines = ['name = "virtual plates"', 'axes = "left,back,up"']
    lines += [f"center_height_m = {CENTER_M}", f"full_scale_n = {FULL_SCALE_N}", ""]
    for belt in belts:
        _static(folder / f"static_{belt}.c3d", belt, errors, marker_noise_m, rng)
        _hammer(folder / f"hammer_{belt}.c3d", belt, errors, marker_noise_m, rng)
        for part in ("static", "hammer"):
            lines += [f"[[{part}]]", f'file = "{part}_{belt}.c3d"', f'belt = "{belt}"', ""]
    cells = product(belts, speeds, profiles, positions, weights, supports)
    for n, (belt, speed, profile, position, mass, supported) in enumerate(cells):
        name = f"weight_{n + 1:03d}.c3d"
        side = 1 if belt == "left" else -1
        lateral = side * (0.5 - position)
        still = 0.25 if supported else 1.0
        path = _course(speed, profile, lateral)
        _write(
            folder / name, belt, path, mass, errors, marker_noise_m, rng, still * errors.vibration_m
        )
        lines += [
            "[[weights]]",
            f'file = "{name}"',
            f"mass_kg = {mass}",
            f"speed_mps = {speed}",
            f'profile = "{profile}"',
            f"position_m = {position}",
            f'belt = "{belt}"',
            f"supports = {str(supported).lower()}",
            "",
        ]
    (folder / FILE).write_text("\n".join(lines), encoding="utf-8")


def _course(speed: float, profile: str, lateral: float) -> Array:
    """Give the weight's place over time at 1000 Hz, back and forth three times, (N, 3) [m]."""
    rate = FRAME_HZ * PER_FRAME
    if profile == "sine":
        period = TRAVEL_M * np.pi / speed
        time = np.arange(round(3 * period * rate)) / rate
        x = START_M - TRAVEL_M / 2 * (1 - np.cos(2 * np.pi * time / period))
    else:
        half = round(TRAVEL_M / speed * rate)
        wanted = np.tile(np.repeat([-speed, speed], half), 3)
        ramp = round(2 * speed / HARDEST * rate)
        kernel = np.ones(ramp) / ramp
        smooth = np.convolve(np.pad(wanted, ramp, mode="edge"), kernel, mode="same")[ramp:-ramp]
        x = START_M + np.cumsum(gaussian_filter1d(smooth, 20.0, mode="nearest")) / rate
    count = len(x) // PER_FRAME * PER_FRAME
    return np.column_stack([x[:count], np.full(count, lateral), np.full(count, TOP_M)])


def _write(
    path: Path,
    belt: str,
    place: Array,
    mass: float,
    errors: PlateErrors,
    marker_noise_m: float,
    rng: np.random.Generator,
    vibration_m: float,
) -> None:
    rate = FRAME_HZ * PER_FRAME
    acceleration = np.gradient(np.gradient(place, 1 / rate, axis=0), 1 / rate, axis=0)
    force = mass * (acceleration + np.array([0, 0, GRAVITY_MPS2]))
    center = place - [0, 0, TOP_M - CENTER_M]
    wrench = np.hstack([force, np.cross(center, force)])
    time = np.arange(len(place)) / rate
    shake = vibration_m * np.sin(2 * np.pi * errors.vibration_hz * time + rng.uniform(0, 6.3))
    wrench[:, 4] -= wrench[:, 2] * shake
    markers = place[::PER_FRAME, None] + marker_noise_m * rng.normal(size=(len(place) // 10, 1, 3))
    _save(path, belt, markers, "WEIGHT", _measured(wrench, belt, errors, rng))


def _static(
    path: Path, belt: str, errors: PlateErrors, marker_noise_m: float, rng: np.random.Generator
) -> None:
    """Write 55 places of one second each, with a second in the air between them."""
    grid = product(np.linspace(-0.75, 0.75, 11), np.linspace(-0.18, 0.18, 5))
    rate = round(FRAME_HZ * PER_FRAME)
    places, loads = [], []
    last = np.array([-0.75, CENTERS[belt] - 0.18, TOP_M])
    for x, y in grid:
        here = np.array([x, CENTERS[belt] + y, TOP_M])
        s = np.linspace(0, 1, rate)[:, None]
        lifted = last + (here - last) * s + np.array([0, 0, 0.3]) * np.sin(np.pi * s)
        places += [lifted, np.broadcast_to(here, (rate, 3))]
        loads += [np.zeros(rate), np.full(rate, WEIGHTS_KG[1] * GRAVITY_MPS2)]
        last = here
    place, load = np.vstack(places), np.concatenate(loads)
    force = load[:, None] * [0, 0, 1]
    wrench = np.hstack([force, np.cross(place * [1, 1, 0], force)])
    noisy = place[::PER_FRAME, None] + marker_noise_m * rng.normal(size=(len(place) // 10, 1, 3))
    _save(path, belt, noisy, "WEIGHT", _measured(wrench, belt, errors, rng))


def _hammer(
    path: Path, belt: str, errors: PlateErrors, marker_noise_m: float, rng: np.random.Generator
) -> None:
    """Write 15 blows, 2 s apart."""
    rate = FRAME_HZ * PER_FRAME
    time = np.arange(round(33 * rate)) / rate
    hits = 2.0 * np.arange(1, 16) + rng.uniform(-0.3, 0.3, 15)
    away = np.min(np.abs(time[:, None] - hits), axis=1)
    height = 0.05 + np.minimum(away, 0.25)
    since = time[:, None] - hits - errors.delay_s
    load = np.sum(np.where((since >= 0) & (since < 0.006), 1, 0) * 300, axis=1)
    wrench = np.zeros((len(time), 6))
    wrench[:, 2] = load
    noise = errors.noise_n * rng.normal(size=wrench.shape) * ([1] * 3 + [0.2] * 3)
    place = np.column_stack([0 * time, np.full(len(time), CENTERS[belt]), height])[::PER_FRAME]
    seen = place[:, None] + marker_noise_m * rng.normal(size=(len(place), 1, 3))
    _save(path, belt, seen, "HAMMER", wrench + noise)


def _measured(wrench: Array, belt: str, errors: PlateErrors, rng: np.random.Generator) -> Array:
    """Give what a plate makes of a wrench about the cameras' origin, in its own coordinates."""
    time = np.arange(len(wrench)) / (FRAME_HZ * PER_FRAME)
    if errors.delay_s:
        late = time - errors.delay_s
        wrench = np.column_stack([np.interp(late, time, channel) for channel in wrench.T])
    c, s = np.cos(errors.angle_rad), np.sin(errors.angle_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    seen = transform_wrench(wrench, turn, np.array([*errors.offset_m, 0.0]))
    center = np.array([0.0, CENTERS[belt], 0.0])
    seen = shift_wrench(seen, center)  # cells and their errors are about the middle of the plate
    matrix = np.eye(6)
    for (measured, true), share in errors.cross_talk.items():
        matrix[measured, true] += share
    seen = seen @ matrix.T
    seen[:, 2] += errors.curvature * seen[:, 2] ** 2 / FULL_SCALE_N
    seen[:, 2] += errors.drift_n_per_s * time
    seen += errors.noise_n * rng.normal(size=seen.shape) * ([1] * 3 + [0.2] * 3)
    return np.asarray(shift_wrench(seen, -center))


def _save(path: Path, belt: str, position: Array, marker: str, wrench: Array) -> None:
    frames = np.arange(len(position)) / FRAME_HZ
    time = np.arange(len(wrench)) / (FRAME_HZ * PER_FRAME)
    plates = []
    for number, (name, y) in enumerate(CENTERS.items(), start=1):
        center = np.array([0.0, y, 0.0])
        corners = center + np.array(CORNERS)
        own = shift_wrench(wrench if name == belt else 0 * wrench, center)
        plates.append(Plate(number, time, own, np.eye(3), center, corners))
    write_c3d(path, Markers(frames, (marker,), position), plates)
