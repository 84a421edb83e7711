"""Numbers that stand in a room's TOML file, each with its unit, its meaning and its origin.

`thresholds.toml` has what decides what people read, `parameters.toml` what a simulation assumes.
"""

import re
import tomllib
from functools import cache
from importlib.resources import files
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

WORDS: Final = re.compile(r"^(?:unit|meaning|data|command|source) = .*\n", re.MULTILINE)


@cache
def _sections(package: str, file: str) -> dict[str, dict[str, dict[str, Any]]]:
    """Read the values in a file of a package once."""
    text = files(package).joinpath(file).read_text(encoding="utf-8")
    # words are for readers of the file: without them it is parsed in a quarter of the time
    return tomllib.loads(WORDS.sub("", text))


@cache
def read_numbers(package: str, file: str, section: str) -> SimpleNamespace:
    """Give the values of a section of a package's file by their names; a list becomes an array.

    A number stands as `[SECTION.NAME]` with `value`, `unit`, `meaning`, and either `data` and
    `command` (what it was chosen on, and what shows it again) or `source` (who published it, or
    why it is assumed).
    """
    values = {name: entry["value"] for name, entry in _sections(package, file)[section].items()}
    return SimpleNamespace(
        **{k: np.array(v) if isinstance(v, list) else v for k, v in values.items()}
    )
