"""Several recordings per condition and session, some missing, all enter a study's results."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
from tests.overground_walk import simulate_overground
from tests.pipeline.fake_results import without_figures
from tests.pipeline.virtual_study import write_recording

pytestmark = pytest.mark.slow

RECORDINGS = ("01", "02", "03")
PEOPLE = {"s1": PERSONS[0], "s2": PERSONS[1], "s3": PERSONS[2], "s4": PERSONS[4]}
FAILING, MISSING = "s1 floor 02", "s2 treadmill"
STUDY = """\
name = "Floor and treadmill"
[settings]
marker_set = "hbm2"
[conditions.floor]
[conditions.treadmill]
skip_s = 6.0
[comparison]
levels = ["floor", "treadmill"]
reference = "floor"
covariates = []
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("repeated") / "study"
    folder.mkdir()
    (folder / "study.toml").write_text(STUDY)
    for number, (name, person) in enumerate(PEOPLE.items()):
        lines = [f'id = "{name}"', f'sex = "{person.sex}"', f"mass_kg = {person.mass_kg:.2f}"]
        for k, recording in enumerate(RECORDINGS):
            session = f'session = "{"before" if k < 2 else "after"}"'
            seed = 20 * number + k
            walk = simulate_overground(person, plates=4, seed=seed, body_seed=number)
            write_recording(walk.walk, folder / f"{name}_floor_{recording}.c3d")
            if k == 0:
                write_recording(walk.static, folder / f"{name}_static.c3d")
                lines.insert(3, f'static = "{name}_static.c3d"')
            lines += ["[[trials.floor]]", f'file = "{name}_floor_{recording}.c3d"', session]
            if f"{name} treadmill" != MISSING:
                path = folder / f"{name}_treadmill_{recording}.c3d"
                simulate_trial(path, person=person, duration_s=12.0, seed=seed)
                lines += ["[[trials.treadmill]]", f'file = "{path.name}"', session]
        (folder / f"{name}.toml").write_text("\n".join(lines))
    damaged = folder / f"{FAILING}.c3d".replace(" ", "_")
    damaged.write_bytes(damaged.read_bytes()[:5000])
    return folder


@pytest.fixture(scope="module")
def results(study, tmp_path_factory):
    out = tmp_path_factory.mktemp("repeated") / "results"
    assert main(["run", str(study), "--jobs", "2", "--out", str(out)]) == 1
    with without_figures():
        assert main(["report", str(out), "--no-pages"]) == 0
    return out


def test_the_check_names_the_recording_that_fails(study, capsys):
    assert main(["check", str(study)]) == 2
    faults = [line for line in capsys.readouterr().out.splitlines() if line.startswith("FAULT")]
    assert len(faults) == 1
    assert FAILING.replace(" ", "_") in faults[0]


def test_only_the_failed_recording_is_lost(results):
    assert list(json.loads((results / "failures.json").read_text())) == [FAILING]
    residuals = pd.read_csv(results / "residuals.csv", dtype={"recording": str})
    trials = residuals[["subject", "condition", "recording", "session"]].drop_duplicates()
    assert len(trials) == len(RECORDINGS) * (2 * len(PEOPLE) - 1) - 1
    of_first = trials[(trials["subject"] == "s1") & (trials["condition"] == "floor")]
    assert of_first["recording"].tolist() == ["01", "03"]
    assert of_first["session"].tolist() == ["before", "after"]


def test_a_second_run_keeps_what_is_there_and_tries_the_failed_one_again(study, results):
    before = {path.name: path.read_bytes() for path in (results / "trials").iterdir()}
    assert main(["run", str(study), "--out", str(results)]) == 1
    assert {path.name: path.read_bytes() for path in (results / "trials").iterdir()} == before


def test_the_value_of_a_subject_is_the_rms_over_all_gait_cycles_of_its_recordings(results):
    long = pd.read_csv(results / "residuals.csv", dtype={"recording": str})
    wide = pd.read_csv(results / "residuals_wide.csv").set_index("subject")
    own = long[(long["condition"] == "floor") & long["headline"] & (long["axis"] == "Fz")]
    assert set(own["window"]) == {"cycle"}
    for subject, rows in own.groupby("subject"):
        expected = np.sqrt(np.average(rows["rms"] ** 2, weights=rows["n_cycles"]))
        assert wide.loc[subject, "Fz_floor"] == pytest.approx(expected, rel=1e-5)


def test_mixed_models_use_every_recording_and_the_anova_says_whom_it_leaves_out(results):
    tests = pd.read_csv(results / "statistics.csv")
    mixed = tests[(tests["test"] == "mixed model") & (tests["statistic_name"] == "t")]
    assert set(mixed["axis"]) == {"Fx", "Fy", "Fz", "Mx", "My", "Mz"}
    assert (mixed["n"] == len(PEOPLE)).all()
    assert (mixed["note"] == "20 recordings").all()
    anova = tests[tests["test"] == "RM-ANOVA"]
    assert (anova["n"] == len(PEOPLE) - 1).all()
    assert anova["note"].str.contains("without s2 (", regex=False).all()


def test_reliability_is_between_sessions_for_residuals_and_joints(results):
    found = pd.read_csv(results / "reliability.csv")
    assert {"Fx", "Mz", "knee flexion, largest moment"} <= set(found["name"])
    of_residuals = found[found["name"].isin(["Fx", "Fy", "Fz"])]
    assert (of_residuals["repeated"] == "session").all()
    assert of_residuals.set_index("condition").loc["floor", "n_subjects"].eq(len(PEOPLE)).all()
    assert (found["smallest_detectable_change"].dropna() > 0).all()


def test_the_plan_answers_for_other_numbers_of_recordings(results):
    plan = pd.read_csv(results / "plan.csv")
    needed = plan[[f"needed_with_{k}" for k in (1, 2, 3, 5, 10)]].fillna(np.inf).to_numpy()
    assert (np.diff(needed, axis=1)[np.isfinite(needed[:, 1:])] <= 0).all()


def test_the_report_names_what_is_missing_and_the_methods_how_it_was_used(results):
    page = re.sub(r"<[^>]+>|\s+", " ", (results / "report.html").read_text(encoding="utf-8"))
    for words in (FAILING, "treadmill without s2", "mixed models of all recordings"):
        assert words in page
