"""Which sources a trial's key depends on: those that compute it, and no others."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.run.program import COMPUTATION, ROOT, computation_digest, program_digest


@pytest.fixture
def sources(tmp_path):
    """A copy of the program's sources."""
    for package in ("hbm", "compensation", "pipeline"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=ignored)
    return tmp_path


def digests(root):
    computation_digest.cache_clear()
    program_digest.cache_clear()
    return computation_digest(root), program_digest(root)


def edit(path):
    path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    "name",
    [
        "pipeline/report/write.py",
        "pipeline/run/run.py",
        "pipeline/statistics/rm_glm.py",
    ],
)
def test_editing_a_figure_or_the_viewer_outdates_no_trial(sources, name):
    before = digests(sources)
    edit(sources / name)
    after = digests(sources)
    assert after[0] == before[0]
    assert after[1] != before[1]


@pytest.mark.parametrize(
    "name",
    [
        "hbm/kinematics.py",
        "hbm/kernels/descent.c",
        "compensation/inertia/model.py",
        "pipeline/trial/process.py",
        "pipeline/trial/gait/cycles.py",
    ],
)
def test_editing_what_computes_a_trial_outdates_it(sources, name):
    before = digests(sources)
    edit(sources / name)
    after = digests(sources)
    assert after[0] != before[0]
    assert after[1] != before[1]


def test_what_processes_a_trial_imports_nothing_that_its_key_leaves_out():
    code = (
        "import sys, pipeline.trial.process, pipeline.trial.result\n"
        "for name, module in sorted(sys.modules.items()):\n"
        "    if name.split('.')[0] in ('hbm', 'compensation', 'pipeline'): print(module.__file__)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    files = [Path(line).resolve().relative_to(ROOT) for line in answer.stdout.splitlines()]
    folders = [Path(folder) for folder in COMPUTATION]
    others = [f for f in files if not any(f.is_relative_to(folder) for folder in folders)]
    design = [Path("pipeline/statistics") / name for name in ("__init__.py", "design.py")]
    assert others == [Path("pipeline/__init__.py"), *design]  # how trials are compared, which
    # is stated in study.toml and changes none of them
