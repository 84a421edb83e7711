"""Standard output of any encoding and width, closed, full, or no longer read."""

import os
import subprocess
import sys

import numpy as np
import pytest

from pipeline.cli.output import MAX_LINE, STAND_INS, print_error
from pipeline.io.c3d.write import write_c3d
from tests.pipeline.cli.test_app import plate
from tests.synthetic import synthetic_t_pose

ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ENVIRONMENTS = {
    "plain": {},
    "ASCII by the locale": ASCII,
    "ASCII as stated": {"PYTHONIOENCODING": "ascii"},
    "Latin letters": {"PYTHONIOENCODING": "latin-1"},
    "Chinese letters": {"PYTHONIOENCODING": "gbk"},
    "optimised": {"PYTHONOPTIMIZE": "2"},
    "a dumb terminal": {"TERM": "dumb"},
    "no terminal": {"TERM": ""},
    "no colours": {"NO_COLOR": "1"},
    "colours": {"FORCE_COLOR": "1"},
    "40 columns": {"COLUMNS": "40"},
    "no columns": {"COLUMNS": "0", "LINES": "0"},
    "one column": {"COLUMNS": "1"},
    "no number of columns": {"COLUMNS": "many", "LINES": "-1"},
    "a million columns": {"COLUMNS": "1000000"},
    "no home": {"HOME": None, "XDG_CACHE_HOME": None},
    "a home that cannot be written": {"HOME": "/proc", "MPLCONFIGDIR": None},
    "a home that is not there": {"HOME": "/nowhere"},
    "no search path": {"PATH": ""},
    "another time zone": {"TZ": "Pacific/Kiritimati"},
}
STAYS_QUICK = ("plain", "ASCII by the locale", "no columns")
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
    assert {path.suffix for path in tmp_path.iterdir()} == {".parquet", ".csv", ".png", ".svg"}


@pytest.mark.skipif(sys.platform == "win32", reason="closes a descriptor before the program starts")
@pytest.mark.parametrize("closed", [[1], [2], [0, 1, 2]])
def test_without_standard_output_the_files_are_written(trial, tmp_path, closed):
    def close():
        for descriptor in closed:
            os.close(descriptor)

    done = started(
        HBM, "residuals", trial, "--mass-kg", "74.6", "--out", tmp_path,
        stdout=subprocess.DEVNULL, preexec_fn=close,
    )  # fmt: skip
    assert done.returncode == 0
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such pipes")
@pytest.mark.parametrize("arguments", [["--help"], ["doctor"], ["residuals"]])
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
        assert len(list(tmp_path.iterdir())) == 5, "files are written first"


@pytest.mark.skipif(sys.platform != "linux", reason="needs a device that is always full")
def test_a_full_disk_under_the_output_is_one_line():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = started(HBM, "--help", stdout=full)
    assert done.returncode == 2
    assert done.stderr == b"hbm: error: no space left on device\n"


def test_letters_that_the_output_lacks_are_written_in_letters_that_it_has():
    program = (
        "from pipeline.cli.output import accept_any_letter as accept; accept(); "
        f"print({'5 N·m, 3 µs, −2 ± 1 m/s², 90°, × – — → ≤ ≥, é, 名'!a})"
    )
    done = started(("-c", program), changed=ASCII, stdout=subprocess.PIPE)
    expected = b"5 N*m, 3 us, -2 +/- 1 m/s2, 90 deg, x - - -> <= >=, e, ?"
    assert done.stdout.strip() == expected, done.stderr
    assert all(text.isascii() for text in STAND_INS.values())


def test_an_error_of_any_length_is_one_short_line(capsys):
    print_error("a\nb\tc " + "x" * 10 * MAX_LINE)
    line = capsys.readouterr().err
    assert line.startswith("hbm: a b c xxx")
    assert " … x" in line
    assert len(line) <= MAX_LINE + len("hbm: \n")


def test_without_standard_error_an_error_is_lost_quietly(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    print_error("nobody sees this")
