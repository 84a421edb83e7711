"""One implementation in a process of its own: it does tasks on request and reports their time.

OpenSim and casadi cannot share a process, and an idle implementation must not disturb the one that
is timed. ``python -m tests.benchmarks.worker MODULE FOLDER`` reads requests, one JSON object per
line, and answers each with one line. Whatever else an implementation prints is dropped.
"""

import importlib
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

MIN_TIMED_S = 0.5


def main(module: str, folder: Path) -> None:
    replies = os.fdopen(os.dup(1), "w", buffering=1)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    pin_to_one_core()
    tasks = importlib.import_module(f"tests.benchmarks.{module}").tasks(folder)
    print("{}", file=replies)
    for line in sys.stdin:
        request = json.loads(line)
        task = tasks[request["task"]]
        if "result" in request:
            np.save(request["result"], task())
            print("{}", file=replies)
        else:
            print(json.dumps(timed(task)), file=replies)


def pin_to_one_core() -> None:
    """Run on the last allowed core only, where the system supports that."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(task) -> dict[str, float]:
    """Repeat a task for at least half a second and give the seconds per repetition."""
    start = clocks()
    times = 0
    while not times or time.perf_counter() - start[0] < MIN_TIMED_S:
        task()
        times += 1
    wall, cpu, user = ((b - a) / times for a, b in zip(start, clocks(), strict=True))
    return {"wall": wall, "cpu": cpu, "user": user}


def clocks() -> tuple[float, float, float]:
    return time.perf_counter(), time.process_time(), os.times().user


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
