"""Files that are written whole or not at all: tables, text, anything that takes a path."""

import errno
import secrets
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import pandas as pd

PART: Final = ".part"
"""Suffix of a file that is being written."""
NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a disk that is full, of a quota and of a limit; they name no file."""
MAX_WRITING_S: Final = 3600.0
"""Longer than any one file takes: what is older was left by a run that was killed."""
_unfinished: Final = set[Path]()
"""Temporary files that this process is writing."""


def write_csv(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV, whole or not at all."""
    with whole_file(path) as temporary:
        table.to_csv(temporary, index=False, float_format="%.6g", encoding="utf-8")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside a file; it takes the file's place once all is written.

    Permissions are those of any new file. What goes wrong with the temporary file is said of the
    file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, not a file to write", str(path))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file to write", str(path))
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
    _unfinished.add(temporary)
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.errno in NO_ROOM or error.filename == str(temporary):
            error.filename = str(path)
        raise
    finally:
        with suppress(OSError):
            temporary.unlink()
        _unfinished.discard(temporary)


def remove_unfinished() -> None:
    """Remove the temporary files of this process, which ends at once."""
    for path in tuple(_unfinished):
        with suppress(OSError):
            path.unlink()


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of killed runs: those not written to for an hour."""
    for path in folder.glob(f".*.????????{PART}"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > MAX_WRITING_S:
                path.unlink()


def require_writable(out: Path) -> None:
    """Make a folder and try to write to it, before minutes are spent on its content.

    Raises
    ------
    ValueError
        If that fails: the folder is read-only or a file, or the disk is full.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out) as file:
            file.write(bytes(4096))
    except OSError as error:
        raise ValueError(f"--out {out}: cannot write there: {error.strerror}") from error


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """Give a table as Markdown, numbers with so many digits after the point."""
    cells = [
        [f"{v:.{digits}f}" if isinstance(v, float) else str(v) for v in row]
        for row in table.itertuples(index=False)
    ]
    lines = [list(map(str, table.columns)), ["---"] * len(table.columns), *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def write_text(text: str, path: Path) -> None:
    """Write text, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
