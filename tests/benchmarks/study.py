"""Time of a whole study, from its simulation to its report, in this version and a former one.

``python -m tests.benchmarks.study [--against COMMIT] [--subjects N] [--jobs N] [--repeats N]``

Whole processes are timed in turn, so that a machine that is shared slows both alike: wall time, and
user and system time of all their processes. Both process what the former version simulated. With
``--demo`` it is ``hbm demo --full`` that is timed.
"""

import argparse
import io
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from tests.benchmarks.implementation import ONE_THREAD, ROOT


@dataclass(frozen=True)
class Version:
    """A version of the program: its name and the folder that its sources are in."""

    name: str
    root: Path


@dataclass(frozen=True)
class Cost:
    """What a command took, all its processes together [s]."""

    wall: float
    user: float
    system: float

    @property
    def cpu(self) -> float:
        return self.user + self.system


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.study", description=__doc__)
    parser.add_argument("--against", metavar="COMMIT", help="former version; default: none")
    parser.add_argument("--subjects", type=int, default=9)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--demo", action="store_true", help="time 'hbm demo --full' instead")
    given = parser.parse_args()
    jobs = ("--jobs", str(given.jobs))
    commands: dict[str, tuple[str, ...]] = {
        "simulate": ("simulate", "STUDY", "--subjects", str(given.subjects), *jobs),
        "run": ("run", "RECORDED", *jobs, "--out", "RESULTS"),
        "report": ("report", "RESULTS"),
    }
    if given.demo:
        commands = {"demo": ("demo", "--full", *jobs, "--out", "STUDY")}
    with tempfile.TemporaryDirectory() as name:
        folder, versions = Path(name), [Version("this version", ROOT)]
        if given.against:
            versions.insert(0, former_version(given.against, folder / "former"))
        for command, arguments in commands.items():
            costs: list[list[Cost]] = [[] for _ in versions]
            for repeat in range(given.repeats):
                for number, version in enumerate(versions):
                    places = {
                        "STUDY": f"study_{number}_{repeat}",
                        "RECORDED": "study_0_0",
                        "RESULTS": f"results_{number}_{repeat}",
                    }
                    placed = [str(folder / places[a]) if a in places else a for a in arguments]
                    costs[number].append(measure(version, placed))
            show(command, versions, costs)


def former_version(commit: str, root: Path) -> Version:
    """Extract the sources of a commit."""
    archive = subprocess.run(
        ["git", "archive", commit], cwd=ROOT, check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as sources:
        sources.extractall(root, filter="data")
    return Version(commit, root)


def measure(version: Version, arguments: list[str]) -> Cost:
    """Run ``hbm`` once and give what it took."""
    before, start = os.times(), time.perf_counter()
    finished = subprocess.run(
        [sys.executable, "-m", "pipeline.cli", *arguments],
        cwd=version.root,
        env=os.environ | ONE_THREAD | {"PYTHONPATH": str(version.root), "CI": "true"},
        capture_output=True,
        text=True,
    )
    wall, after = time.perf_counter() - start, os.times()
    if finished.returncode:
        sys.exit(f"{version.name}: hbm {' '.join(arguments)}: {finished.stdout}{finished.stderr}")
    return Cost(
        wall,
        after.children_user - before.children_user,
        after.children_system - before.children_system,
    )


def show(command: str, versions: list[Version], costs: list[list[Cost]]) -> None:
    """Print the medians of each version, and the ratio to the first one, pair by pair."""
    first = costs[0]
    for version, own in zip(versions, costs, strict=True):
        wall, user, system = (
            median(getattr(c, k) for c in own) for k in ("wall", "user", "system")
        )
        seconds = f"{wall:7.1f} s wall, {user:.1f} s user, {system:.1f} s system"
        line = f"{command:9} {version.name:14} {seconds}"
        if own is not first:
            pairs = list(zip(own, first, strict=True))
            walls, cpus = (
                median(getattr(a, kind) / getattr(b, kind) for a, b in pairs)
                for kind in ("wall", "cpu")
            )
            line += f"; of the former one's {walls:.2f} wall, {cpus:.2f} CPU"
        print(line, flush=True)


if __name__ == "__main__":
    main()
