"""A corrected study has other settings and the same recordings, and its residuals fall."""

import hashlib
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.budgets.corrections import write_corrected
from pipeline.budgets.explanation import StudyExplanation
from pipeline.budgets.words import study_lines
from pipeline.cli.app import main
from pipeline.config.schema import Settings, Subject
from pipeline.config.study import read_study
from pipeline.explain.budget import EstimatedCause, SharedCause
from pipeline.run.store import read_trial
from pipeline.trial.residuals import residual_table
from pipeline.trial.result import Procedure
from tests.pipeline.virtual_study import write_overground_study

SIZES = {
    "plate 1: gain of Fz": ("gain", "1", 0.05),
    "plate 2: place along x": ("place", "m", 0.02),
    "sub01 sway: plate 2: zero of Mx": ("zero", "N·m", -1.5),
    "plates delayed": ("delay", "s", 0.01),
    "sub01: body mass": ("inertia", "1", 0.04),
}
"""Identity -> group, unit, size."""
RESULT = SimpleNamespace(
    procedure=Procedure(),
    settings=Settings(),
    body=SimpleNamespace(mass=74.0),
    subject=Subject(),
)
"""What every trial was processed with."""
TRIALS = ("sub01 baseline", "sub01 sway", "sub02 sway")


def cause(name, group, unit, size, *, deviation=0.1, held_out=0.2, left=0.8):
    """A cause that is certain, with this deviation as a share of its size."""
    title = name.removeprefix("sub01 sway: ").removeprefix("sub01: ")
    own = name.removesuffix(title).removesuffix(": ")
    found = EstimatedCause(
        title, group, unit, size, deviation * abs(size), abs(size), 0.99, np.full(6, 10 * left)
    )
    trials = tuple(trial for trial in TRIALS if trial.startswith(own))
    return SharedCause(name, trials, found, np.full(6, 10.0), np.full(6, held_out))


def corrected(study, out, causes):
    found = StudyExplanation("", TRIALS, tuple(causes), ())
    return write_corrected(
        study, found, {"sub01": 74.0, "sub02": 60.0}, out.parent / "results", out
    )


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).digest() for p in folder.iterdir()}


def test_corrections_are_settings_of_a_study_with_the_same_recordings(moving_study, tmp_path):
    study, before = read_study(moving_study), digests(moving_study)
    out = tmp_path / "corrected"
    written, left_out = corrected(study, out, [cause(n, *own) for n, own in SIZES.items()])
    assert digests(moving_study) == before
    assert {path.suffix for path in out.iterdir()} == {".toml"}

    now = read_study(out)
    assert left_out == []
    assert list(now.file.corrections) == written
    assert now.file.mend_plates == ("1: gain Fz 0.95238", "2: move x -0.02000")
    delay_s = study.file.settings.plate_delay_s or 0.0
    assert now.file.settings.plate_delay_s == pytest.approx(delay_s + 0.01)
    person = now.subjects["sub01"]
    assert person.mass_kg == pytest.approx(74 / 1.04, abs=0.01)
    for name in study.trials:
        trial = study.trial(name)
        again = now.trial(name)
        mendings = ("2: zero Mx -1.500",) if str(name) == "sub01 sway" else ()
        assert again.mend_plates == mendings
        if trial.file is not None:
            assert (out / again.file).resolve() == (moving_study / trial.file).resolve()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"held_out": -0.1}, ["plate 1: .*5.0 ± 1.0 %: .*other trials"]),  # does not hold elsewhere
        ({"deviation": 0.6}, []),  # may be nothing
        ({"left": 0.98}, ["plate 1: .*5.0 ± 1.0 %: .*by 3 %"]),  # hardly matters
    ],
)
def test_what_is_uncertain_or_does_not_hold_elsewhere_is_not_written(
    moving_study, tmp_path, change, named
):
    own = cause("plate 1: gain of Fz", *SIZES["plate 1: gain of Fz"], **change)
    written, left_out = corrected(read_study(moving_study), tmp_path / "out", [own])
    assert written == []
    assert len(left_out) == len(named)
    assert all(map(re.match, named, left_out))
    assert read_study(tmp_path / "out").file.mend_plates == ()


def test_a_gain_that_all_plates_have_alike_may_be_the_body_model_and_is_not_written(
    moving_study, tmp_path
):
    """Of moments and horizontal forces; of one plate alone, or of Fz, it is a plate's."""
    sizes = {
        "plate 1: gain of Mx": 0.06,
        "plate 2: gain of Mx": 0.07,
        "plate 1: gain of My": 0.06,
        "plate 2: gain of My": -0.06,
        "plate 1: gain of Fz": 0.05,
        "plate 2: gain of Fz": 0.05,
    }
    found = [cause(name, "gain", "1", size) for name, size in sizes.items()]
    _, left_out = corrected(read_study(moving_study), tmp_path / "out", found)
    sizes = [re.search(r"plate (\d): .*Mx ([\d.]+) ± ([\d.]+) %", line) for line in left_out]
    assert [size.groups() for size in sizes] == [("1", "6.0", "1.2"), ("2", "7.0", "1.4")]
    written = read_study(tmp_path / "out").file.mend_plates
    assert {own.split(" ", 2)[2].split()[0] for own in written} == {"My", "Fz"}
    lines = study_lines(found, dict.fromkeys(TRIALS, RESULT))
    (alike,) = (line for line in lines if "Mx" in line)
    assert alike.startswith("Not certain: gain of Mx ")
    assert "plate 1 6.0 ± 1.2 %, plate 2 7.0 ± 1.4 %" in alike


def test_a_correction_is_typed_in_the_plate_s_component_and_explained_in_the_lab(
    moving_study, tmp_path
):
    gain = cause("plate 1: gain of Mx", "gain", "1", 0.06)
    gain = replace(gain, cause=replace(gain.cause, in_lab="pitch moment"))
    other = cause("plate 2: gain of Mx", "gain", "1", -0.06)
    other = replace(other, cause=replace(other.cause, in_lab="pitch moment"))
    written, _ = corrected(read_study(moving_study), tmp_path / "out", [gain, other])
    assert written[0].setting == 'mend_plates "1: gain Mx 0.94340"'
    assert "Mx (pitch moment" in written[0].cause


def test_a_study_is_not_overwritten(moving_study, tmp_path):
    (tmp_path / "study.toml").touch()
    with pytest.raises(ValueError, match="a study already"):
        corrected(read_study(moving_study), tmp_path, [])


@pytest.mark.slow
def test_residuals_fall_to_those_of_a_laboratory_without_the_faults(tmp_path, capsys, undrawn):
    """Six people walk over three plates: plate 2 reads 5 % too much, plate 1 lies 2 cm off."""
    rms = {}
    for name, faulty in {"healthy": False, "faulty": True}.items():
        write_overground_study(tmp_path / name, people=6, faulty=faulty)
        assert main(["run", str(tmp_path / name), "--out", str(tmp_path / f"{name}_r")]) == 0
        rms[name] = mean_rms(tmp_path / f"{name}_r")
    results, out = tmp_path / "faulty_r", tmp_path / "corrected"
    assert main(["explain", str(results), "--apply", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "2: gain of Fz" in said
    gains = [own for own in read_study(out).file.mend_plates if own.startswith("2: gain Fz")]
    assert float(gains[0].split()[-1]) == pytest.approx(1 / 1.05, abs=0.01)
    assert main(["run", str(out), "--out", str(out / "results")]) == 0
    now = mean_rms(out / "results")
    for axis in ("Fz", "My"):
        removed = (rms["faulty"][axis] - now[axis]) / (rms["faulty"][axis] - rms["healthy"][axis])
        assert 0.8 < removed < 1.2, axis
    assert main(["report", str(out / "results"), "--no-pages"]) == 0
    page = (out / "results" / "report.html").read_text(encoding="utf-8")
    assert "Effect alone" in page
    assert "2: gain Fz" in page


def mean_rms(results):
    tables = [
        residual_table(read_trial(path), "walk") for path in (results / "trials").glob("*.parquet")
    ]
    return pd.concat(tables).query("headline").groupby("axis")["rms"].mean()
