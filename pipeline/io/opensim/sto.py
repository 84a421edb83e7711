"""OpenSim's MOT and STO tables."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array, read_only
from hbm.spelling import listed, short
from pipeline.io.input_file import naming
from pipeline.io.text_table import ending_notes, lines_of, names_in, parse_rows

TRANSLATIONS: Final = ("_tx", "_ty", "_tz")


@dataclass(frozen=True, slots=True)
class Table:
    """A table over time.

    Attributes
    ----------
    time
        Times, (N,) [s].
    names
        Column names without ``time``.
    values
        Values as the file holds them, (N, K).
    in_degrees
        Whether the rotational coordinates are in degrees, as the file states.
    notes
        On how the file ends.
    columns
        Name -> column of ``values``, the first one of that name.
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    in_degrees: bool
    notes: tuple[Note, ...] = ()
    columns: Mapping[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", read_only(self.time))
        object.__setattr__(self, "values", read_only(self.values))
        columns = {name: k for k, name in reversed([*enumerate(self.names)])}
        object.__setattr__(self, "columns", MappingProxyType(columns))

    def column(self, name: str) -> Array:
        """Give one column as the file holds it, (N,); a KeyError lists the columns that exist."""
        if name not in self.columns:
            raise KeyError(f"no column {short(name)!r}; present: {listed(self.names)}")
        return self.values[:, self.columns[name]]

    def coordinate(self, name: str) -> Array:
        """Give one coordinate, (N,): in rad, or in m where its name ends in _tx, _ty or _tz."""
        column = self.column(name)
        rotational = not name.endswith(TRANSLATIONS)
        return np.deg2rad(column) if self.in_degrees and rotational else column


def read_sto(path: str | Path) -> Table:
    """Read a MOT or STO file of any version.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Table
        Its columns; nothing is converted. Without ``inDegrees`` in the header angles are radians,
        as in OpenSim.

    Raises
    ------
    ValueError
        The file has no header or time column, is truncated, or holds something that is no number.
    OSError
        The file cannot be opened.
    """
    path = Path(path)
    with naming(path):
        return _parse(list(lines_of(path)), ending_notes(path))


read_mot = read_sto


def _parse(lines: list[str], notes: tuple[Note, ...]) -> Table:
    ends = [k for k, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        raise ValueError("not a MOT or STO file: it has no line 'endheader'")
    pairs = (line.partition("=") for line in lines[: ends[0]] if "=" in line)
    header = {key.strip().lower(): value.strip().lower() for key, _, value in pairs}
    body = [(k, line) for k, line in enumerate(lines, start=1) if k > ends[0] + 1 and line.strip()]
    names = names_in(body[0][1]) if body else []
    if not names or names[0].lower() != "time":
        raise ValueError(f"its first column is {listed(names[:1])}, expected 'time'")
    values = parse_rows(((k, "\t".join(line.split())) for k, line in body[1:]), "\t", names)
    for key, count in (("nrows", values.shape[0]), ("ncolumns", values.shape[1])):
        if key in header and header[key] != str(count):
            raise ValueError(f"its header says {key}={short(header[key])} but it holds {count}")
    in_degrees = header.get("indegrees", "no") == "yes"
    return Table(values[:, 0], tuple(names[1:]), values[:, 1:], in_degrees, notes)
