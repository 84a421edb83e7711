"""Numbers of judgement: each stands in its room's `thresholds.toml`, with unit, meaning and origin."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from hbm.spelling import packaged_toml


@cache
def _sections(package: str) -> dict[str, dict[str, dict[str, Any]]]:
    """Read a package's file once."""
    return packaged_toml(package, "thresholds.toml")


def read_thresholds(package: str, section: str) -> SimpleNamespace:
    """Give the values of a section of a package's `thresholds.toml`; a list becomes an array.

    Each value has the table `[SECTION.NAME]` with `value`, `unit`, `meaning`, and either `data` and
    `command` (what it was chosen on, and what shows it again) or `source` (who published it, or
    why it is assumed).
    """
    values = {name: entry["value"] for name, entry in _sections(package)[section].items()}
    return SimpleNamespace(
        **{k: np.array(v) if isinstance(v, list) else v for k, v in values.items()}
    )
