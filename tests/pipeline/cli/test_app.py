"""The command line loads little, has an exit code for every end, and one line for every mistake."""

import re
import subprocess
import sys

import numpy as np
import pytest

from hbm.kernels import native
from hbm.markers import Markers
from pipeline.cli import doctor, trial
from pipeline.cli.app import COMMANDS, main
from pipeline.io.recording import Plate
from pipeline.io.write import write_text
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_study import study_files, study_texts
from tests.pipeline import lab
from tests.synthetic import synthetic_t_pose

HEAVY = (
    "casadi",
    "matplotlib",
    "pandas",
    "pinocchio",
    "pingouin",
    "rerun",
    "scipy.linalg",  # the first part of SciPy that anything needs
)
MASS = ("--mass-kg", "74.6")
LAB_AXES = ("--axes", "left,back,up")


def plate(number, vertical):
    """A plate under one foot that carries a vertical force, (N,), at 1000 Hz."""
    y = 0.25 if number == 1 else -0.25
    wrench = np.zeros((len(vertical), 6))
    wrench[:, 2] = -vertical
    surface = [(x, y + dy, 0) for x, dy in ((0.9, -0.25), (-0.9, -0.25), (-0.9, 0.25), (0.9, 0.25))]
    time = np.arange(len(vertical)) / 1000
    return Plate(number, time, wrench, np.diag([1.0, -1.0, -1.0]), (0, y, 0), surface)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A person who stands in a T-pose for a second, and files that are no usable trial."""
    folder = tmp_path_factory.mktemp("trials")
    person = synthetic_t_pose()
    half = np.full(1000, 74.6 * 9.81 / 2)
    still = [plate(1, half), plate(2, half)]
    write_c3d(folder / "still.c3d", person, still)
    write_c3d(folder / "no_plates.c3d", person)
    foreign = tuple(f"M{k}" for k in range(len(person.names)))
    strange = Markers(person.time, foreign, person.position)
    write_c3d(folder / "foreign.c3d", strange, still)
    bouncing = half * (1 + 0.2 * np.sin(12 * still[0].time))
    write_c3d(folder / "bouncing.c3d", person, [plate(1, bouncing), plate(2, bouncing)])
    write_c3d(folder / "empty.c3d", strange, [plate(1, 0 * half), plate(2, 0 * half)])
    (folder / "renamed.c3d").write_text("time\tLASIS\n0.0\t1.0\n" * 100)
    (folder / "still.txt").write_text("a person stands still")
    return folder


def refused(capsys, *arguments):
    """The single line that a command ends with."""
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert code == 2
    assert "Pelvis residuals" not in out
    assert err.startswith("hbm: error: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize(
    ("file", "options", "expected"),
    [
        ("absent.c3d", MASS, ["absent.c3d", "no such file"]),
        ("renamed.c3d", MASS, ["renamed.c3d", "not a C3D file"]),
        ("still.txt", MASS, ["still.txt", "C3D", "TRC", "D-Flow", ".mox", "Nexus"]),
        ("no_plates.c3d", MASS, ["no_plates.c3d", "no force plates"]),
        ("foreign.c3d", [*MASS, *LAB_AXES], ["foreign.c3d", "match no shipped set", "rename"]),
        ("empty.c3d", MASS, ["match no shipped set", "M0, M1", "plates without a person"]),
        ("bouncing.c3d", [], ["bouncing.c3d", "mass missing", "give the mass", "kg"]),
        ("still.c3d", ["--mass-kg", "74600"], ["--mass-kg", "400", "kilograms"]),
        ("still.c3d", ["--height-m", "178"], ["--height-m", "2.6", "metres"]),
        ("still.c3d", ["--filter", "butter"], ["--filter", "'realtime' or 'zero_phase'"]),
        ("still.c3d", ["--axes", "left,up"], ["--axes", "'left,up'", "three of"]),
        ("still.c3d", ["--plate-delay-ms", "5000"], ["--plate-delay-ms", "500"]),
        ("still.c3d", ["--mass-kg", "2", "--cutoff-hz", "600"], ["--mass-kg", "--cutoff-hz"]),
        ("still.c3d", ["--hip-trial", "still.c3d"], ["--hip-trial", "without --hip functional"]),
        ("still.c3d", ["--colour", "red"], ["--colour", "--help"]),
    ],
)
def test_a_mistake_gives_one_line_with_what_is_wrong(
    folder, tmp_path, capsys, file, options, expected
):
    line = refused(capsys, "residuals", folder / file, "--out", tmp_path / "out", *options)
    for words in expected:
        assert words in line
    assert not (tmp_path / "out").exists()


def test_a_file_in_place_of_the_output_folder_is_refused_before_processing(
    folder, capsys, monkeypatch
):
    monkeypatch.setattr(trial, "chain_of", lambda *_: pytest.fail("processing began"))
    for out in (folder / "still.txt", folder / "still.txt" / "deeper"):
        line = refused(capsys, "residuals", folder / "still.c3d", "--out", out)
        assert "still.txt is a file" in line


@pytest.mark.parametrize(
    ("commands", "absent"),
    [
        ([["--help"], ["."]], (*HEAVY, "numpy", "pydantic", "rich")),
        ([[c, "--help"] for c in COMMANDS], HEAVY),
    ],
)
def test_what_answers_at_once_loads_nothing_heavy(commands, absent, tmp_path):
    """Help, of the group sooner than that of a command; and what a study is."""
    (tmp_path / "study.toml").touch()
    code = (
        "import sys\n"
        "from pipeline.cli.app import main\n"
        f"for words in {commands!r}:\n"
        "    assert main(words) == 0\n"
        f"print('loaded:', *(name for name in {absent!r} if name in sys.modules))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1].strip() == "loaded:"


def test_the_table_of_a_trial_is_shown_before_what_draws_it_is_loaded(walker, tmp_path):
    """Nor are other libraries loaded that take longer than the answer."""
    absent = ("casadi", "jinja2", "pandas", "scipy.interpolate", "scipy.optimize", "scipy.signal")
    walk = lab.save(lab.cropped(walker, 0, 600), tmp_path / "walk.c3d")
    command = ["residuals", str(walk), "--sex", "male", "--out", str(tmp_path)]
    code = (
        "import sys\n"
        "from pipeline.cli.app import main\n"
        "class Drawing:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'matplotlib':\n"
        "            sys.meta_path.remove(self)\n"
        f"            print('loaded:', *(name for name in {absent!r} if name in sys.modules))\n"
        "sys.meta_path.insert(0, Drawing())\n"
        f"assert main({command!r}) == 0\n"
        "print('for many trials:', 'joblib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("for many trials: False\n")
    table, after = done.stdout.split("loaded:")
    assert "Pelvis residuals" in table
    assert "Peak moment" in table
    assert after.splitlines()[0] == ""


def test_an_interrupt_ends_with_130_and_one_line(monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(native, "kernels", interrupted)
    assert main(["doctor"]) == 130
    assert capsys.readouterr().err.startswith("hbm: interrupted: ")


FAULTS = (
    RuntimeError("first line\nsecond \x1b[31mline " + "x" * 5000),
    KeyError(),
    AssertionError(),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
def test_what_nobody_expects_is_one_line_that_says_it_is_a_fault_of_the_program(
    fault, monkeypatch, capsys
):
    def fails(*_):
        raise fault

    monkeypatch.setattr(native, "kernels", fails)
    assert main(["doctor"]) == 2
    line = capsys.readouterr().err
    assert re.match(f"hbm: error: .*this program: {type(fault).__name__}: ", line)
    assert line.endswith(" --debug shows\n")
    assert "(test_app.py, line " in line
    assert line[:-1].isprintable()
    assert len(line) < 400
    with pytest.raises(type(fault)):
        main(["doctor", "--debug"])


def test_an_error_is_printable_and_short_whatever_is_typed(capsys, tmp_path):
    refused_line = refused(capsys, "residuals", tmp_path / "a\x1b[31m\u202e\udcffb.c3d")
    assert refused_line[:-1].isprintable()
    assert "a?[31m??b.c3d" in refused_line
    assert len(refused(capsys, "residuals", "--axes", "x" * 100_000, tmp_path)) < 1100


def test_doctor_says_that_there_are_no_compiled_kernels_and_what_to_do(capsys, monkeypatch):
    """Square brackets are printed as they are, not as markup."""

    def missing(_):
        raise native.LibraryError("data [bold] [2024]")

    monkeypatch.setattr(native, "_READY", {})
    monkeypatch.setattr(native, "lanes_of_processor", missing)
    monkeypatch.setattr(doctor, "speed", lambda _: 1.0)
    assert main(["doctor"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "C compiler" in out
    assert "kernels: virtual machine" in out
    assert "(data [bold] [2024])" in out


@pytest.mark.parametrize(
    "command", [["simulate", "{}"], ["demo", "--out", "{}"], ["init", "{}"], ["check", "{}"]]
)
def test_a_file_where_a_folder_should_be_gives_one_line(tmp_path, capsys, command):
    (tmp_path / "taken").touch()
    assert main([part.format(tmp_path / "taken") for part in command]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "taken" in lines[0]
    assert "folder" in lines[0]


def test_a_study_of_excluded_trials_only_has_nothing_to_process(tmp_path, capsys):
    (tmp_path / "study.toml").write_text("[conditions.walk]")
    (tmp_path / "a.toml").write_text('id = "a"\n[trials.walk]\nexclude = "ill"\n')
    assert main(["run", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "nothing to process" in capsys.readouterr().err


@pytest.fixture
def simulated(tmp_path):
    """The text files of a simulated study of three subjects, without recordings."""
    folder = tmp_path / "simulated"
    for name, text in study_texts(Setting(protocol=Protocol(subjects=3))).items():
        write_text(text, folder / name)
    return folder


def test_nothing_is_simulated_into_a_study_of_recorded_people(tmp_path, capsys):
    assert main(["init", str(tmp_path)]) == 0
    before = sorted(tmp_path.iterdir())
    line = refused(capsys, "simulate", tmp_path)
    assert "not a simulated" in line
    assert "new folder" in line
    assert sorted(tmp_path.iterdir()) == before


def test_options_that_contradict_the_study_in_the_folder_are_refused(simulated, capsys):
    line = refused(capsys, "simulate", simulated, "--subjects", 9)
    assert re.search(r"subjects = 3 .*subjects = 9\b", line)


def test_what_was_there_is_not_written_again(simulated):
    for name in study_files(Setting(protocol=Protocol(subjects=3))):
        (simulated / name).touch()
    before = {path: path.stat().st_mtime_ns for path in simulated.rglob("*")}
    assert main(["simulate", str(simulated), "--subjects", "3"]) == 0
    assert {path: path.stat().st_mtime_ns for path in simulated.rglob("*")} == before


def test_of_a_simulated_study_without_recordings_the_next_command_is_named(simulated, capsys):
    line = refused(capsys, "run", simulated)
    assert f"'hbm simulate {simulated}'" in line
