"""The data dictionary of a results folder: every column of every table, with unit and meaning."""

import csv
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

import pandas as pd
import pyarrow.parquet as pq

from pipeline.io.write import write_csv

FILE: Final = "columns.csv"


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
    known = {**_dictionary()["every table"], **_dictionary()[file]}
    for pattern in sorted(known, key=".*".__eq__):  # what matches any column is last
        if match := re.fullmatch(pattern, column):
            unit, meaning = known[pattern]
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
