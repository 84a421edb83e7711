"""Files that are given to be read: opened if they are files, their faults told with their name."""

import errno
import hashlib
import os
import re
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import BinaryIO, Final

from hbm.spelling import both_ends, printable

UNUSABLE: Final = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff]")
"""In a name: it has a control character, or bytes that are no UTF-8."""
RENAME: Final = "a name that is not UTF-8, or has a control character; rename the file or folder"
NO_MEMORY: Final = "there is not enough memory; close other programs or use a larger machine"
MAX_BYTES: Final = 2**31
"""Of a recording, or of a table: three hours of markers and plates."""


class FileFault(ValueError):
    """What is wrong with a file: one printable line that begins with its name."""

    filename: str | None = None


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name before whatever a ValueError says of it, once."""
    try:
        yield
    except FileFault:
        raise
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise
    except (ValueError, MemoryError) as error:
        name = f"{path.name}: "
        text = NO_MEMORY if isinstance(error, MemoryError) else str(error).removeprefix(name)
        fault = FileFault(fault_line(name + text))
        fault.filename = str(path)
        for line in getattr(error, "__notes__", ()):
            fault.add_note(line)
        raise fault from error


def fault_line(text: str) -> str:
    """Give what is said about a file in one printable line; of a long one its two ends."""
    return both_ends(printable(text), 699)  # twenty labels, two sets and what to do


def expected(error: BaseException) -> bool:
    """Say whether an error is about what people gave; otherwise it is a fault of this program."""
    if isinstance(error, KeyError):
        return any(isinstance(text, str) and " " in text for text in error.args[:1])
    is_told = isinstance(error, ValueError | OSError) and str(error) != ""
    return is_told or isinstance(error, MemoryError)


def describe_error(error: BaseException) -> str:
    """Put an error into one line, with the notes that were added on its way up."""
    text = str(error.args[0] if isinstance(error, KeyError) and error.args else error)
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror[:1].lower() + error.strerror[1:]
        text = f"{error.filename}: {text}" if error.filename else text
    elif isinstance(error, MemoryError):
        text = NO_MEMORY
    elif not expected(error):
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = (
            f"a fault of this program: {type(error).__name__}: {text[:200]} "
            f"({Path(place.filename).name}, line {place.lineno}); please report it with what "
            "--debug shows"
        )
    parts = [text, *getattr(error, "__notes__", [])]
    return "; ".join(map(printable, (" ".join(part.split()) for part in parts)))


def is_file(path: Path) -> bool:
    """Say whether there is such a file; a name that is longer than any file's names none."""
    try:
        return path.is_file()
    except OSError:
        return False


def last_written(path: Path) -> tuple[int, int]:
    """Give what changes when a file is written anew: when it was written [ns], and its bytes."""
    status = path.stat()
    return status.st_mtime_ns, status.st_size


def file_digest(path: Path) -> str:
    """Give a file's SHA-256; for a file that cannot be read, a text that says why.

    It is hashed once, until it is written to again.
    """
    try:
        return _sha256(path, last_written(path))
    except OSError as error:
        return f"unreadable: {error.strerror}"


@cache
def _sha256(path: Path, version: tuple[int, int]) -> str:
    """Hash a file; the version changes when it is written anew."""
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def open_file(path: Path, most: int = MAX_BYTES) -> BinaryIO:
    """Open a file of at most so many bytes to read them.

    Raises
    ------
    OSError
        It cannot be opened, is larger, or is a pipe or a device, which may never end.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        reason = "is a pipe or a device; save what it gives as a file first"
        raise OSError(errno.EINVAL, reason, str(path))
    file = path.open("rb")
    if (size := os.fstat(file.fileno()).st_size) > most:
        file.close()
        raise OSError(errno.EINVAL, too_large(size, most), str(path))
    return file


def too_large(size: float, most: float) -> str:
    """Say that a file is larger than any that is right, or its content once it is expanded."""
    sizes = f"holds {size / 1e6:,.0f} MB, expected at most {most / 1e6:,.0f} MB"
    return f"{sizes}; give another file, or a part of it"


def read_text(path: Path, most: int = 2**26) -> str:
    """Read a file in UTF-8, with or without a byte order mark; a ValueError if it is not.

    By default of at most 64 MB: settings, calibrations and explanations have some megabytes.
    """
    with open_file(path, most) as file:
        return file.read().decode("utf-8-sig")
