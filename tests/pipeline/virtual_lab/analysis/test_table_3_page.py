"""The thesis' Table III beside simulated ones: what is compared is what was processed."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.run.job import Outcome
from pipeline.trial.residuals import AXES, UNITS
from pipeline.virtual_lab.analysis.reproduction import (
    AS_IS,
    DOCUMENTED,
    ITEMS,
    LENGTHS_S,
    Reproduction,
    after_onsets,
    cell_means,
    compared,
    documented,
    perturbed_cycles,
    process,
    reproduce,
    study_residuals,
)
from pipeline.virtual_lab.analysis.table_3_page import table_3_page
from pipeline.virtual_lab.protocol.setting_file import find_setting
from pipeline.virtual_lab.protocol.walking_protocol import (
    ANALYSED_CONDITIONS,
    SHORT,
    THESIS,
    Protocol,
    Setting,
)

UNIT = dict(zip(AXES, UNITS, strict=True))
CELLS = [(c, ic, a) for c in ANALYSED_CONDITIONS for ic in (False, True) for a in AXES]
TINY = Setting(
    protocol=Protocol(
        conditions=("sway",),
        subjects=1,
        waits_s=(12.0,),
        calibration="square_sway_60s_3mps",
        beside_s=0.0,
    )
)


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
        for laboratory in (AS_IS, DOCUMENTED)
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
    return Reproduction(
        Setting(),
        pd.concat([residuals(AS_IS), residuals(DOCUMENTED, 5.0)], ignore_index=True),
        pd.DataFrame(
            after, columns=["laboratory", "subject", "compensated", "length_s", "axis", "rms"]
        ),
        pd.DataFrame(single, columns=["item", "condition", "compensated", "axis", "rms"]),
        cycle_s=1.1,
    )


def test_the_items_together_are_the_shipped_setting():
    assert documented(Setting(protocol=THESIS)) == find_setting(Path("thesis"))
    delayed = documented(Setting(), "plates late by 4 and 2 ms")
    assert delayed.faults.plates.delays_s == (0.004, 0.002)
    assert delayed.protocol == Setting().protocol


def test_every_one_of_the_36_cells_stands_beside_the_printed_one(found):
    table = compared(found)
    assert table.groupby("laboratory").size().to_dict() == {AS_IS: 36, DOCUMENTED: 36}
    cell = table.set_index(["laboratory", "axis", "condition", "compensated"]).sort_index()
    fy = cell.loc[(AS_IS, "Fy", "sway", False)]
    assert (fy["mean_thesis"], fy["sd_thesis"]) == (435.5, 15.3)
    assert (fy["mean"], fy["n"]) == (100 + 10 * CELLS.index(("sway", False, "Fy")) + 0.5, 2)
    assert fy["sd"] == pytest.approx(np.sqrt(0.5))
    off = (table["mean"] - table["mean_thesis"]).abs()
    assert (table["within"] == (off <= table["sd_thesis"])).all()
    assert 0 < table["within"].sum() < 72


def test_the_page_shows_every_cell_and_marks_those_within_the_printed_range(found):
    page, table = table_3_page(found), compared(found)
    assert not re.search(r"[{}]|nan", page)
    cells = [row for row in page.splitlines() if row.count("|") == 9 and "±" in row]
    assert len(cells) == 18
    shown = sum(row.count("**") // 2 for row in cells)
    assert shown == table["within"].sum()
    for name, label in ((AS_IS, "as it is"), (DOCUMENTED, "documented")):
        count = table.loc[table["laboratory"] == name, "within"].sum()
        assert f"{count} {label}" in page
    angle = np.radians(10) * np.sin(np.arange(0, 2 * np.pi, 0.001))
    assert f"is {300 * 9.80665 * np.sin(angle).std():.0f} N" in page
    largest = page.split(f"| {list(ITEMS)[1]} |")[1].splitlines()[0]
    assert largest.count("Fz +2.0, My +2.0") == 6


def test_where_sway_has_two_windows_both_are_shown_and_the_headline_alone_counts(found):
    sway = [cell for cell in CELLS if cell[0] == "sway"]
    more = [residuals(name, 0.0, "motion", True, sway) for name in (AS_IS, DOCUMENTED)]
    own = found.residuals.assign(headline=found.residuals["condition"] != "sway")
    both = Reproduction(
        found.setting, pd.concat([own, *more], ignore_index=True), found.windows, found.single, 1.1
    )
    page = table_3_page(both)
    rows = [line.split(" | ")[1] for line in page.splitlines() if line.count("|") == 9]
    assert rows[2:6] == ["baseline", "sway (motion)", "sway (cycle)", "pitch"]
    assert "In sway, the motion of the platform counts" in page
    table = compared(both)
    assert table[table["headline"]].groupby("laboratory").size().tolist() == [36, 36]


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


def test_a_trial_that_fails_ends_the_comparison_with_its_reason(tmp_path, monkeypatch, stored):
    def fail(planned, **_):
        return (Outcome(job, "failed", "no markers") for job in planned)

    monkeypatch.setattr("pipeline.run.run.run_jobs", fail)
    with pytest.raises(ValueError, match=r"sub01 sway.*no markers"):
        process(TINY, stored[0][0].parents[2], 1, lambda _: None)


def test_studies_are_simulated_with_everything_documented_and_with_one_item_each(monkeypatch):
    """Nine steps of each study are shown, and the results are told apart."""
    settings, steps = [], []

    def quick(setting, folder, jobs, step):
        settings.append(setting)
        step("sub01_sway.c3d")
        return []

    module = "pipeline.virtual_lab.analysis.reproduction."
    table = residuals("")
    after = pd.DataFrame({"length_s": [0.2], "rms": [1.0]})
    monkeypatch.setattr(module + "process", quick)
    monkeypatch.setattr(module + "study_residuals", lambda _: table)
    monkeypatch.setattr(module + "after_onsets", lambda _: after)
    monkeypatch.setattr(module + "perturbed_cycles", lambda _: [1.0, 1.2])
    thesis = Setting(seed=4, protocol=THESIS)
    found = reproduce(thesis, progress=lambda *step: steps.append(step))
    assert settings[:2] == [thesis, documented(thesis)]
    short = Setting(seed=4, protocol=SHORT)
    assert settings[2:] == [short, *(documented(short, item) for item in ITEMS)]
    assert len(steps) == len(settings)
    assert steps[-1] == ("sub01_sway.c3d", 8, 2 * (1 + 2 * 27) + 6 * (1 + 2 * 9))
    assert found.residuals["laboratory"].unique().tolist() == [AS_IS, DOCUMENTED]
    assert found.single["item"].unique().tolist() == ["none", *ITEMS]
    assert found.cycle_s == pytest.approx(1.1)
    with pytest.raises(ValueError, match=r"lacks baseline, pitch"):
        reproduce(TINY)


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
    assert len(pd.read_csv(tmp_path / "table_3.csv")) == 72
    both = CliRunner().invoke(app, [*command, "--ablation"])
    assert both.exit_code != 0
