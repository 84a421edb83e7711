"""The commands of docs/cluster.md run as printed, on a stand-in for SLURM with two nodes."""

import os
import re
import signal

import pytest

from tests.subjects.conftest import ROOT, results

pytestmark = pytest.mark.slow
PAGE = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
(CLUSTER,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("command", BLOCKS, ids=["jobs", "loop", "array"])
def test_every_way_to_run_the_study_leaves_the_same_results(shell, clone, expected, command):
    running = shell(command)
    text, _ = running.communicate()
    assert running.returncode == 0, text
    assert results(clone / "results") == expected, text


def test_dask_workers_from_the_queue_leave_the_same_results(shell, clone, expected):
    pytest.importorskip("dask_jobqueue", reason="the extra 'cluster' is not here")
    (clone / "cluster.py").write_text(CLUSTER, encoding="utf-8")
    cluster = shell("exec python cluster.py")
    try:
        lines = iter(cluster.stdout.readline, "")
        command = next((line for line in lines if line.startswith("hbm run ")), None)
        assert command is not None
        running = shell(command.partition("   (Enter")[0])
        text, _ = running.communicate()
        assert running.returncode == 0, text
        assert re.search("6 trials processed, 0 .*, 0 failed", text)
        cluster.communicate("\n", timeout=60)
        assert cluster.returncode == 0
    finally:
        if cluster.poll() is None:
            os.killpg(cluster.pid, signal.SIGKILL)
    assert results(clone / "results") == expected
