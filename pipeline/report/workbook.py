"""The tables of a study for statistics programs: a row per subject, mean curves, a workbook.

With the data dictionary of a results folder: every column of every table, its unit and meaning.
"""

import csv
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import pandas as pd
import pyarrow.parquet as pq
from openpyxl import Workbook
from openpyxl.cell import WriteOnlyCell
from openpyxl.cell.cell import ILLEGAL_CHARACTERS_RE
from openpyxl.worksheet.worksheet import Worksheet

from pipeline.config.schema import TrialName
from pipeline.io.write import read_csv, read_parquet, uncomputed, whole_file, write_csv
from pipeline.report.joints import subject_values
from pipeline.statistics.design import Design

FILE: Final = "columns.csv"


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
        rows = table.assign(name=name)[table["condition"].isin(design.conditions)]
        rows["column"] = (rows["name"] + " " + design.cells_of(rows)).str.replace(" ", "_")
        order = rows["column"].drop_duplicates()
        wide = rows.pivot(index="subject", columns="column", values=value)[order]
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
    if not (results / FILE).is_file():
        raise ValueError(f"{results}: no tables of a report here; run 'hbm report {results}' first")
    tables = {path.name: read_csv(path) for path in sorted(results.glob("*.csv"))}
    del tables[FILE]
    tables |= _mean_curves(results)
    for name, table in tables.items():
        write_csv(table, out / name)
    write_columns(out)
    tables[FILE] = read_csv(out / FILE)
    workbook = Workbook(write_only=True)
    for name, table in tables.items():
        sheet = workbook.create_sheet(Path(name).stem)
        sheet.freeze_panes = "A2"
        for row in ([*table], *table.itertuples(index=False, name=None)):
            sheet.append([_cell(sheet, value) for value in row])
    path = out / "study.xlsx"
    with whole_file(path) as temporary:
        workbook.save(temporary)
    return [*(out / name for name in tables), path]


def _cell(sheet: Worksheet, value: Any) -> Any:
    """Give a cell of a sheet: text stays text, also where it is edited in a spreadsheet."""
    if not isinstance(value, str):
        return None if pd.isna(value) else value
    text = WriteOnlyCell(sheet, ILLEGAL_CHARACTERS_RE.sub("?", value) or None)
    text.data_type, text.quotePrefix = "s", value != uncomputed(value)
    return text


def _mean_curves(results: Path) -> Iterator[tuple[str, pd.DataFrame]]:
    """Average the curves of each trial over its gait cycles."""
    trial = [*TrialName._fields, "session", "compensated", "side"]
    for name, others in (("cycles", ["axis"]), ("joint_cycles", [])):
        cycles = read_parquet(results / f"{name}.parquet")
        keys = [*trial, *others, "percent"]
        of_trials = cycles.groupby(keys, sort=False, dropna=False, observed=True)
        yield f"{name}_mean.csv", of_trials.mean().drop(columns="cycle").reset_index()


def write_columns(folder: Path) -> None:
    """Write ``columns.csv``: file, column, unit and meaning of the tables of a results folder.

    Parameters
    ----------
    folder
        Results folder with the tables that `columns.toml` describes.
    """
    rows = [
        (name, column, *described(name, column))
        for name in _dictionary()
        if (folder / name).is_file()
        for column in _columns(folder / name)
    ]
    write_csv(pd.DataFrame(rows, columns=["file", "column", "unit", "meaning"]), folder / FILE)


def described(file: str, column: str) -> tuple[str, str]:
    """Give unit and meaning of a column; a KeyError where the dictionary lacks it."""
    columns = {**_dictionary()["every table"], **_dictionary()[file]}
    for pattern in sorted(columns, key=".*".__eq__):  # what matches any column is last
        if match := re.fullmatch(pattern, column):
            unit, meaning = columns[pattern]
            words = {name: text.replace("_", " ") for name, text in match.groupdict().items()}
            return unit, meaning.format(**words)
    raise KeyError(f"{file}: {column}")


def _columns(path: Path) -> Iterator[str]:
    if path.suffix == ".parquet":
        yield from pq.read_schema(path).names
    else:
        with path.open(encoding="utf-8", newline="") as content:
            yield from next(csv.reader(content), [])


@cache
def _dictionary() -> Mapping[str, Mapping[str, Sequence[str]]]:
    text = files("pipeline.report").joinpath("columns.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
