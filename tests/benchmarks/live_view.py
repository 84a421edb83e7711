"""What a live view takes of the program that shows it, of its own processes, and of memory.

``python -m tests.benchmarks.live_view [SECONDS [RATE_HZ]]``; drawn unseen, without a graphics card.
"""

import sys
import time
from dataclasses import replace

import numpy as np
import psutil

from pipeline.viewer.live import LiveScene, LiveView
from tests.pipeline.viewer_frames import shown_frames
from tests.pipeline.viewer_trial import viewer_trial

SECONDS, RATE_HZ = 30.0, 100.0
FRAMES = 1000
MAX_START_S = 60


def main(seconds: float, rate_hz: float) -> None:
    trial = viewer_trial(FRAMES)
    frames = shown_frames(trial)
    start = time.perf_counter()
    names, variants = trial.markers.names, list(trial.ground)
    view = LiveView(LiveScene(trial.body, trial.plates, names, variants, "none"))
    try:
        view.wait(MAX_START_S)
        print(f"start: {time.perf_counter() - start:.1f} s {view.fault or ''}")
        drawing = psutil.Process(view.process_id)
        processes = {
            "program": psutil.Process(),
            "drawing": drawing,
            "viewer": drawing.children()[0],
        }
        before = {name: used(process) for name, process in processes.items()}
        wall, cpu = show_for(view, frames, seconds, rate_hz).T * 1e6
        print(
            f"{len(wall)} frames at {rate_hz:g} Hz: show() takes {np.mean(wall):.0f} µs "
            f"(CPU {np.mean(cpu):.0f} µs), 99.9 % below {np.percentile(wall, 99.9):.0f} µs; "
            f"left out: {view.left_out}"
        )
        for name, process in processes.items():
            cpu = (used(process) - before[name]) / seconds
            memory = process.memory_info().rss / 1e6
            print(f"{name}: {cpu * 100:.0f} % of a core, {memory:.0f} MB")
    finally:
        view.close()


def used(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


def show_for(view: LiveView, frames: list, seconds: float, rate_hz: float) -> np.ndarray:
    """Show frames at their rate and give each call's time and CPU time, (T, 2) [s]."""
    costs, start = [], time.perf_counter()
    for k in range(round(seconds * rate_hz)):
        time.sleep(max(0.0, start + k / rate_hz - time.perf_counter()))
        frame = replace(frames[k % len(frames)], time=k / 100)
        before = time.perf_counter(), time.thread_time()
        view.show(frame)
        costs.append((time.perf_counter() - before[0], time.thread_time() - before[1]))
    return np.array(costs)


if __name__ == "__main__":
    given = [float(argument) for argument in sys.argv[1:3]]
    main(*given, *(SECONDS, RATE_HZ)[len(given) :])
