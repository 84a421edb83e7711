"""The thesis' Table III beside simulated ones: what is compared is what was processed."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from hbm.spatial import GRAVITY_MPS2
from pipeline.cli.app import app
from pipeline.run.job import Outcome
from pipeline.trial.residuals import AXES, UNITS
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells, removed
from pipeline.virtual_lab.analysis.processed_study import (
    CELLS,
    LENGTHS_S,
    after_onsets,
    cell_means,
    cells_by_subject,
    headline_cells,
    perturbed_cycles,
    process,
    study_residuals,
)
from pipeline.virtual_lab.analysis.reproduction import (
    ADDED,
    AS_IS,
    DOCUMENTED,
    ESTIMATED,
    ITEMS,
    LABORATORIES,
    Reproduction,
    compared,
    documented,
    judgements,
    reproduce,
)
from pipeline.virtual_lab.analysis.table_3_page import table_3_page
from pipeline.virtual_lab.analysis.unstated import DESIGN, POSES, unstated_at
from pipeline.virtual_lab.analysis.unstated_estimate import FITTED, Estimate
from pipeline.virtual_lab.analysis.unstated_response import (
    process_with,
    respond,
    response_steps,
)
from pipeline.virtual_lab.protocol.setting_file import find_setting
from pipeline.virtual_lab.protocol.walking_protocol import (
    SHORT,
    THESIS,
    Protocol,
    Setting,
)

UNIT = dict(zip(AXES, UNITS, strict=True))
TINY = Setting(
    protocol=Protocol(
        conditions=("sway",),
        subjects=1,
        waits_s=(12.0,),
        calibration="square_sway_60s_3mps",
        beside_s=0.0,
    )
)


ESTIMATE = Estimate(
    *(unstated_at(np.append(np.full(4, z), np.log(0.35)), "none") for z in (0.0, -1.0, 1.0)),
    ("flexibility",),
    {"channels": 90.0, "none": 52.0},
    13,
    {"channels": np.linspace(100, 450, 36), "none": np.linspace(110, 460, 36)},
    np.ones(36),
    np.full(36, 2.0),
    np.zeros(6),
)
ADDING = replace(ESTIMATE, at_edge=(), added=np.arange(1.0, 7.0), misfit={"channels": 9, "none": 8})


def residuals(laboratory, offset=0.0, window="cycle", headline=True, conditions=CELLS):
    """Two subjects, 1 apart: means of 100 and more, each cell its own."""
    rows = [
        (laboratory, subject, c, ic, window, headline, a, UNIT[a], 100 + offset + 10 * k + number)
        for k, (c, ic, a) in enumerate(conditions)
        for number, subject in enumerate(("sub01", "sub02"))
    ]
    names = ["laboratory", "subject", "condition", "compensated", "window", "headline", "axis"]
    return pd.DataFrame(rows, columns=[*names, "unit", "rms"])


@pytest.fixture
def found():
    after = [
        (laboratory, subject, ic, length_s, axis, 100 / length_s)
        for laboratory in LABORATORIES
        for subject in ("sub01", "sub02")
        for ic in (False, True)
        for length_s in LENGTHS_S
        for axis in AXES
    ]
    single = [
        (item, c, ic, a, 10.0 + number * (a in ("Fz", "My")))
        for number, item in enumerate(("none", *ITEMS))
        for c, ic, a in CELLS
    ]
    tables = [residuals(AS_IS), residuals(DOCUMENTED, 5.0), residuals(ESTIMATED, -70.0)]
    return Reproduction(
        Setting(),
        pd.concat(tables, ignore_index=True),
        pd.DataFrame(
            after, columns=["laboratory", "subject", "compensated", "length_s", "axis", "rms"]
        ),
        ESTIMATE,
        ADDING,
        judgements(*map(headline_cells, tables[1:]), ESTIMATE, ADDING),
        pd.DataFrame(single, columns=["item", "condition", "compensated", "axis", "rms"]),
        cycle_s=1.1,
        running=running(),
    )


def running():
    """Beside a runner: twice the flexibility, twice the force."""
    rows = [
        (f, 12.0 / f, 16.0 / f, filtered, *(f * np.array([4, 2, 8]) / (1 + filtered)))
        for f in (1.0, 4.0)
        for filtered in (False, True)
    ]
    names = ["flexibility", "sway_hz", "pitch_hz", "filtered", "forward", "left", "up"]
    return pd.DataFrame(rows, columns=names)


def test_the_items_together_are_the_shipped_setting():
    assert documented(Setting(protocol=THESIS)) == find_setting(Path("thesis"))
    delayed = documented(Setting(), "plates late by 4 and 2 ms")
    assert delayed.faults.plates.delays_s == (0.004, 0.002)
    assert delayed.protocol == Setting().protocol


def test_every_one_of_the_36_cells_stands_beside_the_printed_one(found):
    table = compared(found)
    assert table.groupby("laboratory").size().to_dict() == {name: 36 for name in LABORATORIES}
    cell = table.set_index(["laboratory", "axis", "condition", "compensated"]).sort_index()
    fy = cell.loc[(AS_IS, "Fy", "sway", False)]
    assert (fy["mean_thesis"], fy["sd_thesis"]) == (435.5, 15.3)
    assert (fy["mean"], fy["n"]) == (100 + 10 * CELLS.get_loc(("sway", False, "Fy")) + 0.5, 2)
    assert fy["sd"] == pytest.approx(np.sqrt(0.5))
    off = (table["mean"] - table["mean_thesis"]).abs()
    assert (table["within"] == (off <= table["sd_thesis"])).all()
    assert 0 < table["within"].sum() < 108
    fitted = table[table["fitted"]]
    assert len(fitted) == 18
    assert set(fitted["laboratory"]) == {ESTIMATED}
    assert not fitted["compensated"].any()


def test_the_page_shows_every_cell_and_marks_those_within_the_printed_range(found):
    page, table = table_3_page(found), compared(found)
    assert not re.search(r"[{}]|nan", page)
    cells = [row for row in page.splitlines() if row.count("|") == 11 and "±" in row]
    assert len(cells) == 18
    shown = sum(row.count("**") // 2 for row in cells)
    judged = table["compensated"] & (table["laboratory"] != AS_IS)
    assert shown == (table["within"] & ~table["fitted"] & ~judged).sum()
    for name, label in ((AS_IS, "as it is"), (DOCUMENTED, "documented")):
        count = table.loc[table["laboratory"] == name, "within"].sum()
        assert f"{count} {label}" in page
    angle = np.radians(10) * np.sin(np.arange(0, 2 * np.pi, 0.001))
    assert f"is {300 * 9.80665 * np.sin(angle).std():.0f} N" in page
    largest = page.split(f"| {list(ITEMS)[1]} |")[1].splitlines()[0]
    assert largest.count("Fz +2.0, My +2.0") == 6


def test_where_sway_has_two_windows_both_are_shown_and_the_headline_alone_counts(found):
    sway = [cell for cell in CELLS if cell[0] == "sway"]
    names = {AS_IS: "motion", DOCUMENTED: "motion", ESTIMATED: "0 to 0.35 s"}
    more = [residuals(name, 0.0, window, True, sway) for name, window in names.items()]
    own = found.residuals.assign(headline=found.residuals["condition"] != "sway")
    both = replace(found, residuals=pd.concat([own, *more], ignore_index=True))
    page = table_3_page(both)
    rows = [line.split(" | ")[1] for line in page.splitlines() if line.count("|") == 11]
    assert rows[2:6] == ["baseline", "sway", "sway (cycle)", "pitch"]
    text = " ".join(page.split())
    assert "In sway, the motion of the platform counts" in text
    assert "in the estimated laboratory the first 0.35 s after an onset" in text
    table = compared(both)
    assert table[table["headline"]].groupby("laboratory").size().tolist() == [36, 36, 36]


def test_the_page_shows_the_estimates_and_judges_by_the_cells_that_were_not_fitted(found):
    page = table_3_page(found)
    part = page.split("## What the thesis does not state")[1].split("\n## ")[0]
    text = " ".join(part.split())
    flexibility = "| flexibility of the structure | 1, of a real treadmill | 1.0 to 16.0 |"
    assert f"{flexibility} 4.0, at the edge | not determined | 4.0 | not determined |" in part
    mass = "| mass of each belt assembly [kg] | 150, stated | 136 to 165 | 150 |"
    assert f"{mass} not determined | 150 |" in part
    assert "52 for 13 degrees of freedom, 90 with it; if" in text
    assert "constant residual 1.0, 2.0, 3.0 N and 4.0, 5.0, 6.0 N·m" in text
    assert "| 4.0 | 3.0, 4.0 | 16.0, 8.0, 32.0 | 8.0, 4.0, 16.0 |" in part
    assert "at 4.0 at least 2.1 times" in text
    rows = [line.split(" | ") for line in part.splitlines() if "(±" in line]
    assert [row[1] for row in rows[:5]] == [condition for condition, _ in removed(printed_cells())]
    assert len(rows) == 18
    for column, (laboratory, cells) in enumerate(found.judged.groupby("laboratory", sort=False)):
        own = [row[3 + column] for row in rows]
        for verdict in ("explained", "undecided"):
            assert sum(verdict in cell for cell in own) == cells[verdict].sum(), laboratory
    unexplained = text.split("*Unexplained* remain, in the estimated laboratory: ")[1]
    judged = found.judged[found.judged["laboratory"] == ESTIMATED]
    assert not judged["explained"].all()
    for cell in judged[~judged["explained"] & ~judged["undecided"]].itertuples():
        assert cell.axis in unexplained.split(f"{cell.condition} ")[1].split(";")[0]


def test_a_constant_residual_is_judged_by_what_is_interpolated_with_it():
    tables = [headline_cells(residuals(name)) for name in LABORATORIES[1:]]
    judged = judgements(*tables, ESTIMATE, ADDING).set_index("laboratory")
    assert judged.index.unique().tolist() == [DOCUMENTED, ESTIMATED, ADDED]
    expected = ADDING.predicted["none"][~FITTED]
    assert judged.loc[ADDED, "simulated"].to_numpy() == pytest.approx(expected)
    other = judgements(*tables, replace(ESTIMATE, error=np.full(36, 9.0)), ADDING)
    other = other.set_index("laboratory")["tolerance"]
    assert (other.loc[ESTIMATED] > judged.loc[ESTIMATED, "tolerance"]).all()
    for name in (DOCUMENTED, ADDED):
        assert (other.loc[name] == judged.loc[name, "tolerance"]).all()
    rough = replace(ADDING, interpolation=np.full(36, 9.0))
    other = judgements(*tables, ESTIMATE, rough).set_index("laboratory")["tolerance"]
    assert (other.loc[ADDED] > judged.loc[ADDED, "tolerance"]).all()
    assert (other.loc[ESTIMATED] == judged.loc[ESTIMATED, "tolerance"]).all()


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Results of one simulated sway trial, and the steps that were shown."""
    steps = []
    return process(TINY, tmp_path_factory.mktemp("lab"), 1, steps.append), steps


def test_a_study_is_simulated_and_processed_as_hbm_run_does(stored):
    paths, steps = stored
    assert [path.name for path in paths] == ["sub01_sway.parquet"]
    assert steps == ["calibration.c3d", "sub01_sway.c3d", "done sub01 sway"]
    means = cell_means(study_residuals(paths)).set_index(["compensated", "axis"])["rms"]
    assert means[False, "Fy"] > 10 * means[True, "Fy"]
    assert perturbed_cycles(paths) == pytest.approx([1.1], abs=0.1)


def test_the_shorter_the_window_after_an_onset_the_larger_what_the_treadmill_adds(stored):
    """The platform accelerates when it starts and when it stops, and rests for the remainder."""
    table = after_onsets(stored[0]).set_index(["compensated", "axis", "length_s"])["rms"]
    table = table.sort_index()
    artefact, body = table[False, "Fy"], table[True, "Fy"]
    assert artefact[0.3] > artefact[0.5] > artefact[0.9] > 200
    assert body.max() < 30
    squares = artefact**2 * artefact.index.to_numpy()
    assert squares[0.9] == pytest.approx(squares[0.5], rel=0.1)


def test_without_the_pose_the_weight_of_a_person_stays_where_the_platform_was(stored, tmp_path):
    """5 cm beside it, for most of 0.9 s."""
    shutil.copytree(stored[0][0].parents[2] / "study", tmp_path / "study")
    setting = unstated_at(np.append(np.zeros(4), np.log(0.9)), "none").apply(TINY)
    paths = process_with(setting, tmp_path, "none", 1, lambda _: None)
    mx = [
        after_onsets(own).set_index(["compensated", "axis", "length_s"])["rms"][True, "Mx", 0.9]
        for own in (stored[0], paths)
    ]
    weight_n = 83.0 * GRAVITY_MPS2
    assert mx[0] < 0.015 * weight_n
    assert 0.03 * weight_n < np.sqrt(mx[1] ** 2 - mx[0] ** 2) < 0.05 * weight_n


def test_a_trial_that_fails_ends_the_comparison_with_its_reason(tmp_path, monkeypatch, stored):
    def fail(planned, **_):
        return (Outcome(job, "failed", "no markers") for job in planned)

    monkeypatch.setattr("pipeline.run.run.run_jobs", fail)
    with pytest.raises(ValueError, match=r"sub01 sway.*no markers"):
        process(TINY, stored[0][0].parents[2], 1, lambda _: None)


def test_the_cells_of_a_study_are_laid_out_by_subject_window_and_key():
    cells = residuals("")
    after = pd.DataFrame(
        [
            (subject, ic, length_s, axis, 1 / length_s)
            for subject in ("sub02", "sub01")
            for ic in (False, True)
            for length_s in LENGTHS_S
            for axis in AXES
        ],
        columns=["subject", "compensated", "length_s", "axis", "rms"],
    )
    table = cells_by_subject(cells, after)
    assert table.shape == (2, len(LENGTHS_S), 36)
    sway = CELLS.get_level_values("condition") == "sway"
    assert table[:, 2, sway] == pytest.approx(1 / LENGTHS_S[2])
    expected = [100 + 10 * np.arange(36) + number for number in (0, 1)]
    assert table[:, 5, ~sway] == pytest.approx(np.array(expected)[:, ~sway])
    assert headline_cells(cells) == pytest.approx(np.array(expected))


@pytest.fixture
def quick(monkeypatch):
    """Studies that take no time: settings of what would be simulated and what processed."""
    simulated, again = [], []

    def simulate(setting, folder, jobs, step):
        simulated.append(setting)
        (folder / "study").mkdir()
        step("sub01_sway.c3d")
        return []

    def process_once_more(study, results, jobs, step):
        again.append((study / "study.toml").read_text(encoding="utf-8"))
        step("done sub01 sway")
        return []

    after = [
        (subject, ic, length_s, axis, 100 / length_s)
        for subject in ("sub01", "sub02")
        for ic in (False, True)
        for length_s in LENGTHS_S
        for axis in AXES
    ]
    columns = ["subject", "compensated", "length_s", "axis", "rms"]
    analysis = "pipeline.virtual_lab.analysis."
    for module in ("reproduction.", "unstated_response."):
        monkeypatch.setattr(analysis + module + "process", simulate)
        monkeypatch.setattr(analysis + module + "study_residuals", lambda _: residuals(""))
        monkeypatch.setattr(
            analysis + module + "after_onsets", lambda _: pd.DataFrame(after, columns=columns)
        )
    monkeypatch.setattr(analysis + "unstated_response.process_study", process_once_more)
    monkeypatch.setattr(analysis + "reproduction.perturbed_cycles", lambda _: [1.0, 1.2])
    return simulated, again


def test_every_point_is_simulated_once_and_processed_with_and_without_the_pose(quick):
    simulated, again = quick
    steps = []
    level = np.full((2, len(LENGTHS_S), 36), 50.0) * np.array([0.9, 1.1])[:, None, None]
    responses = respond(documented(Setting(seed=4, protocol=THESIS)), level, 1, steps.append)
    assert len(steps) == len(simulated) + len(again) == 2 * len(DESIGN)
    assert all("[treadmill.platform]" not in text for text in again)
    assert {own.seed for own in simulated} == {4}
    assert {own.protocol.filter for own in simulated} == {"realtime"}
    machines = [own.faults.machine for own in simulated]
    assert {machine.flexibility for machine in machines} == {1.0, 4.0, 16.0}
    assert {machine.sway_hz for machine in machines} == {4.0, 7.0, 12.25}
    x = np.append(np.zeros(4), np.log(0.3))
    for pose in POSES:
        assert responses[pose].at(x) == pytest.approx(50.0)
        assert responses[pose].error == pytest.approx(0.1)


def test_studies_are_simulated_with_everything_documented_estimated_and_with_one_item_each(
    quick, monkeypatch
):
    simulated, steps = quick[0], []
    module = "pipeline.virtual_lab.analysis.reproduction."
    monkeypatch.setattr(module + "respond", lambda *_: {})
    machines = []
    monkeypatch.setattr(module + "beside_a_runner", lambda f: machines.extend(f) or running())
    monkeypatch.setattr(module + "estimate", lambda *_, adding=False: (ESTIMATE, ADDING)[adding])
    thesis = Setting(seed=4, protocol=THESIS)
    found = reproduce(thesis, progress=lambda *step: steps.append(step))
    lab = documented(thesis)
    assert simulated[:3] == [thesis, lab, ESTIMATE.value.apply(lab)]
    short = Setting(seed=4, protocol=SHORT)
    assert simulated[3:] == [short, *(documented(short, item) for item in ITEMS)]
    total = 3 * (1 + 2 * 27) + 6 * (1 + 2 * 9) + response_steps()
    assert response_steps() == 15 * (1 + 3 * 9)
    assert steps[-1] == ("sub01_sway.c3d", len(simulated), total)
    assert found.residuals["laboratory"].unique().tolist() == list(LABORATORIES)
    assert found.judged["laboratory"].unique().tolist() == [DOCUMENTED, ESTIMATED, ADDED]
    assert (found.unstated, found.unstated_adding) == (ESTIMATE, ADDING)
    assert found.single["item"].unique().tolist() == ["none", *ITEMS]
    assert found.cycle_s == pytest.approx(1.1)
    assert machines == [1.0, 4.0]
    with pytest.raises(ValueError, match=r"lacks baseline, pitch"):
        reproduce(TINY)
    with pytest.raises(ValueError, match=r"subjects is below 2"):
        reproduce(Setting(protocol=Protocol(subjects=1)))


def test_one_command_writes_the_page_and_its_table(tmp_path, monkeypatch, found):
    arguments = {}

    def quick(setting, progress, jobs):
        arguments.update(setting=setting, jobs=jobs)
        return found

    monkeypatch.setattr("pipeline.virtual_lab.analysis.reproduction.reproduce", quick)
    command = ["simulate", str(tmp_path), "--table-3", "--subjects", "2", "--jobs", "1"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert arguments == {"setting": Setting(protocol=Protocol(subjects=2, beside_s=0.0)), "jobs": 1}
    assert (tmp_path / "table_3.md").read_text(encoding="utf-8") == table_3_page(found)
    assert len(pd.read_csv(tmp_path / "table_3.csv")) == 108
    both = CliRunner().invoke(app, [*command, "--ablation"])
    assert both.exit_code != 0
