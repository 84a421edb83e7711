"""What is printed: --json is one object, --quiet nothing, --verbose all; options by subject."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.cli.output import PANELS
from pipeline.io.c3d.write import write_c3d
from pipeline.run.store import read_trial
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
    assert f"<code>hbm explain {standing} --mass-kg 74.6</code>" in page
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


def test_verbose_prints_how_a_result_was_made(standing, tmp_path, capsys):
    words = ("residuals", standing, "--mass-kg", "74.6", "--out", tmp_path)
    short, long = printed(capsys, *words), printed(capsys, *words, "--verbose")
    assert "inverse dynamics by" not in short
    assert "inverse dynamics by" in long
    assert "body mass 74.6 kg as given" in short


def test_only_one_way_of_printing_is_chosen(standing, capsys):
    assert main(["residuals", str(standing), "--quiet", "--json"]) == 2
    assert "--quiet and --json: give one" in capsys.readouterr().err


def test_check_prints_what_is_doubtful_once_for_all_files_and_counts_the_healthy_ones(
    moving_study, capsys
):
    out = printed(capsys, "check", moving_study)
    assert "no warnings: " in out
    assert " markers at 100 Hz" not in out
    assert " markers at 100 Hz" in printed(capsys, "check", moving_study, "--verbose")


def test_options_are_listed_by_what_they_are_about(capsys):
    out = printed(capsys, "residuals", "--help")
    places = [out.index(f"\n{panel}:") for panel in PANELS]
    assert places == sorted(places)
    subject = out[places[PANELS.index("Subject")] : places[PANELS.index("Processing")]]
    assert "--mass-kg" in subject
    assert "--calibration" not in subject


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
    assert "Fit for trials │ ✔ fit" in text
