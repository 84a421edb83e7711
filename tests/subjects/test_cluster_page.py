"""The commands of docs/cluster.md, as printed, with a stand-in for SLURM: all results are equal."""

import re

import pytest

from tests.subjects.conftest import ROOT, results

pytestmark = pytest.mark.slow
PAGE = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("command", BLOCKS, ids=["jobs", "loop", "array"])
def test_every_way_to_run_the_study_leaves_the_same_results(shell, clone, expected, command):
    running = shell(command)
    text, _ = running.communicate()
    assert running.returncode == 0, text
    assert results(clone / "results") == expected, text
