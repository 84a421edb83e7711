"""Files that are written whole or not at all: tables, text, anything that takes a path.

Tables keep text and numbers apart. In CSV every text is quoted and no number is. A text that a
spreadsheet would compute has an apostrophe before it, which `read_csv` removes.
"""

import errno
import platform
import re
import secrets
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final
from zlib import crc32

import numpy as np

from pipeline.io.input_file import MAX_BYTES, naming, open_file, read_text, too_large

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq
if sys.platform != "win32":
    import fcntl  # here: where a program ends, modules are no longer imported

PART: Final = ".part"
"""Suffix of a file that is being written."""
HOST: Final = f"{crc32(platform.node().encode()) & 0xFFFF:04x}"
"""This machine in names of parts: locks of another one may not be seen on a shared disk."""
MAX_EXPANDED_BYTES: Final = 2**33
"""Of a study's table in memory: a million gait cycles."""
COMPUTED: Final = re.compile(r"'*[=+\-@\t\r\n]")
"""Beginning of a text that a spreadsheet would compute, with or without apostrophes before it."""
_unfinished: Final = set[Path]()
"""Temporary files that this process is writing."""


def write_csv(table: "pd.DataFrame", path: Path) -> None:
    """Write a table as CSV, whole or not at all; numbers with six digits."""
    texts = [
        column.dtype.kind not in "biuf" and any(isinstance(value, str) for value in column)
        for _, column in table.items()
    ]
    # what is missing in other columns than NumPy's may equal nothing, not even itself
    filled = {
        str(name): column.astype(object).mask(column.isna(), None)
        for name, column in table.items()
        if column.dtype != float and column.hasnans
    }
    _write([*table], texts, table.assign(**filled).itertuples(index=False, name=None), path)


def write_rows(names: Sequence[str], rows: Sequence[Sequence[object]], path: Path) -> None:
    """Write rows as `write_csv` does a table, without pandas, which takes long to load."""
    texts = [any(isinstance(row[k], str) for row in rows) for k in range(len(names))]
    _write(names, texts, rows, path)


def _write(
    names: Iterable[str], texts: Iterable[bool], rows: Iterable[Sequence[object]], path: Path
) -> None:
    """Write rows; cells of a column with any text are in quotes, what is missing is empty."""
    forms = [_quoted if is_text else _number for is_text in texts]
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(f"{','.join(map(_quoted, names))}\n")
        for row in rows:
            cells = [form(value) for form, value in zip(forms, row, strict=True)]
            file.write(f"{','.join(cells)}\n")


def _number(value: object) -> str:
    if value is None or value != value:
        return ""
    return f"{value:.6g}" if isinstance(value, float | np.floating) else str(value)


@lru_cache(typed=True)  # most texts repeat
def _quoted(text: object) -> str:
    shown = "" if text is None or text != text else uncomputed(str(text))
    return '"' + shown.replace('"', '""') + '"'


def uncomputed(text: str) -> str:
    """Put an apostrophe before a text that a spreadsheet would compute, such as "=1+1"."""
    return f"'{text}" if COMPUTED.match(text) else text


def read_csv(path: str | Path) -> "pd.DataFrame":
    """Read a table of the results back, as it was written.

    Parameters
    ----------
    path
        A CSV file of `hbm`.

    Returns
    -------
    pandas.DataFrame
        What was text is text, also "01", "NA" and "=1+1"; numbers have six digits.

    Raises
    ------
    ValueError
        It is no such file.
    OSError
        It cannot be opened.

    Examples
    --------
    >>> import pandas as pd
    >>> write_csv(pd.DataFrame({"subject": ["01", "NA"], "rms": [1.5, 2.0]}), Path("rms.csv"))
    >>> read_csv("rms.csv")["subject"].tolist()
    ['01', 'NA']
    """
    import pandas as pd

    text = read_text(Path(path), MAX_BYTES)
    names = pd.read_csv(StringIO(text), nrows=0).columns
    # the quotes of the first row tell text from numbers, which pandas does not
    cell_of_row = re.compile(r'("(?:[^"]|"")*"|[^,\r\n]*)(?:,|\r?\n|$)')
    row = cell_of_row.finditer(text, text.find("\n") + 1)
    texts = [name for name, cell in zip(names, row, strict=False) if cell[0].startswith('"')]
    kinds, gaps = dict.fromkeys(texts, str), {name: [""] for name in names.difference(texts)}
    table = pd.read_csv(StringIO(text), dtype=kinds, keep_default_na=False, na_values=gaps)
    table[texts] = table[texts].map(_as_given)
    return table.rename(columns=_as_given)


def _as_given(text: str) -> str:
    """Undo `uncomputed`."""
    return text[1:] if text.startswith("'") and COMPUTED.match(text) else text


def read_parquet(path: Path) -> "pd.DataFrame":
    """Read a table from a Parquet file; a ValueError where it is none or expands to too much."""
    with naming(path), open_file(path) as file:
        table = open_parquet(file, MAX_EXPANDED_BYTES).read(use_threads=False)
        shown: pd.DataFrame = table.to_pandas(use_threads=False)
        return shown


def open_parquet(content: "BinaryIO | pa.NativeFile", most: int) -> "pq.ParquetFile":
    """Open a Parquet file; a ValueError where it expands to more than so many bytes.

    Read it without threads: those that cannot be started for lack of memory end the process.
    """
    import pyarrow.parquet as pq

    file = pq.ParquetFile(content)
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    # pages of equal values are short, whatever they state
    size = sum(max(g.total_byte_size, 8 * g.num_rows * g.num_columns) for g in groups)
    if size > most:
        raise ValueError(too_large(size, most))
    return file


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside a file; it takes the file's place once all is written.

    Permissions are those of any new file. What goes wrong with the temporary file is said of the
    file. What killed processes left in the folder is removed first.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "is a folder, device or pipe, not a file to write", str(path))
    _remove_leftovers_once(path.parent)
    temporary = path.with_name(f".{path.name}.{HOST}{secrets.token_hex(2)}{PART}")
    unlocked = temporary.with_suffix("")
    _unfinished.update((unlocked, temporary))
    try:
        with unlocked.open("xb") as lock:
            # it is locked before it looks like a leftover; Windows renames no open file
            if not _locked(lock):
                lock.close()
            unlocked.rename(temporary)
            yield temporary
            temporary.replace(path)
    except OSError as error:
        # errors of a full disk, of a quota and of a limit name no file
        no_room = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        if no_room or error.filename in (str(unlocked), str(temporary)):
            error.filename = str(path)
        raise
    finally:
        for name in (unlocked, temporary):
            with suppress(OSError):
                name.unlink()
            _unfinished.discard(name)


def _locked(file: BinaryIO) -> bool:
    """Lock a file until it is closed or this process ends; whether that was possible."""
    with suppress(OSError):
        if sys.platform != "win32":
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    return False


def remove_unfinished() -> None:
    """Remove the temporary files of this process, which ends at once."""
    for path in tuple(_unfinished):
        with suppress(OSError):
            path.unlink()


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that nobody writes: they are not locked, or an hour old."""
    for path in folder.glob(f".*.????????{PART}"):
        with suppress(OSError):
            with path.open("rb") as file:
                here = path.suffixes[-2].startswith(f".{HOST}") and _locked(file)
                # where locks tell nothing: no file takes an hour to write
                dead = here or time.time() - path.stat().st_mtime > 3600.0
            if dead:
                path.unlink()


_remove_leftovers_once = cache(remove_leftovers)


def require_writable(out: Path) -> None:
    """Make a folder and try to write to it, before minutes are spent on its content.

    What killed processes left in it is removed.

    Raises
    ------
    ValueError
        If that fails: the folder is read-only or a file, or the disk is full.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        remove_leftovers(out)
        with tempfile.TemporaryFile(dir=out) as file:
            file.write(bytes(4096))
    except OSError as error:
        raise ValueError(f"--out {out}: cannot write there: {error.strerror}") from error


def write_text(text: str, path: Path) -> None:
    """Write text, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
