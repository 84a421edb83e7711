"""One contestant in a process of its own: it does a task when told to, and says how long it took.

OpenSim and casadi cannot live in one process, and a contestant that waits must not disturb the one
that works. ``python -m tests.benchmarks.worker MODULE FOLDER`` reads requests, one JSON object a
line, and answers each with one line. All that a contestant prints otherwise is dropped.
"""

import importlib
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

SECONDS = 0.5


def main(module: str, folder: Path) -> None:
    replies = os.fdopen(os.dup(1), "w", buffering=1)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    pin_to_one_core()
    tasks = importlib.import_module(f"tests.benchmarks.{module}").tasks(folder)
    print("{}", file=replies)
    for line in sys.stdin:
        request = json.loads(line)
        task = tasks[request["task"]]
        if "answer" in request:
            np.save(request["answer"], task())
            print("{}", file=replies)
        else:
            print(json.dumps(timed(task)), file=replies)


def pin_to_one_core() -> None:
    """Stay on the last core that is allowed, where the system can do that."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(task) -> dict[str, float]:
    """Do a task for half a second at least; seconds per time."""
    start = clocks()
    times = 0
    while not times or time.perf_counter() - start[0] < SECONDS:
        task()
        times += 1
    wall, cpu, user = ((b - a) / times for a, b in zip(start, clocks(), strict=True))
    return {"wall": wall, "cpu": cpu, "user": user}


def clocks() -> tuple[float, float, float]:
    return time.perf_counter(), time.process_time(), os.times().user


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
