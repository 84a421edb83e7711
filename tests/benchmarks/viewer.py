"""Time, memory and file size of writing a twelve-minute trial for the viewer.

``python -m tests.benchmarks.viewer [FRAMES]``
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

from pipeline.viewer.trial import write_recording
from tests.pipeline.viewer_trial import viewer_trial

FRAMES = 72000


def main(frames: int) -> None:
    result = viewer_trial(frames)
    memory_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as folder:
        for view_hz in (50.0, 100.0):
            path = Path(folder) / f"{view_hz}.rrd"
            start, spent = time.perf_counter(), time.process_time()
            write_recording(result, path, view_hz=view_hz)
            wall, cpu = time.perf_counter() - start, time.process_time() - spent
            cost = f"{wall:.2f} s (CPU {cpu:.2f} s), {path.stat().st_size / 1e6:.1f} MB"
            print(f"{frames} frames, scene at {view_hz:g} Hz: {cost}")
    memory_after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"peak memory {memory_after / 1e6:.2f} GB; before writing {memory_before / 1e6:.2f} GB")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else FRAMES)
