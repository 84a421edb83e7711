"""Numbers that stand in a room's TOML file, each with its unit, its meaning and its origin.

`thresholds.toml` has what decides what people read, `parameters.toml` what a simulation assumes.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from hbm.spelling import packaged_toml


@cache
def _sections(package: str, file: str) -> dict[str, dict[str, dict[str, Any]]]:
    """Read a file of a package once."""
    return packaged_toml(package, file)


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
