"""Whole processes: response time of the command line, time and memory of a long trial."""

import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

import numpy as np

from hbm.spatial import Array
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Analog, Plate
from tests.benchmarks.implementation import ONE_THREAD, ROOT
from tests.benchmarks.walker import Walk, walk
from tests.synthetic import MASS_KG, synthetic_t_pose

HELP_RUNS = 5
LONG_FRAMES = 72000
PLATE_HZ = 1000
OTHER_CHANNELS = 18
CORNERS = ((0.85, -0.25, 0), (-0.85, -0.25, 0), (-0.85, 0.25, 0), (0.85, 0.25, 0))
Row = dict[str, float | str]


def help_time() -> float:
    """Give the median wall time of ``hbm --help`` [s]."""
    return median(_seconds("-m", "pipeline.cli", "--help") for _ in range(HELP_RUNS))


def residuals_time(folder: Path, frames: int) -> Row:
    """Time ``hbm residuals`` on a short trial [s]."""
    write_trial(walk(frames), folder / "trial.c3d")
    write_c3d(folder / "static.c3d", synthetic_t_pose())
    command = ("-m", "pipeline.cli", "residuals", str(folder / "trial.c3d"))
    command += ("--static", str(folder / "static.c3d"), "--mass-kg", str(MASS_KG))
    command += ("--out", str(folder / "results"))
    return {"frames": frames, "residuals_s": _seconds(*command)}


def peak_memory(folder: Path, frames: int = LONG_FRAMES) -> Row:
    """Give the largest resident memory [bytes] from C3D file to residuals, and its time [s]."""
    write_trial(walk(frames), folder / "long.c3d")
    write_c3d(folder / "static.c3d", synthetic_t_pose())
    start = time.perf_counter()
    script = ("-m", "tests.benchmarks.long_trial", str(folder / "long.c3d"))
    printed = _run(*script, str(folder / "static.c3d")).stdout
    peak, solved = map(int, printed.split())
    elapsed = time.perf_counter() - start
    return {"frames": frames, "solved": solved, "peak_bytes": peak, "seconds": elapsed}


def write_trial(trial: Walk, path: Path) -> None:
    """Write markers, plates and other channels: 30 channels at 1000 Hz in all."""
    per_frame = round(PLATE_HZ / trial.markers.rate_hz)
    plate_time = np.arange(per_frame * len(trial.time)) / PLATE_HZ
    plates = [
        _plate(k, plate_time, _interpolated(plate_time, trial.time, wrench))
        for k, wrench in enumerate(trial.wrenches.values(), 1)
    ]
    names = tuple(f"Sensor.{k}" for k in range(OTHER_CHANNELS))
    noise = np.random.default_rng(4).normal(size=(len(plate_time), OTHER_CHANNELS))
    analog = Analog(plate_time, names, ("V",) * OTHER_CHANNELS, noise)
    write_c3d(path, trial.markers, plates, analog=analog)


def _plate(number: int, plate_time: Array, wrench: Array) -> Plate:
    """Give a plate centred on the lab origin whose z axis points down, as most do."""
    down = np.diag([1.0, -1.0, -1.0])
    in_plate = np.hstack([wrench[:, :3] @ down, wrench[:, 3:] @ down])
    return Plate(number, plate_time, in_plate, down, np.zeros(3), np.array(CORNERS))


def _interpolated(at: Array, known: Array, values: Array) -> Array:
    return np.column_stack([np.interp(at, known, column) for column in values.T])


def _seconds(*arguments: str) -> float:
    start = time.perf_counter()
    _run(*arguments)
    return time.perf_counter() - start


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | ONE_THREAD,
    )
