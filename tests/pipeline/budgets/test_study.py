"""Explanations of a study are taken up again where they stopped, and one failure stops no other."""

import gzip
import re
import shutil
from dataclasses import replace
from html import unescape

import numpy as np
import pandas as pd
import pytest

from pipeline.budgets.explanation import (
    BANDS,
    EVIDENCE,
    FOLDER,
    Explanation,
    bands_of,
    beside,
    explain_planned,
    plan_explanations,
    read_bands,
    read_evidence,
    read_explanation,
    study_of,
)
from pipeline.cli.app import main
from pipeline.config.schema import Treadmill
from pipeline.config.study import read_study
from pipeline.report.write import write_report
from pipeline.run.run import run_study
from pipeline.run.store import read_trial
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import residual_table


@pytest.fixture(scope="module")
def study(moving_study, tmp_path_factory):
    """Two trials of one subject and their results, in a folder of their own."""
    folder = shutil.copytree(moving_study, tmp_path_factory.mktemp("own") / "study")
    for path in folder.glob("sub02*"):
        path.unlink()
    subject = folder / "sub01.toml"
    text = subject.read_text()
    subject.write_text(text.replace('file = "sub01_pitch.c3d"', 'exclude = "not recorded"'))
    out = folder.parent / "results"
    assert len(list(run_study(read_study(folder), out))) == 2
    return folder, out


@pytest.fixture(scope="module")
def explained(study):
    """The same, explained."""
    out = study[1]
    assert main(["explain", str(out)]) == 0
    return out


@pytest.fixture
def copy(study, explained, tmp_path):
    """A copy of study, results and explanations, to be changed."""
    shutil.copytree(study[0], tmp_path / "study")
    return shutil.copytree(explained, tmp_path / "results")


@pytest.fixture
def known(copy, monkeypatch):
    """Trials are explained as they were: what that takes is not tested here."""
    explained = {}
    for name in ("baseline", "sway"):
        path = copy / FOLDER / f"sub01_{name}.json"
        own = read_explanation(path, Explanation)
        evidence = read_evidence(beside(path, EVIDENCE))
        bands = read_bands(beside(path, BANDS))
        explained[name] = replace(own, budget=replace(own.budget, evidence=evidence, bands=bands))

    def explain(recording, laboratory, result, key):
        return replace(explained[result.condition], key=key)

    monkeypatch.setattr("pipeline.budgets.explanation.explain", explain)


def outcomes(out):
    return explain_planned(plan_explanations(study_of(out), out), out)


def states(out):
    return {outcome.job.name.condition: outcome.state for outcome in outcomes(out)}


def report(out):
    return unescape(write_report(out, out.parent / "study").read_text(encoding="utf-8"))


def test_every_trial_is_explained_once_though_a_run_was_interrupted(copy, known):
    assert states(copy) == {"baseline": "kept", "sway": "kept"}
    shutil.rmtree(copy / FOLDER)
    assert next(outcomes(copy)).state == "done"
    assert sorted(states(copy).values()) == ["done", "kept"]
    (copy / FOLDER / "sub01_sway.json").write_text("{")
    assert states(copy) == {"baseline": "kept", "sway": "done"}


def test_the_laboratory_is_read_once_for_all_trials(copy, known, monkeypatch):
    name, read = "pipeline.budgets.explanation.read_study_laboratory", []
    monkeypatch.setattr(name, lambda study: read.append(study) or Laboratory(Treadmill()))
    shutil.rmtree(copy / FOLDER)
    assert states(copy) == {"baseline": "done", "sway": "done"}
    assert len(read) == 1


def test_a_result_has_bands_while_its_explanation_is_of_it(copy):
    path = copy / "trials" / "sub01_baseline.parquet"
    trial = read_trial(path, frames=False)
    bands = bands_of(path, trial)
    assert len(np.unique(bands.cycle)) >= 4
    assert (bands.deviation > 0).all()
    assert bands_of(path, replace(trial, key="of another result")) is None


def test_a_trial_whose_recording_is_gone_stops_no_other(copy, capsys, undrawn):
    (copy.parent / "study" / "sub01_sway.c3d").unlink()
    (copy / FOLDER / "sub01_sway.json").unlink()
    assert main(["explain", str(copy)]) == 1
    assert re.search(r"\b1 .*, 1 failed", capsys.readouterr().out)
    assert re.search(r"sub01 sway: .*sub01_sway\.c3d is missing", report(copy))


def test_an_explanation_outlives_its_recording(copy):
    (copy.parent / "study" / "sub01_sway.c3d").unlink()
    assert states(copy)["sway"] == "kept"


def test_a_result_that_is_not_of_the_study_any_more_is_not_explained(copy, known):
    file = copy.parent / "study" / "sub01.toml"
    file.write_text(file.read_text().replace('sex = "', 'height_m = 1.9\nsex = "'))
    shutil.rmtree(copy / FOLDER)
    planned = plan_explanations(study_of(copy), copy)
    reasons = {outcome.reason for outcome in explain_planned(planned, copy)}
    (reason,) = reasons
    command = reason.removeprefix("its result is not up to date; next: hbm ")
    assert main([*command.split(), "--quiet"]) == 0
    assert {outcome.state for outcome in explain_planned(planned, copy)} == {"done"}


def test_where_no_trial_is_explained_no_corrected_study_is_written(copy, tmp_path, capsys):
    file = copy.parent / "study" / "sub01.toml"
    file.write_text(file.read_text().replace('sex = "', 'height_m = 1.9\nsex = "'))
    shutil.rmtree(copy / FOLDER)
    assert main(["explain", str(copy), "--apply", str(tmp_path / "corrected")]) == 2
    expected = "no trial was explained: "
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "corrected").exists()


def test_a_folder_without_results_gives_one_line(copy, capsys):
    shutil.rmtree(copy / "trials")
    assert main(["explain", str(copy)]) == 2
    error = capsys.readouterr().err
    assert "no results" in error
    assert error.count("\n") == 1


def test_a_report_of_explained_trials_has_their_causes_and_intervals_of_measurement(copy, undrawn):
    page = report(copy)
    section = page.partition('<section id="causes">')[2].partition("</section>")[0]
    assert "Held-out check: " in section
    table = pd.read_csv(copy / "table_3.csv").query("n > 0").set_index(["axis", "condition"])
    sds = table.filter(like="measurement_sd_")
    assert (sds["measurement_sd_mean_ic"] > 0).all()
    compared = table.index.get_level_values("condition") != "baseline"
    assert (sds["measurement_sd_ic_minus_baseline_no_ic"].notna() == compared).all()
    assert "interval of measurement" in page


def test_a_report_says_which_explanations_it_does_not_show_and_what_adds_them(copy, undrawn):
    (copy / FOLDER / "sub01_sway.json").write_text("{")
    page = report(copy)
    assert page.count("of sub01 sway: ") == 1
    assert not [name for name in pd.read_csv(copy / "table_3.csv") if "measurement" in name]
    assert re.search("'hbm explain RESULTS' .*1 of 2 trials", page)


def test_the_uncertainty_of_a_perturbed_trial_is_also_of_the_part_that_counts(explained):
    budgets = {
        name: read_explanation(explained / FOLDER / f"sub01_{name}.json", Explanation).budget
        for name in ("baseline", "sway")
    }
    assert budgets["baseline"].of_window == ()
    trial = read_trial(explained / "trials" / "sub01_sway.parquet")
    rows = list(residual_table(trial, "sway").itertuples())
    for window, values in (
        ("motion", budgets["sway"].of_window),
        ("cycle", budgets["sway"].uncertainty),
    ):
        for own in values:
            rms = [r.rms for r in rows if (r.window, r.compensated) == (window, own.compensated)]
            np.testing.assert_allclose(own.rms, rms, rtol=0.5)  # of one side's cycles
            loads = np.array(rms) > 100
            np.testing.assert_allclose(own.rms[loads], np.array(rms)[loads], rtol=0.05)


def test_damaged_evidence_is_named_with_what_to_do(explained, tmp_path):
    whole = beside(explained / FOLDER / "sub01_sway.json", EVIDENCE).read_bytes()
    path = tmp_path / "sub01_sway_evidence.json.gz"
    for damaged in (whole[:-100], whole[:50], b"", b"{}", gzip.compress(b"{}")):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"sub01_sway_evidence.*'hbm explain'"):
            read_evidence(path)
