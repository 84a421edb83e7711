"""A trial's key depends on the sources that compute it, and on no others."""

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


def test_editing_what_computes_a_trial_outdates_it_and_editing_a_table_does_not(sources):
    found = [digests(sources)]
    for name in (
        "pipeline/statistics/rm_glm.py",
        "hbm/kernels/descent.c",
        "compensation/inertia/model.py",
        "pipeline/trial/gait/cycles.py",
    ):
        path = sources / name
        path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
        found.append(digests(sources))
    computation, program = map(list, zip(*found, strict=True))
    assert computation[0] == computation[1]
    assert len(set(computation[1:])) == 4
    assert len(set(program)) == 5


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
