"""``--json`` prints one object, ``--quiet`` nothing and ``--verbose`` all."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.run.store import read_trial
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from tests.pipeline import lab
from tests.pipeline.cli.test_app import plate
from tests.synthetic import synthetic_t_pose


@pytest.fixture(scope="module")
def standing(tmp_path_factory):
    path = tmp_path_factory.mktemp("printing") / "standing.c3d"
    half = np.full(1000, 74.6 * 9.81 / 2)
    write_c3d(path, synthetic_t_pose(), [plate(1, half), plate(2, half)])
    return path


def printed(capsys, *arguments, code=0):
    assert main([str(argument) for argument in arguments]) == code
    return capsys.readouterr().out


def only_numbers(constant):
    raise AssertionError(f"{constant} is no JSON")


def test_the_object_of_a_trial_has_the_numbers_of_its_files(standing, tmp_path, capsys):
    out = printed(capsys, "residuals", standing, "--mass-kg", "74.6", "--out", tmp_path, "--json")
    found = json.loads(out, parse_constant=only_numbers)
    table = pd.read_csv(tmp_path / "standing_residuals.csv")
    rms = [row["rms"] for row in found["residuals"]]
    assert rms == pytest.approx([*table["rms"]], rel=1e-4, abs=1e-9)
    notes = read_trial(tmp_path / "standing.parquet", frames=False).notes
    assert found["mass_kg"] == 74.6
    assert found["plate_delay_ms"] is None  # quiet standing shows none
    assert found["frames_used"] > 0
    page = Path(found["page"]).read_text(encoding="utf-8")
    assert f"hbm explain {standing} --mass-kg 74.6 --out {tmp_path} finds the causes" in page
    assert [note["code"] for note in found["notes"]] == [note.code for note in notes]
    assert all(note["advice"] for note in found["notes"] if note["level"] == "warning")


def test_the_objects_of_a_study_are_one_each(moving_study, tmp_path, capsys):
    found = json.loads(printed(capsys, "check", moving_study, "--json"))
    assert found["faults"] == []
    assert found["subjects"] == 2
    run = ("run", moving_study, "--subject", "sub01", "--condition", "baseline", "--out", tmp_path)
    done = json.loads(printed(capsys, *run, "--json"))
    assert [(trial["trial"], trial["state"]) for trial in done["trials"]] == [
        ("sub01 baseline", "done")
    ]


def test_quiet_prints_nothing_and_errors_are_still_printed(standing, tmp_path, capsys):
    assert printed(capsys, "residuals", standing, "--out", tmp_path, "--quiet") == ""
    assert main(["residuals", "absent.c3d", "--quiet"]) == 2
    assert capsys.readouterr().err.startswith("hbm: error: absent.c3d")


@pytest.mark.parametrize(
    ("words", "code", "file"),
    [
        ("residuals absent.c3d", "input", "absent.c3d"),
        ("explain absent.c3d", "input", "absent.c3d"),
        ("run absent", "input", "absent"),
        ("check absent", "input", "absent"),
        ("plates absent", "input", "absent"),
        ("calibration fit absent.c3d -o lab.json", "input", "absent.c3d"),
        ("calibration check absent.json absent.c3d", "input", "absent.json"),
        ("calibration rank absent", "input", "absent"),
        ("residuals", "usage", None),
        ("residuals absent.c3d --cutof-hz 6", "usage", None),
        ("report absent", "usage", None),  # it has no --json
        ("residuals absent.c3d --quiet", "input", None),
        ("nonsense", "usage", None),
    ],
)
def test_what_ends_a_command_is_one_object_too(words, code, file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    if "absent.json" in words:
        Path("absent.json").write_text("{}", encoding="utf-8")
    assert main([*words.split(), "--json"]) == 2
    out, err = capsys.readouterr()
    found = json.loads(out, parse_constant=only_numbers)
    error = found["error"]
    assert (error["code"], error["file"]) == (code, file)
    assert error["text"] in err
    assert error["advice"]
    of_study = words.split()[0] in ("run", "check", "plates")
    assert found.get("faults") == ([error["text"]] if of_study else None)


def test_a_fault_of_the_program_is_an_object_too(standing, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("pipeline.trial.process.process_chain", lambda *_: 1 / 0)
    assert main(["residuals", str(standing), "--out", str(tmp_path), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "program"


def test_faults_that_a_check_finds_are_listed_beside_the_error(tmp_path, capsys):
    (tmp_path / "study.toml").write_text("[conditions.level]\n", encoding="utf-8")
    person = 'id = "a"\n[trials.level]\nfile = "a.c3d"\n'
    (tmp_path / "a.toml").write_text(person, encoding="utf-8")
    (tmp_path / "a.c3d").write_text("no recording", encoding="utf-8")
    assert main(["check", str(tmp_path), "--json"]) == 2
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert "not a C3D" in found["error"]["text"]
    assert found["faults"] == [found["error"]["text"]]
    assert (found["trials"], err) == (1, f"hbm: error: {found['faults'][0]}\n")


@pytest.mark.parametrize("study", ["[conditions", '[settings]\nfilter = "none"', ""])
def test_the_file_that_is_at_fault_is_named_by_its_path(study, tmp_path, capsys):
    (tmp_path / "study.toml").write_text(f"{study}\n[conditions.level]\n", encoding="utf-8")
    person = 'id = "a"\n[trials.level]\nfile = "a.c3d"\n'
    (tmp_path / "a.toml").write_text(person, encoding="utf-8")
    (tmp_path / "a.c3d").write_text("no recording", encoding="utf-8")
    found = json.loads(printed(capsys, "check", tmp_path, "--json", code=2))
    assert found["error"]["file"] == str(tmp_path / ("study.toml" if study else "a.c3d"))


@pytest.mark.parametrize("words", ["residuals --cutoff-hz 50", "calibration fit -o lab.json"])
def test_a_recording_that_cannot_be_used_is_the_file_at_fault(words, standing, capsys):
    error = json.loads(printed(capsys, *words.split(), standing, "--json", code=2))["error"]
    assert standing.name in error["text"]
    assert error["file"] == str(standing)


def test_quiet_is_silent_but_for_what_fails(tmp_path, capsys):
    (tmp_path / "study.toml").write_text("[conditions.level]\n", encoding="utf-8")
    person = 'id = "a"\n[trials.level]\nfile = "a.c3d"\n'
    (tmp_path / "a.toml").write_text(person, encoding="utf-8")
    (tmp_path / "a.c3d").write_text("no recording", encoding="utf-8")
    for words, code in ((["check"], 2), (["run", "--out", str(tmp_path / "out")], 1)):
        assert main([*words, str(tmp_path), "--quiet"]) == code
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert "not a C3D" in err


def test_a_trial_without_residuals_is_one_object_with_its_numbers_and_the_error(tmp_path, capsys):
    path, half = tmp_path / "empty.c3d", np.zeros(1000)
    write_c3d(path, synthetic_t_pose(), [plate(1, half), plate(2, half)])
    words = ("residuals", path, "--mass-kg", "70", "--out", tmp_path, "--json")
    found = json.loads(printed(capsys, *words, code=2))
    assert found["mass_kg"] == 70
    assert "no residuals" in found["error"]["text"]


def test_verbose_prints_how_a_result_was_made(standing, tmp_path, capsys):
    words = ("residuals", standing, "--mass-kg", "74.6", "--out", tmp_path)
    short, long = printed(capsys, *words), printed(capsys, *words, "--verbose")
    assert "Calibration pose" not in short
    assert "Calibration pose" in long
    assert "74.6 kg" in short


def test_only_one_way_of_printing_is_chosen(standing, capsys):
    assert main(["residuals", str(standing), "--quiet", "--json"]) == 2
    assert "--quiet and --json" in capsys.readouterr().err


def test_check_prints_what_is_doubtful_once_for_all_files_and_counts_the_healthy_ones(
    moving_study, capsys
):
    out = printed(capsys, "check", moving_study)
    assert "no warnings: " in out
    assert " at 100 Hz" not in out
    assert " at 100 Hz" in printed(capsys, "check", moving_study, "--verbose")


def test_options_are_listed_by_what_they_are_about(capsys):
    out = printed(capsys, "residuals", "--help")
    subject = out[out.index("\nSubject:") : out.index("\nProcessing:")]
    assert "--mass-kg" in subject
    assert "--calibration" not in subject
    assert out.index("\nArguments:") < out.index("\nRecording:")


def test_the_version_is_printed_and_a_shell_can_complete_commands(capsys, monkeypatch):
    assert printed(capsys, "--version").startswith("hbm-residuals 0.")
    monkeypatch.setenv("_HBM_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "hbm res")
    monkeypatch.setenv("COMP_CWORD", "1")
    with pytest.raises(SystemExit):
        main([])
    assert "residuals" in capsys.readouterr().out


def test_the_objects_of_a_calibration_have_its_components_and_whether_it_is_valid(
    moving_study, tmp_path, capsys
):
    empty, out = moving_study / "empty.c3d", tmp_path / "lab.json"
    again = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0, 7), seed=7)
    day2 = lab.save(again, tmp_path / "day2.c3d")
    fitted = json.loads(printed(capsys, "calibration", "fit", empty, "-o", out, "--json"))
    assert {row["plate"] for row in fitted["components"]} == {"plate 1", "plate 2"}
    assert all(row["left"] >= 0 and row["limit"] > 0 for row in fitted["components"])
    checked = json.loads(printed(capsys, "calibration", "check", out, day2, "--json"))
    assert checked["valid"] is True
    assert [note["code"] for note in checked["notes"]] == ["calibration_still_valid"]


def test_the_table_of_a_calibration_fits_in_80_columns_and_names_what_is_on_the_page(
    moving_study, tmp_path, capsys, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "80")
    out = tmp_path / "lab.json"
    text = printed(capsys, "calibration", "fit", moving_study / "empty.c3d", "-o", out)
    rows = [line for line in text.splitlines() if "plate 2" in line and "N·m" in line]
    assert len(rows) == 3
    assert max(map(len, rows)) <= 80
    assert "On the page: " in text
    assert "│ ✔ fit" in text
