"""TOML texts that people write: parsed, or refused with a reason."""

import re
import tomllib
from typing import Any, Final

Table = dict[str, Any]
"""The contents of a TOML text before they are checked."""
DEEP_KEY: Final = re.compile(r"(?:[\w-]+\s*\.\s*){100}")
"""A dotted key of a hundred parts; the parser needs memory with the square of their number."""


def parse_toml(text: str) -> Table:
    """Parse a TOML text; a ValueError says what is wrong with it.

    Examples
    --------
    >>> parse_toml("[markers]")
    {'markers': {}}
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
