"""Standard output and error as they are: of any encoding, narrow, closed, or no longer read."""

import io
import os
import sys
from typing import Final

from hbm.spelling import both_ends, printable

MAX_LINE: Final = 690
"""Characters of an error, some lines of a terminal: names and texts out of files may have any
length."""


def accept_any_letter() -> None:
    """Write a question mark for a letter that the encoding of the output lacks, such as ASCII."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # None where it is closed
            stream.reconfigure(errors="replace")


def print_error(line: str) -> None:
    """Print one line to standard error, as far as that exists."""
    shown = both_ends(printable(" ".join(line.split())), MAX_LINE)
    if sys.stderr is not None:
        print(f"hbm: {shown}", file=sys.stderr)


def drop_output() -> None:
    """Write nothing more, because nobody reads it: else Python complains when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
