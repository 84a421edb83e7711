"""The tables of a study for statistics programs: a row per subject, mean curves, a workbook."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pandas as pd

from pipeline.config.schema import TrialName
from pipeline.io.write import whole_file, write_csv
from pipeline.report.columns import FILE, write_columns
from pipeline.report.joints import subject_values
from pipeline.statistics.design import Design

WORKBOOK: Final = "study.xlsx"
CURVES: Final = {"cycles": ("axis",), "joint_cycles": ()}
"""Table of gait cycles -> what else its rows are of."""
TRIAL: Final = [*TrialName._fields, "session", "compensated", "side"]


def write_wide_tables(
    folder: Path,
    residuals: pd.DataFrame,
    joints: pd.DataFrame,
    people: pd.DataFrame,
    design: Design,
) -> None:
    """Write ``residuals_wide.csv`` and ``joints_wide.csv``: a row per subject, a column per cell.

    Parameters
    ----------
    folder
        Results folder.
    residuals
        One row per subject, condition, compensation and axis, as `pool_recordings` gives it.
    joints
        As `pipeline.trial.joints.joint_tables`, of all trials.
    people
        One row per subject.
    design
        What is compared.
    """
    of_joints = subject_values(joints, design.weigh)
    names = of_joints["joint"] + " " + of_joints["direction"] + " " + of_joints["quantity"]
    for file, table, name, value in (
        ("residuals_wide.csv", residuals, residuals["axis"], "rms"),
        ("joints_wide.csv", of_joints, names, "value"),
    ):
        own = table.assign(name=name)[table["condition"].isin(design.conditions)]
        cells = [
            design.cell(*key) for key in zip(own["condition"], own["compensated"], strict=True)
        ]
        own["column"] = [
            f"{n} {c}".replace(" ", "_") for n, c in zip(own["name"], cells, strict=True)
        ]
        order = own["column"].drop_duplicates()
        wide = own.pivot(index="subject", columns="column", values=value)[order]
        write_csv(people.merge(wide, on="subject", how="left"), folder / file)


def write_workbook(results: Path, out: Path) -> list[Path]:
    """Write what R, MATLAB, JASP and Excel read of a study: its tables as CSV and as a workbook.

    Parameters
    ----------
    results
        Results folder with the tables of `hbm report`.
    out
        Folder for the files.

    Returns
    -------
    list of Path
        All CSV files of the results; ``cycles_mean.csv`` and ``joint_cycles_mean.csv``, the curves
        of each trial averaged over its gait cycles; ``columns.csv``, what their columns are; and
        ``study.xlsx``, a sheet for each.

    Raises
    ------
    ValueError
        If the results have no report.
    """
    tables = sorted(path for path in results.glob("*.csv") if path.name != FILE)
    if not (results / FILE).is_file():
        raise ValueError(f"{results}: no tables of a report here; run 'hbm report {results}' first")
    out.mkdir(parents=True, exist_ok=True)
    for table in tables:
        shutil.copyfile(table, out / table.name)
    for name, mean in _mean_curves(results):
        write_csv(mean, out / name)
        tables.append(out / name)
    write_columns(out)
    written = [out / table.name for table in tables] + [out / FILE]
    with (
        whole_file(out / WORKBOOK) as temporary,
        pd.ExcelWriter(temporary, engine="openpyxl") as workbook,
    ):
        for path in written:
            sheet = pd.read_csv(path, dtype={"recording": str, "session": str})
            sheet.to_excel(workbook, sheet_name=path.stem, index=False, freeze_panes=(1, 0))
    return [*written, out / WORKBOOK]


def _mean_curves(results: Path) -> Iterator[tuple[str, pd.DataFrame]]:
    """Average the curves of each trial over its gait cycles."""
    for name, others in CURVES.items():
        cycles = pd.read_parquet(results / f"{name}.parquet")
        keys = [*TRIAL, *others, "percent"]
        mean = cycles.drop(columns="cycle").groupby(keys, sort=False, dropna=False).mean()
        yield f"{name}_mean.csv", mean.reset_index()
