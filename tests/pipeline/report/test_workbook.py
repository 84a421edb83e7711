"""Tables for other programs hold the same numbers, in a workbook and with a row per subject."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from openpyxl import load_workbook

from pipeline.cli.app import main
from pipeline.io.write import read_csv, read_parquet
from pipeline.report.workbook import described, write_workbook
from pipeline.report.write import write_report
from pipeline.run.store import write_trial
from tests.pipeline.fake_results import fake_trial


@pytest.fixture(scope="module", autouse=True)
def short_curves():
    """Curves have six instants instead of 101: a sheet takes long to write and to read."""
    with pytest.MonkeyPatch.context() as patch:
        few = lambda path: read_parquet(path).query("percent % 20 == 0")  # noqa: E731
        patch.setattr("pipeline.report.workbook.read_parquet", few)
        yield


@pytest.fixture(scope="module")
def exported(results, short_curves, tmp_path_factory):
    out = tmp_path_factory.mktemp("tables")
    assert main(["export", str(results), "--format", "tables", "--out", str(out)]) == 0
    return out


def test_the_workbook_holds_every_table(exported):
    sheets = pd.read_excel(exported / "study.xlsx", sheet_name=None)
    assert set(sheets) == {path.stem for path in exported.glob("*.csv")}
    assert {"residuals", "joints", "statistics", "columns", "residuals_wide"} <= set(sheets)
    for name in ("residuals", "joints_wide", "cycles_mean"):
        pd.testing.assert_frame_equal(
            sheets[name], pd.read_csv(exported / f"{name}.csv"), check_dtype=False
        )
    assert len(sheets["plan"]) == 6 * 3


NAMES = {
    **{"01": "NA", "NA": "null", "1e5": "=1+1", "null": "-3.2", "None": "NA"},
    **{"TRUE": "null", "2024-05-03": "=1+1", "1": "-3.2"},
}
"""Subjects and their groups."""
CONDITIONS = ("1e5", "NA")


def test_every_name_stays_as_it_is_in_csv_and_workbook(tmp_path, undrawn):
    """Also those that spreadsheets and pandas take for numbers, dates, gaps or formulas."""
    study, folder = tmp_path / "study", tmp_path / "results"
    study.mkdir()
    conditions = "".join(f'[conditions."{name}"]\n' for name in CONDITIONS)
    (study / "study.toml").write_text(f'{conditions}[comparison]\ngroup = "group"\n')
    for number, (name, group) in enumerate(NAMES.items(), start=1):
        about = f'id = "{name}"\ngroup = "{group}"\nsex = "male"\n'
        (study / f"{number}.toml").write_text(
            about + "".join(f'[trials."{c}"]\nfile = "{c}.c3d"\n' for c in CONDITIONS)
        )
        for condition in CONDITIONS[: 2 if number < 3 else 1]:
            trial = fake_trial(number, condition, 1, compensated=False)
            person = trial.subject.model_copy(update={"id": name})
            write_trial(
                replace(trial, subject=person, condition=condition),
                folder / "trials" / f"{name}_{condition}.parquet",
            )
    write_report(folder, study)
    write_workbook(folder, tmp_path / "tables")
    book = load_workbook(tmp_path / "tables" / "study.xlsx")
    assert not [c for sheet in book for row in sheet for c in row if c.data_type == "f"]
    for file, column, expected in (
        ("residuals", "subject", set(NAMES)),
        ("residuals", "condition", set(CONDITIONS)),
        ("residuals_wide", "group", set(NAMES.values())),
        ("cycles_mean", "subject", set(NAMES)),
        ("table_3", "condition", set(CONDITIONS)),
    ):
        heads, *rows = book[file].iter_rows(values_only=True)
        assert {row[heads.index(column)] for row in rows} == expected
        path = tmp_path / "tables" / f"{file}.csv"
        assert set(read_csv(path)[column]) == expected
        as_documented = {"dtype": {column: str}, "keep_default_na": False, "na_values": [""]}
        texts = pd.read_csv(path, **as_documented)[column]
        assert set(texts.str.removeprefix("'")) == expected


def test_every_column_of_every_table_has_a_meaning(exported):
    columns = pd.read_csv(exported / "columns.csv")
    assert columns["meaning"].notna().all()
    for path in exported.glob("*.csv"):
        if path.name != "columns.csv":
            own = columns.loc[columns["file"] == path.name, "column"]
            assert own.tolist() == pd.read_csv(path, nrows=0).columns.tolist()
    assert described("statistics.csv", "axis") == described("residuals.csv", "axis")


def test_a_row_per_subject_has_the_residual_of_each_cell(results):
    wide = pd.read_csv(results / "residuals_wide.csv").set_index("subject")
    long = pd.read_csv(results / "residuals.csv")
    assert len(wide) == 3
    for row in long[long["headline"]].itertuples():
        column = f"{row.axis}_{row.condition}_{'IC' if row.compensated else 'no_IC'}"
        assert wide.loc[row.subject, column] == row.rms


def test_mean_curves_are_means_over_the_gait_cycles_of_a_trial(results, exported):
    cycles = pd.read_parquet(results / "joint_cycles.parquet")
    mean = pd.read_csv(exported / "joint_cycles_mean.csv")
    assert (
        len(mean)
        == len(cycles.drop_duplicates(["subject", "condition", "compensated", "side"])) * 6
    )
    own, curve = cycles[cycles["percent"] == 40], "knee_flexion_moment"
    keys = ["subject", "condition", "compensated", "side"]
    expected = own.groupby(keys)[curve].mean()
    found = mean[mean["percent"] == 40].set_index(keys)[curve].reindex(expected.index)
    assert np.allclose(found, expected, rtol=1e-5, equal_nan=True)


def test_results_without_a_report_are_refused_with_the_command(tmp_path, capsys):
    assert main(["export", str(tmp_path), "--format", "tables", "--out", str(tmp_path)]) == 2
    assert "hbm report" in capsys.readouterr().err
