"""Our time per frame by length of the trial, by coordinates, and with missing markers."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from hbm.coordinates import MOVING
from hbm.kinematics import solve_ik
from hbm.markers import Markers
from tests.benchmarks.implementation import Implementation, Timing, ratio, time_alternately
from tests.benchmarks.trial import Trial, write_trial
from tests.benchmarks.walker import walk, with_dropouts, with_random_gaps
from tests.synthetic import synthetic_body

FRAMES = (1000, 6000, 30000, 72000)
GAP_FRAMES = 8000
ELSEWHERE = 1e-5
"""Distance from the optimum [rad or m] beyond which a solution belongs to another minimum."""
LEG = ("thigh", "shank", "foot")
LEGS = ("pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in LEG))
COORDINATES = {"whole body": MOVING, "legs and trunk": (*LEGS, "thorax"), "legs": LEGS}
Row = dict[str, float | str]


def in_frames(folder: Path, repeats: int, frames: tuple[int, ...] = FRAMES) -> list[Row]:
    longest = walk(max(frames))
    trials = {f"{n} frames": write_trial(folder / str(n), longest.first(n)) for n in frames}
    return _compare(trials, repeats, ("ik", "id"))


def in_coordinates(folder: Path, repeats: int, frames: int = GAP_FRAMES) -> list[Row]:
    """Fewer markers observe fewer coordinates; the others are locked."""
    whole = walk(frames)
    trials = {
        name: write_trial(folder / name, whole, on_segments(whole.markers, segments))
        for name, segments in COORDINATES.items()
    }
    rows = _compare(trials, repeats, ("ik",))
    for row, trial in zip(rows, trials.values(), strict=True):
        row["markers"] = len(trial.markers.names)
        row["coordinates"] = int(trial.optimum.observed.any(axis=0).sum())
    return rows


def gaps(folder: Path, repeats: int, frames: int = GAP_FRAMES) -> list[Row]:
    """Complete markers, 5 % of the samples missing, and whole seconds without a marker."""
    whole = walk(frames)
    cases = {
        "complete": whole.markers,
        "5 % of samples missing": with_random_gaps(whole.markers, 0.05),
        "a marker out for every second": with_dropouts(whole.markers),
    }
    trials = {name: write_trial(folder / name, whole, markers) for name, markers in cases.items()}
    rows = _compare(trials, repeats, ("ik",))
    for row, trial in zip(rows, trials.values(), strict=True):
        row |= solved_share(trial)
    return rows


def solved_share(trial: Trial) -> Row:
    """Count the frames that were solved and those marked as unsolved; there may be no others.

    Of the solved ones, count those in another minimum than the solution of tight tolerance: a
    forearm without wrist markers may be rotated either way.
    """
    motion = solve_ik(trial.body, trial.markers)
    marked = ~motion.converged & np.isnan(motion.q).all(axis=1)
    elsewhere = trial.from_optimum(motion.q) > ELSEWHERE
    return {
        "frames": len(motion.time),
        "solved": int(motion.converged.sum()),
        "marked": int(marked.sum()),
        "elsewhere": int(elsewhere.any(axis=1).sum()),
    }


def on_segments(markers: Markers, segments: tuple[str, ...]) -> Markers:
    body = synthetic_body()
    columns = [k for k, segment in enumerate(body.marker_segment) if segment in segments]
    names = tuple(body.markers[k] for k in columns)
    return Markers(markers.time, names, markers.position[:, columns])


def _compare(trials: dict[str, Trial], repeats: int, tasks: tuple[str, ...]) -> list[Row]:
    """Time ours on several trials; ratios are to the first, per frame."""
    rows: list[Row] = [{"name": name} for name in trials]
    with ExitStack() as stack:
        running = [stack.enter_context(Implementation("ours", t.folder)) for t in trials.values()]
        for task in tasks:
            timings = [Timing(n, c, task) for n, c in zip(trials, running, strict=True)]
            time_alternately(timings, repeats)
            for row, timing, trial in zip(rows, timings, trials.values(), strict=True):
                frames = len(trial.markers.time)
                share = len(next(iter(trials.values())).markers.time) / frames
                row[f"{task}_frames_per_s"] = frames / timing.median("wall")
                row[f"{task}_cpu_us"] = 1e6 * timing.median("cpu") / frames
                row[f"{task}_cpu_ratio"] = ratio(timing, timings[0], "cpu") * share
    return rows
