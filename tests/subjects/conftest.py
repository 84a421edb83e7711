"""A folder in which the scripts and the pages' commands run: `subjects` holds a small study."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from compensation import to_json
from pipeline.config.study import read_study
from pipeline.run.run import run_study
from pipeline.trial.study_files import read_study_laboratory
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

ROOT = Path(__file__).resolve().parents[2]
SUBJECTS = ROOT / "subjects"
SMALL = Protocol(
    subjects=2,
    baseline_s=15.0,
    pitch_s=15.0,
    waits_s=(12.0,),
    calibration="square_sway_60s_3mps",
    beside_s=12.0,
)
SBATCH = """\
#!/usr/bin/env bash
# As SLURM: runs the command of an array for every subject, or a script in the background; it has
# room for two scripts, others wait for ever.
case $1 in
  --array=*)
    for task in 1 2; do SLURM_ARRAY_TASK_ID=$task sh -c "${!#}" || exit; done ;;
  *)
    setsid bash "$1" >"worker.$$" 2>&1 &
    job=$!
    [ "$(ls worker.* | wc -l)" -le 2 ] || kill "$job"
    echo "Submitted batch job $job" ;;
esac
"""
SCANCEL = '#!/bin/sh\nfor job; do kill -- -"$job" 2>/dev/null; done\nexit 0\n'


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    """Folder of a small virtual study, whose calibration no process has to fit anew."""
    folder = simulate_study(tmp_path_factory.mktemp("study") / "subjects", Setting(protocol=SMALL))
    fitted = read_study_laboratory(read_study(folder)).calibration
    (folder / "lab.json").write_text(to_json(fitted), encoding="utf-8")
    file = folder / "study.toml"
    stated = re.compile(r"^calibration = .*?(?=^\[)", re.DOTALL | re.MULTILINE)
    text, count = stated.subn('calibration = "lab.json"\n', file.read_text(encoding="utf-8"))
    assert count == 1
    file.write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def expected(study, tmp_path_factory):
    """What `hbm run` makes of it: name -> content of every result."""
    out = tmp_path_factory.mktemp("results")
    assert all(outcome.state == "done" for outcome in run_study(read_study(study), out))
    return results(out)


@pytest.fixture
def clone(study, tmp_path):
    """A folder like a clone of the repository, whose `subjects` holds the small study."""
    shutil.copytree(study, tmp_path / "subjects")
    for script in SUBJECTS.glob("*.py"):
        shutil.copy(script, tmp_path / "subjects")
    return tmp_path


@pytest.fixture
def shell(clone, tmp_path_factory):
    """Give a function that starts shell commands there, with a stand-in for SLURM."""
    if os.name == "nt":
        pytest.skip("commands for Unix shells")
    programs = tmp_path_factory.mktemp("bin")
    for name, text in {
        "hbm": f'#!/bin/sh\nexec "{sys.executable}" -m pipeline.cli "$@"\n',
        "python": f'#!/bin/sh\nexec "{sys.executable}" "$@"\n',
        "sbatch": SBATCH,
        "scancel": SCANCEL,
    }.items():
        (programs / name).write_text(text, encoding="utf-8")
        (programs / name).chmod(0o755)
    paths = {
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
    }

    def start(command):
        return subprocess.Popen(
            ["sh", "-ec", command],
            cwd=clone,
            env=os.environ | paths,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    return start


def results(out):
    """Name -> content of every result in a folder."""
    return {path.name: path.read_bytes() for path in (out / "trials").glob("*.parquet")}
