"""Our time per frame with missing markers."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from hbm.ik.tracking import solve_ik
from tests.benchmarks.implementation import Implementation, Timing, ratio, time_alternately
from tests.benchmarks.trial import Trial, write_trial
from tests.benchmarks.walker import walk, with_dropouts, with_random_gaps

GAP_FRAMES = 8000
ELSEWHERE = 1e-5
"""Distance from the optimum [rad or m] beyond which a solution belongs to another minimum."""
Row = dict[str, float | str]


def gaps(folder: Path, repeats: int, frames: int = GAP_FRAMES) -> list[Row]:
    """Complete markers, 5 % of the samples missing, and whole seconds without a marker."""
    whole = walk(frames)
    cases = {
        "complete": whole.markers,
        "5 % of samples missing": with_random_gaps(whole.markers, 0.05),
        "a marker out for every second": with_dropouts(whole.markers),
    }
    trials = {name: write_trial(folder / name, whole, markers) for name, markers in cases.items()}
    rows = _compare(trials, repeats)
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


def _compare(trials: dict[str, Trial], repeats: int) -> list[Row]:
    """Time ours on several trials of the same length; ratios are to the first."""
    rows: list[Row] = [{"name": name} for name in trials]
    with ExitStack() as stack:
        running = [stack.enter_context(Implementation("ours", t.folder)) for t in trials.values()]
        timings = [Timing(n, c, "ik") for n, c in zip(trials, running, strict=True)]
        time_alternately(timings, repeats)
        for row, timing, trial in zip(rows, timings, trials.values(), strict=True):
            frames = len(trial.markers.time)
            row["ik_frames_per_s"] = frames / timing.median("wall")
            row["ik_cpu_us"] = 1e6 * timing.median("cpu") / frames
            row["ik_cpu_ratio"] = ratio(timing, timings[0], "cpu")
    return rows
