"""Measure, print tables, write JSON: ``python -m tests.benchmarks [PART …] [--json PATH]``."""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks import commands, events, live, report, start
from tests.benchmarks.accuracy import check_optimum
from tests.benchmarks.commands import LONG_FRAMES
from tests.benchmarks.comparison import (
    COMPILED,
    MACHINE,
    compare_dynamics,
    compare_kinematics,
    implementations,
)
from tests.benchmarks.trial import export_trial, write_trial
from tests.benchmarks.walker import walk
from tests.tables import command, described

Measured = dict[str, Any]


def main() -> None:
    parts = described("parts", {name: line for name, (line, _) in PARTS.items()})
    parser = command("tests.benchmarks", __doc__, parts)
    parser.add_argument("parts", nargs="*", metavar="PART", help="parts; default: all")
    parser.add_argument("--json", type=Path, help="file for the measurements")
    parser.add_argument("--csv", type=Path, help="file for the table of gait events")
    parser.add_argument("--frames", type=int, default=1000, help="frames of the compared trial")
    parser.add_argument("--repeats", type=int, default=5, help="timings per implementation")
    parser.add_argument("--trials", type=int, default=400, help="trials of the study")
    given = parser.parse_args()
    if unknown := set(given.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    measured: Measured = {"machine": report.machine()}
    for part in given.parts or PARTS:
        print(f"measuring {part} …", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory() as folder:
            measured |= PARTS[part][1](Path(folder), given)
    targets = report.targets(measured)
    measured["targets"] = [asdict(target) | {"met": target.met} for target in targets]
    if given.json:
        given.json.write_text(json.dumps(measured, indent=1, ensure_ascii=False), encoding="utf-8")
    if given.csv and "events" in measured:
        events.write_table(measured["events"], given.csv)
    report.show(measured, targets)


def compare(folder: Path, given: argparse.Namespace) -> Measured:
    whole = walk(given.frames)
    trial = write_trial(folder / "compared", whole)
    export_trial(trial, whole)
    with implementations(trial) as running:
        compiled, machine = (running[name].result("ik") for name in (COMPILED, MACHINE))
        return {
            "ik": compare_kinematics(trial, running, given.repeats),
            "id": compare_dynamics(trial, running, given.repeats),
            "backends_differ": float(np.abs(compiled - machine).max()),
            "optimum": asdict(check_optimum(trial)),
        }


def whole_processes(folder: Path, given: argparse.Namespace) -> Measured:
    residuals = commands.residuals_time(folder, given.frames)
    return {"commands": {"help_s": commands.help_time(), **residuals}}


PARTS: dict[str, tuple[str, Callable[[Path, argparse.Namespace], Measured]]] = {
    "compare": ("kinematics and dynamics beside other programs (1 min)", compare),
    "commands": ("response of the command line, and one trial (5 s)", whole_processes),
    "events": (
        "gait events of simulated walkers beside other methods (1 min)",
        lambda folder, *_: events.race(folder),
    ),
    "live": ("frames of the live chain (5 min)", lambda folder, *_: live.live_frames(folder)),
    "study": (
        "check, run and report of a study of --trials (10 min for 400)",
        lambda folder, given: {"study": commands.study_times(folder, given.trials)},
    ),
    "start": (
        "what a process loads before its first frame (1 min)",
        lambda folder, given: {"start": start.start_times(folder, given.repeats)},
    ),
    "memory": (
        "time and memory of a trial of 72,000 frames (1 min)",
        lambda folder, *_: {"memory": commands.residuals_time(folder, LONG_FRAMES)},
    ),
}

if __name__ == "__main__":
    main()
