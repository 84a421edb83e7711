"""The near end of a worker: start it, tell it what to do, take its answer."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)


class Contestant:
    """A worker on the trial that lies in a folder."""

    def __init__(self, module: str, folder: Path, **environment: str) -> None:
        self.folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.worker", module, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=os.environ | ONE_THREAD | environment,
        )
        self._reply()

    def __enter__(self) -> "Contestant":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()

    def answer(self, task: str) -> np.ndarray:
        """Do a task once, untimed, and give what came out."""
        path = self.folder / f"answer-{self.process.pid}.npy"
        self._ask(task=task, answer=str(path))
        value = np.load(path)
        path.unlink()
        return value

    def time(self, task: str) -> dict[str, float]:
        """Give wall, CPU and user CPU time of a task [s]."""
        return self._ask(task=task)

    def _ask(self, **request: str) -> dict[str, float]:
        print(json.dumps(request), file=self.process.stdin, flush=True)
        return self._reply()

    def _reply(self) -> dict[str, float]:
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"the worker ended with {self.process.wait()}: {self.process.args}")
        return json.loads(line)


@dataclass
class Entry:
    """A task of a contestant in a race; ``less`` is a task of its own whose time is taken off."""

    name: str
    contestant: Contestant
    task: str
    less: str | None = None
    laps: list[dict[str, float]] = field(default_factory=list)

    def lap(self) -> None:
        lap = self.contestant.time(self.task)
        if self.less:
            off = self.contestant.time(self.less)
            lap = {clock: lap[clock] - off[clock] for clock in lap}
        self.laps.append(lap)

    def median(self, clock: str) -> float:
        return median(lap[clock] for lap in self.laps)


def race(entries: list[Entry], laps: int) -> None:
    """Let everyone take turns, so that what the machine does meanwhile hits all alike."""
    for _ in range(laps):
        for entry in entries:
            entry.lap()


def ratio(slow: Entry, fast: Entry, clock: str) -> float:
    """Median over the laps of how many times longer one took than the other."""
    pairs = zip(slow.laps, fast.laps, strict=True)
    return median(a[clock] / b[clock] for a, b in pairs)
