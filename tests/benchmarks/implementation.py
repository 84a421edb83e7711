"""An implementation under test, in a process of its own, and timing several of them alternately."""

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


class Implementation:
    """A worker process (`tests.benchmarks.worker`) on the trial in a folder."""

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

    def __enter__(self) -> "Implementation":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()

    def result(self, task: str) -> np.ndarray:
        """Do a task once, untimed, and give its result."""
        path = self.folder / f"result-{self.process.pid}.npy"
        self._ask(task=task, result=str(path))
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
class Timing:
    """Timings of one task; ``overhead`` is another task whose time is subtracted."""

    name: str
    implementation: Implementation
    task: str
    overhead: str | None = None
    repeats: list[dict[str, float]] = field(default_factory=list)

    def repeat(self) -> None:
        seconds = self.implementation.time(self.task)
        if self.overhead:
            overhead = self.implementation.time(self.overhead)
            seconds = {clock: seconds[clock] - overhead[clock] for clock in seconds}
        self.repeats.append(seconds)

    def median(self, clock: str) -> float:
        return median(seconds[clock] for seconds in self.repeats)


def time_alternately(timings: list[Timing], repeats: int) -> None:
    """Time one after the other, repeatedly, so that other load on the machine affects all alike."""
    for _ in range(repeats):
        for timing in timings:
            timing.repeat()


def ratio(slow: Timing, fast: Timing, clock: str) -> float:
    """Give the median over the repeats of the ratio of their times."""
    pairs = zip(slow.repeats, fast.repeats, strict=True)
    return median(a[clock] / b[clock] for a, b in pairs)
