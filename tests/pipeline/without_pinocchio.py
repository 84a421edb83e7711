"""The same trial with and without Pinocchio, each in a process of its own."""

import os
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.run.store import read_trial
from pipeline.trial.residuals import residual_table

BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "pinocchio":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
"""
COMMAND = "import sys; from pipeline.cli.app import main; raise SystemExit(main(sys.argv[1:]))"
AGREEMENT = 1e-8


def assert_only_the_engine_differs(trial, folder):
    """Run ``hbm residuals`` without compiled kernels, with Pinocchio and with its import blocked.

    The results name the engine and agree in all else.
    """
    pytest.importorskip("pinocchio", reason="Pinocchio has no wheel for this system")
    found = []
    for name, code in (("with", COMMAND), ("without", BLOCKED + COMMAND)):
        words = ["residuals", str(trial), "--out", str(folder / name)]
        done = subprocess.run(
            [sys.executable, "-c", code, *words],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"HBM_KERNELS": "virtual-machine"},
        )
        assert done.returncode == 0, done.stderr
        path = folder / name / f"{trial.stem}.parquet"
        found.append((read_trial(path), pq.read_table(path)))
    with_it, without = found
    for (result, _), engine in ((with_it, "Pinocchio"), (without, "kernels")):
        assert result.engine.startswith(engine)
    one, other = (residual_table(result, "walk") for result, _ in (with_it, without))
    for column in ("rms", "peak"):
        assert other[column].to_numpy() == pytest.approx(one[column].to_numpy(), rel=AGREEMENT)
    frames, again = with_it[1], without[1]
    assert frames.column_names == again.column_names
    for column in frames.column_names:
        values, others = (table.column(column).to_numpy() for table in (frames, again))
        if column.startswith(("tau.", "residual.")):
            size = np.nanmax(np.abs(values))
            np.testing.assert_allclose(others, values, rtol=0, atol=AGREEMENT * size)
        else:
            np.testing.assert_array_equal(others, values)
