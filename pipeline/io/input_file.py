"""Files that are given to be read: opened if they are files, their faults told with their name."""

import errno
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

from hbm.spelling import both_ends, printable

MAX_MESSAGE: Final = 699
"""Characters of what is said about a file: twenty labels, two sets and what to do."""


MAX_REASON: Final = 200
"""Characters of an error that nobody expects."""


class FileFault(ValueError):
    """What is wrong with a file: one printable line that begins with its name."""


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
    except ValueError as error:
        name = f"{path.name}: "
        raise FileFault(fault_line(name + str(error).removeprefix(name))) from error


def fault_line(text: str) -> str:
    """Give what is said about a file in one printable line; of a long one its two ends."""
    return both_ends(printable(text), MAX_MESSAGE)


def describe_error(error: BaseException) -> str:
    """Put an error into one line, with the notes that were added on its way up."""
    for_people = isinstance(error, ValueError | OSError)
    text = str(error)
    if isinstance(error, KeyError) and error.args and isinstance(error.args[0], str):
        text = error.args[0]
        for_people = " " in text
    if isinstance(error, FileExistsError | NotADirectoryError) and error.filename:
        text = f"{error.filename}: a file stands where a folder should be"
    elif isinstance(error, OSError) and error.strerror:
        text = error.strerror.lower()
        text = f"{error.filename}: {text}" if error.filename else text
    elif not (for_people and text):
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = (
            f"a fault of this program: {type(error).__name__}: {text[:MAX_REASON]} "
            f"({Path(place.filename).name}, line {place.lineno}); please report it with what "
            "--debug shows"
        )
    parts = [text, *getattr(error, "__notes__", [])]
    return "; ".join(" ".join(part.split()) for part in parts)


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


def open_file(path: Path) -> BinaryIO:
    """Open a file to read its bytes.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    BinaryIO
        Its bytes.

    Raises
    ------
    OSError
        It cannot be opened, or is a pipe or a device, which may never end.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        reason = "is a pipe or a device; save what it gives as a file first"
        raise OSError(errno.EINVAL, reason, str(path))
    return path.open("rb")


def read_text(path: Path) -> str:
    """Read a file in UTF-8, with or without a byte order mark; a ValueError if it is not."""
    with open_file(path) as file:
        return file.read().decode("utf-8-sig")
