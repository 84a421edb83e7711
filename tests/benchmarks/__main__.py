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

from tests.benchmarks import commands, report, scaling
from tests.benchmarks.accuracy import check_optimum
from tests.benchmarks.races import (
    COMPILED,
    MACHINE,
    contestants,
    dynamics_race,
    kinematics_race,
)
from tests.benchmarks.trial import export_trial, leave_trial
from tests.benchmarks.walker import walk

Found = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)}; default: all"
    )
    parser.add_argument("--json", type=Path, help="where to write what was measured")
    parser.add_argument("--frames", type=int, default=1000, help="frames of the race")
    parser.add_argument("--laps", type=int, default=5, help="turns that everyone takes")
    given = parser.parse_args()
    if unknown := set(given.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    found: Found = {"machine": report.machine()}
    for part in given.parts or PARTS:
        print(f"measuring {part} …", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory() as folder:
            found |= PARTS[part](Path(folder), given.frames, given.laps)
    reached = report.targets(found)
    found["targets"] = [asdict(target) | {"met": target.met} for target in reached]
    if given.json:
        given.json.write_text(json.dumps(found, indent=1, ensure_ascii=False), encoding="utf-8")
    report.show(found, reached)


def races(folder: Path, frames: int, laps: int) -> Found:
    whole = walk(frames)
    trial = leave_trial(folder / "race", whole)
    export_trial(trial, whole)
    with contestants(trial) as running:
        compiled, machine = (running[name].answer("ik") for name in (COMPILED, MACHINE))
        return {
            "ik": kinematics_race(trial, running, laps),
            "id": dynamics_race(trial, running, laps),
            "backends_differ": float(np.abs(compiled - machine).max()),
            "optimum": asdict(check_optimum(trial)),
        }


def whole_processes(folder: Path, frames: int, laps: int) -> Found:
    return {"commands": {"help_s": commands.help_time(), **commands.first_use(folder, frames)}}


PARTS: dict[str, Callable[[Path, int, int], Found]] = {
    "races": races,
    "frames": lambda folder, _, laps: {"frames": scaling.in_frames(folder, laps)},
    "coordinates": lambda folder, _, laps: {"coordinates": scaling.in_coordinates(folder, laps)},
    "gaps": lambda folder, _, laps: {"gaps": scaling.gaps(folder, laps)},
    "commands": whole_processes,
    "memory": lambda folder, *_: {"memory": commands.peak_memory(folder)},
}

if __name__ == "__main__":
    main()
