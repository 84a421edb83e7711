"""Standard output and error as they are: of any encoding, narrow, closed, or no longer read."""

import codecs
import io
import os
import sys
import unicodedata
from typing import Final

from hbm.spelling import both_ends, printable

MAX_LINE: Final = 290
"""Characters of an error, some lines of a terminal: names and texts out of files may have any
length."""

STAND_INS: Final = {
    "·": "*",
    "×": "x",
    "±": "+/-",
    "°": " deg",
    "µ": "u",
    "–": "-",
    "—": "-",
    "−": "-",
    "→": "->",
    "≤": "<=",
    "≥": ">=",
}
"""What a letter is written as where the encoding of the output lacks it."""


def accept_any_letter() -> None:
    """Write letters that the encoding of the output lacks, such as ASCII's, in other letters."""
    codecs.register_error("stand-in", _stand_in)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # None where it is closed
            stream.reconfigure(errors="stand-in")


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


def _stand_in(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_other_letters, error.object[error.start : error.end])), error.end


def _other_letters(letter: str) -> str:
    bare = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return STAND_INS.get(letter) or bare or "?"
