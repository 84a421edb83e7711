"""Output of any encoding and width arrives, though it be closed, full, or no longer read."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli.app import main
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.pipeline.cli.test_app import plate
from tests.synthetic import synthetic_t_pose

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ENVIRONMENTS = {
    "ASCII by the locale": ASCII,
    "Chinese letters": {"PYTHONIOENCODING": "gbk", "PATH": ""},
    "optimised, at a home that cannot be written": {
        **{"PYTHONOPTIMIZE": "2", "TERM": "dumb", "COLUMNS": "many", "LINES": "-1"},
        **{"HOME": "/proc", "MPLCONFIGDIR": None},
    },
}
STAYS_QUICK = ("ASCII by the locale",)
PROGRAM = """
import sys
from pipeline.cli.app import main
from pipeline.cli import doctor
trial, study, out = sys.argv[1:]
doctor.FRAMES = 64
arguments = {
    "--help": ["--help"],
    "residuals": ["residuals", trial, "--mass-kg", "74.6", "--out", out],
    "check": ["check", study],
    "doctor": ["doctor"],
}
sys.exit(sum(main(words) for words in arguments.values()))
"""


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """A person who stands in a T-pose for a second."""
    path = tmp_path_factory.mktemp("trial") / "standing.c3d"
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(path, synthetic_t_pose(), [plate(1, half), plate(2, half)])
    return path


@pytest.fixture(scope="module")
def study(trial):
    """A study of this trial."""
    (trial.parent / "study.toml").write_text(
        'name = "Standing"\n[conditions.standing]\nwindow = "recording"\n'
    )
    (trial.parent / "sub01.toml").write_text(
        'id = "sub01"\nmass_kg = 74.6\n[trials.standing]\nfile = "standing.c3d"\n'
    )
    return trial.parent


def started(program, *arguments, changed=None, **options):
    """Run a program in an environment of its own; the time is what no sound machine takes."""
    environment = os.environ | (changed or {})
    return subprocess.run(
        [sys.executable, *program, *map(str, arguments)],
        env={name: value for name, value in environment.items() if value is not None},
        stderr=subprocess.PIPE,
        timeout=300,
        **options,
    )


HBM = ("-m", "pipeline.cli")


def test_every_name_in_utf_8_works_without_a_warning(trial, tmp_path, capsys):
    path = shutil.copy(trial, tmp_path / '=1+1, "ʻŌlelo" – é, 歩行_1.c3d')
    words = ["residuals", str(path), "--mass-kg", "74.6", "--out", str(tmp_path / "out")]
    assert main([*words, "--quiet"]) == 0
    assert capsys.readouterr().err == ""
    assert len(list((tmp_path / "out").iterdir())) == 6


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
@pytest.mark.parametrize(
    ("command", "name", "reason"),
    [("residuals", b"caf\xe9.c3d", "not UTF-8"), ("export", b"a\x01b.c3d", "a control character"),
     ("init", b"a\nb.c3d", "a control character"), ("run", b"caf\xe9.c3d", "not UTF-8")],
)  # fmt: skip
def test_other_names_are_refused_before_anything_is_computed(
    command, name, reason, trial, tmp_path, capsys
):
    path = shutil.copy(trial, tmp_path / os.fsdecode(name))
    options = ["--out", str(tmp_path / "out")] if command != "init" else ["--quiet"]
    assert main([command, str(path), *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert reason in line
    assert not (tmp_path / "out").exists()
    main(["init", str(tmp_path)])
    listed = capsys.readouterr().out
    assert "not used: " in listed
    assert reason in listed


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
def test_a_study_works_within_a_folder_whose_name_is_not_utf_8(study, tmp_path):
    folder = shutil.copytree(study, tmp_path / os.fsdecode(b"\xe9tude"))
    commands = [["run", "."], ["report", "--no-pages"], ["view", "--save", "a.rrd"]]
    program = f"from pipeline.cli.app import main; assert not any(map(main, {commands}))"
    here = {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = started(("-c", program), changed=here, cwd=folder, stdout=subprocess.DEVNULL)
    assert (done.returncode, done.stderr) == (0, b"")
    assert {"a.rrd", "results"} < {path.name for path in folder.iterdir()}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in STAYS_QUICK else pytest.mark.slow)
        for name in ENVIRONMENTS
    ],
)
def test_every_command_works_in_every_environment(name, trial, study, tmp_path):
    changed = ENVIRONMENTS[name]
    done = started(("-c", PROGRAM), trial, study, tmp_path, changed=changed, stdout=subprocess.PIPE)
    encoding = changed.get("PYTHONIOENCODING", "ascii" if changed is ASCII else "utf-8")
    text = done.stdout.decode(encoding)
    # Matplotlib itself says where it keeps its cache if it cannot be at home
    complaints = [line for line in done.stderr.splitlines() if b"matplotlib" not in line.lower()]
    assert (done.returncode, complaints) == (0, [])
    for words in ("Usage: hbm", "Pelvis residuals", "1 trial, 0 faults", "kernels: "):
        assert words in text
    assert {path.suffix for path in tmp_path.iterdir()} == {
        *(".parquet", ".csv", ".png", ".svg", ".html")
    }


@pytest.mark.skipif(sys.platform == "win32", reason="closes a descriptor before the program starts")
def test_without_standard_output_the_files_are_written(trial, tmp_path):
    def close():
        for descriptor in (0, 1, 2):
            os.close(descriptor)

    done = started(
        HBM, "residuals", trial, "--mass-kg", "74.6", "--out", tmp_path,
        stdout=subprocess.DEVNULL, preexec_fn=close,
    )  # fmt: skip
    assert done.returncode == 0
    assert len(list(tmp_path.iterdir())) == 6


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such pipes")
@pytest.mark.parametrize("arguments", [["--help"], ["residuals"]])
def test_a_pipe_that_nobody_reads_ends_the_command_without_a_word(arguments, trial, tmp_path):
    if arguments == ["residuals"]:
        arguments = ["residuals", trial, "--mass-kg", "74.6", "--out", tmp_path]
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = started(HBM, *arguments, stdout=writing)
    finally:
        os.close(writing)
    assert done.stderr == b""
    assert done.returncode in (1, 141)
    if "--out" in arguments:
        assert len(list(tmp_path.iterdir())) == 6, "files are written first"


@pytest.mark.skipif(sys.platform != "linux", reason="needs a device that is always full")
def test_a_full_disk_under_the_output_is_one_line():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = started(HBM, "--help", stdout=full)
    assert done.returncode == 2
    assert done.stderr == b"hbm: error: no space left on device\n"
