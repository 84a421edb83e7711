"""One trial from its file to its residuals; prints peak memory and number of solved frames.

``python -m tests.benchmarks.long_trial TRIAL STATIC``
"""

import sys
from pathlib import Path

import numpy as np

from pipeline.config.schema import Settings, Subject
from pipeline.io.c3d.read import read_c3d
from pipeline.trial.process import process_recording
from tests.synthetic import MASS_KG


def main(trial: str, static: str) -> None:
    subject = Subject(sex="male", mass_kg=MASS_KG)
    result = process_recording(read_c3d(trial), subject, Settings(), static=read_c3d(static))
    residual = result.measured.residual
    print(peak_bytes(), np.isfinite(residual).all(axis=1).sum())


def peak_bytes() -> int:
    """Give this process' peak resident memory, without that of its parent process."""
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


if __name__ == "__main__":
    main(*sys.argv[1:])
