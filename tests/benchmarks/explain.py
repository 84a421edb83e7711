"""What explaining a trial costs beside processing it, in seconds of one core.

``python -m tests.benchmarks.explain [--repeats N]``

A simulated walk of 12 s and one of 12 min on a platform that stands still. Both times are of this
process alone, with one thread of linear algebra, in the same run, so that machines compare.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from threadpoolctl import threadpool_limits

import pipeline
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.explain.explain import explain_trial
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial

DURATIONS_S: Final = {"12 s": 12.0, "12 min": 720.0}
LIMITS_S: Final = {"12 s": 5.0, "12 min": 30.0}
"""Beyond the run itself."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.explain", description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    print("| trial | process | explain | explain / process | goal of explain |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        for name, duration_s in DURATIONS_S.items():
            path = Path(folder) / f"{duration_s:g}.c3d"
            simulate_trial(str(path), duration_s=duration_s)
            processing, explaining = costs(path, repeats)
            print(
                f"| {name} | {processing:.2f} s | {explaining:.2f} s | "
                f"{explaining / processing:.1f} | < {LIMITS_S[name]:g} s |"
            )


def costs(path: Path, repeats: int) -> tuple[float, float]:
    """Give the least of the processor times of processing and of explaining a trial [s]."""
    recording, subject = pipeline.read_c3d(path), Subject(sex="male")
    result = pipeline.process_recording(recording, subject, Settings())  # with compiled kernels

    def process() -> object:
        return pipeline.process_recording(pipeline.read_c3d(path), subject, Settings())

    def explain() -> object:
        return explain_trial(recording, Laboratory(Treadmill()), result)

    return least(process, repeats), least(explain, repeats)


def least(work: Callable[[], object], repeats: int) -> float:
    """Give the least processor time of some repetitions [s]."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


if __name__ == "__main__":
    main()
