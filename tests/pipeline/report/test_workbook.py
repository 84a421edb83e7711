"""Tables for other programs: the same numbers in a workbook and with a row per subject."""

import numpy as np
import pandas as pd
import pytest

from pipeline.cli.app import main
from pipeline.report import write as report
from pipeline.report.write import write_report
from tests.pipeline.fake_results import write_fake_results


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    write_fake_results(folder, subjects=3, cycles=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "study_figures", lambda *args: iter(()))
        patch.setattr(report, "joint_figures", lambda *args: iter(()))
        write_report(folder)
    return folder


@pytest.fixture(scope="module")
def exported(results, tmp_path_factory):
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


def test_every_column_of_every_table_has_a_meaning(exported):
    columns = pd.read_csv(exported / "columns.csv")
    assert columns["meaning"].notna().all()
    for path in exported.glob("*.csv"):
        if path.name != "columns.csv":
            own = columns.loc[columns["file"] == path.name, "column"]
            assert own.tolist() == pd.read_csv(path, nrows=0).columns.tolist()


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
        == len(cycles.drop_duplicates(["subject", "condition", "compensated", "side"])) * 101
    )
    own, curve = cycles[cycles["percent"] == 40], "knee_flexion_moment"
    keys = ["subject", "condition", "compensated", "side"]
    expected = own.groupby(keys)[curve].mean()
    found = mean[mean["percent"] == 40].set_index(keys)[curve].reindex(expected.index)
    assert np.allclose(found, expected, rtol=1e-5, equal_nan=True)


def test_results_without_a_report_are_refused_with_the_command(tmp_path, capsys):
    assert main(["export", str(tmp_path), "--format", "tables", "--out", str(tmp_path)]) == 2
    assert "hbm report" in capsys.readouterr().err
