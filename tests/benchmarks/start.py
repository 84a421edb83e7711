"""Processor time of commands from their start: help, what a folder is, one trial."""

import os
import resource
import subprocess
import sys
from pathlib import Path

from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.benchmarks.implementation import ONE_THREAD, ROOT

PEER = "import numpy, pandas"
DRAWING = """
import sys, time
from pipeline.cli.app import main

class Drawing:
    def find_spec(self, name, *_):
        if name == "matplotlib":
            sys.meta_path.remove(self)
            print(time.process_time(), file=sys.stderr)

sys.meta_path.insert(0, Drawing())
sys.exit(main())
"""
"""Runs ``hbm``, and prints the processor time when all is printed and drawing begins."""
Row = dict[str, float | str]


def start_times(folder: Path, repeats: int) -> list[Row]:
    """Give the least processor time of each command [s], all measured in turn.

    Also as a multiple of the time to load NumPy and pandas.
    """
    simulate_trial(folder / "walk.c3d", duration_s=12.0)
    residuals = ("residuals", folder / "walk.c3d", "--sex", "male", "--out", folder / "results")
    commands = {
        PEER: ("-c", PEER),
        "hbm --help": ("-m", "pipeline.cli", "--help"),
        "hbm --version": ("-m", "pipeline.cli", "--version"),
        "hbm FOLDER": ("-m", "pipeline.cli", folder),
        "hbm residuals": ("-c", DRAWING, *residuals),
    }
    least = dict.fromkeys((*commands, "hbm residuals, table"), float("inf"))
    # modules are compiled before: as where the package has been installed
    environment = os.environ | ONE_THREAD | {"PYTHONPYCACHEPREFIX": str(folder / "compiled")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    for _ in range(1 + repeats):
        for name, arguments in commands.items():
            before = _children_s()
            command = [sys.executable, *map(str, arguments)]
            done = subprocess.run(
                command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
            )
            least[name] = min(least[name], _children_s() - before)
            if DRAWING in arguments:
                table_s = float(done.stderr.split()[-1])
                least["hbm residuals, table"] = min(least["hbm residuals, table"], table_s)
    return [
        {"name": name, "cpu_s": seconds, "cpu_ratio": seconds / least[PEER]}
        for name, seconds in least.items()
    ]


def _children_s() -> float:
    """Give the processor time of all processes that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
