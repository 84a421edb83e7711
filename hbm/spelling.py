"""What people type and read: TOML texts, names, printable and with a hint if misspelt, numbers."""

import re
import tomllib
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib.resources import files
from math import isnan
from textwrap import fill
from typing import Any, Final
from unicodedata import combining, normalize

from hbm.coordinates import FIXED_TO

MAX_CHARACTERS: Final = 40
"""Of a name in a message; files may hold any."""
END_SHOWN: Final = 120
"""Characters at the end of a longer message."""
MAX_LISTED: Final = 8
"""Names in a message."""
MIN_PRINTED_P: Final = 0.001
"""A p-value has three decimals and is never printed as zero."""
TERMINAL: Final = 80
"""Characters in a line."""


def printable(text: str) -> str:
    """Give a text in one line, with "?" in place of what cannot be printed or steers a terminal."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))


def written(value: float, form: str) -> str:
    """Give a number that people read, with a minus sign (U+2212) where files have a hyphen."""
    return format(value, form).replace("-", "−")


def mean_sd(mean: float, sd: float, form: str = ".1f") -> str:
    """Write "mean ± SD": a dash without a mean, no SD of a single value."""
    if isnan(mean):
        return "–"
    return written(mean, form) + ("" if isnan(sd) else f" ± {sd:{form}}")


def format_p(p: float, alpha: float = 0.05) -> str:
    """Write a p-value as APA has it: three decimals, "<.001" below that, a star below alpha.

    More decimals are written where three would put it on the other side of alpha.
    """
    if isnan(p):
        return "–"
    if p < MIN_PRINTED_P:
        return f"<{MIN_PRINTED_P}".replace("0.", ".") + "*" * (p < alpha)
    decimals = next((d for d in range(3, 16) if (round(p, d) < alpha) == (p < alpha)), 16)
    return f"{p:.{decimals}f}".removeprefix("0") + "*" * (p < alpha)


def p_equation(p: float) -> str:
    """Write a p-value in a sentence, such as "p = .012"."""
    written = format_p(p).rstrip("*")
    return f"p {written}".replace("<", "< ") if "<" in written else f"p = {written}"


def short(name: object, characters: int = MAX_CHARACTERS) -> str:
    """Give a name as it is shown: its first characters, without those that cannot be printed."""
    text = printable(str(name))
    return text if len(text) <= characters else f"{text[: characters - 1]}…"


def shown(value: object) -> str:
    """Give a value as it was typed, as `short` gives a name, however large or nested it is."""
    try:
        return short(repr(value))
    except (ValueError, RecursionError):  # more digits or deeper than Python writes out
        return f"a very large {type(value).__name__}"


def both_ends(text: str, characters: int) -> str:
    """Give a long text as its beginning and its last 120 characters, which say what to do."""
    if len(text) <= characters:
        return text
    return f"{text[: characters - END_SHOWN - 3]} … {text[-END_SHOWN:]}"


def wrapped(text: str) -> str:
    """Give a long line as lines that fit a terminal."""
    whole: Any = {"break_long_words": False, "break_on_hyphens": False}
    return fill(text, TERMINAL, subsequent_indent="  ", **whole)


def listed(names: Iterable[object], most: int = MAX_LISTED) -> str:
    """Give the first of some names, and how many more there are; "none" where there are none."""
    every = [short(name) for name in names]
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return f"{', '.join(every[:most])}{more}" if every else "none"


def counted(number: int, noun: str) -> str:
    """Give a number with its noun, "1 trial" or "2 trials"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def join_names(names: Sequence[str]) -> str:
    """Join names as in a sentence, with "and" before the last."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def did_you_mean(word: object, choices: Iterable[str]) -> str:
    """Give ``", did you mean 'x'?"`` for the nearest known word, or nothing."""
    close = get_close_matches(str(word), list(choices), n=1)
    return f", did you mean {short(close[0])!r}?" if close else ""


def no_segment(name: object, names: Iterable[str]) -> str:
    """Say that a segment is none of those known here, and what to write instead.

    "trunk" is the name of earlier versions for thorax and mid trunk together.
    """
    names = list(names)
    if name in FIXED_TO:
        return f"{name!r} has no coordinates; write {FIXED_TO[str(name)]!r}, to which it is fixed"
    if name == "trunk":
        parts = " and ".join(repr(s) for s in ("thorax", "mid_trunk") if s in names)
        return f"no segment 'trunk', write {parts}"
    return f"no segment {shown(name)}{did_you_mean(name, names)}"


Table = dict[str, Any]
"""The contents of a TOML text before they are checked."""
DECIMAL_COMMA: Final = re.compile(r"^ *([\w.-]+ *= *[+-]?(\d+),(\d+)) *(?:#.*)?$", re.MULTILINE)
DEEP_KEY: Final = re.compile(r"(?:[\w-]+\s*\.\s*){100}")
"""A dotted key of a hundred parts; the parser needs memory with the square of their number."""


def packaged_toml(package: str, name: str) -> Table:
    """Read a TOML file that is a part of the program."""
    return tomllib.loads(files(package).joinpath(name).read_text(encoding="utf-8"))


def without_accents(text: str) -> str:
    """Give a text without accents.

    Examples
    --------
    >>> without_accents("gång")
    'gang'
    """
    return "".join(letter for letter in normalize("NFKD", text) if not combining(letter))


def parse_toml(text: str) -> Table:
    """Parse a TOML text; a ValueError says what is wrong with it.

    Examples
    --------
    >>> parse_toml("[markers]")
    {'markers': {}}
    >>> parse_toml("height_m = 1,64")
    Traceback (most recent call last):
    ...
    ValueError: height_m = 1,64: decimals have a point: 1.64
    >>> parse_toml("a." * 200 + "b = 1")
    Traceback (most recent call last):
    ...
    ValueError: it is nested too deeply
    """
    if DEEP_KEY.search(text):
        raise ValueError("it is nested too deeply")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    except tomllib.TOMLDecodeError as error:
        if comma := DECIMAL_COMMA.search(text):
            right = f"{comma[2]}.{comma[3]}"
            raise ValueError(f"{comma[1]}: decimals have a point: {right}") from error
        raise
