"""Whole processes: response time of the command line, long trials and studies of many trials."""

import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from hbm.spatial import Array
from pipeline.io.recording import Analog, Plate
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.benchmarks.implementation import ONE_THREAD, ROOT
from tests.benchmarks.walker import Walk, walk
from tests.synthetic import MASS_KG, synthetic_t_pose

HELP_RUNS = 5
LONG_FRAMES = 72000
PLATE_HZ = 1000
OTHER_CHANNELS = 18
STUDY_FRAMES = 408
PERSON = """\
id = "s{number:05}"
sex = "male"
mass_kg = {mass_kg}
static = "s{number:05}_static.c3d"
[trials.level]
file = "s{number:05}_walk.c3d"
"""
CORNERS = ((0.85, -0.25, 0), (-0.85, -0.25, 0), (-0.85, 0.25, 0), (0.85, 0.25, 0))
Row = dict[str, float | str]


def help_time() -> float:
    """Give the median wall time of ``hbm --help`` [s]."""
    return median(_measured("--help")[0] for _ in range(HELP_RUNS))


def residuals_time(folder: Path, frames: int) -> Row:
    """Time ``hbm residuals`` on a trial [s], with the largest resident memory [bytes]."""
    write_trial(walk(frames), folder / "trial.c3d")
    write_c3d(folder / "static.c3d", synthetic_t_pose())
    command = ("residuals", folder / "trial.c3d", "--static", folder / "static.c3d")
    seconds, peak = _measured(*command, "--mass-kg", MASS_KG, "--out", folder / "results")
    return {"frames": frames, "residuals_s": seconds, "peak_bytes": peak}


def study_times(folder: Path, trials: int) -> list[Row]:
    """Time check, run and report of a study, with a subject for each trial of 408 frames."""
    study, results = folder / "study", folder / "results"
    study.mkdir()
    whole, pose = walk(STUDY_FRAMES), synthetic_t_pose()
    (study / "study.toml").write_text("[conditions.level]\n")
    for number in range(trials):
        # a recording is of one subject: each has its own, moved by 10 µm against the last one
        of_one, static = (
            replace(markers, position=markers.position + 1e-5 * number)
            for markers in (whole.markers, pose)
        )
        write_trial(replace(whole, markers=of_one), study / f"s{number:05}_walk.c3d")
        write_c3d(study / f"s{number:05}_static.c3d", static)
        (study / f"s{number:05}.toml").write_text(PERSON.format(number=number, mass_kg=MASS_KG))
    cores = os.cpu_count() or 1
    commands = {
        "check": ("check", study),
        "run": ("run", study, "--jobs", cores, "--out", results),
        "report": ("report", results),
    }
    rows: list[Row] = []
    for name, command in commands.items():
        seconds, peak = _measured(*command)
        size = sum(path.stat().st_size for path in results.rglob("*") if path.is_file())
        rows.append(
            {"command": name, "trials": trials, "s": seconds}
            | {"trials_per_s_and_core": trials / seconds / cores}
            | {"peak_mb": peak / 1e6, "results_mb": size / 1e6}
        )
    return rows


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


def _measured(*arguments: object) -> tuple[float, int]:
    """Run ``hbm``; give its time [s] and its largest resident memory [bytes], as Linux counts."""
    command = [sys.executable, "-m", "pipeline.cli", *map(str, arguments)]
    start = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, cwd=ROOT, env=os.environ | ONE_THREAD
    )
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    return seconds, 1024 * usage.ru_maxrss
