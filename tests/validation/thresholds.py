"""What each threshold of a trial decides: at half and at double its value, what is said otherwise.

Sound walks, virtual and real, and walks with planted faults are processed; a threshold that changes
nothing in any of them is decided by no recording here. Values between 0.5 and 1 without a unit are
fractions: their distance to 1 is halved and doubled.
"""

import tomllib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from importlib.resources import files
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hbm.numbers import read_numbers
from tests.campaign.planted_faults import Outcome, Trial, all_walks, faults

FILE = "thresholds.toml"
FACTORS = (0.5, 2.0)
VIRTUAL = 4
"""Virtual walks; planted faults are in the first and in the real ones."""
EVERY = 6
"""Of the faults of a walk: each kind is there, in one size or the other."""


@cache
def trials(data: Path | None) -> dict[str, Trial]:
    """Walks without a fault, those of legs alone, and walks with planted faults, by their names."""
    walks = all_walks(data, VIRTUAL)
    chosen = {f"sound, {base.name}": Trial(base.recording, base.known) for base in walks}
    for base in walks[::3]:
        legs = base.with_legs_alone()
        chosen[f"sound, {base.name}, legs alone"] = Trial(legs.recording, legs.known)
    for number, base in enumerate((walks[0], *walks[VIRTUAL:])):
        for fault in islice(faults(base, None, 1), number % EVERY, None, EVERY):
            chosen[f"faulty, {base.name}, {fault}"] = fault.trial
    return chosen


def said_of(trial: Trial) -> frozenset[str]:
    """Everything that is said of a trial: faults with their rivals, codes of warnings, refusals."""
    outcome = Outcome.of(trial)
    named = (" or ".join(sorted(map(str, rivals))) for rivals in outcome.named)
    codes = {note.code for note in outcome.warnings}
    return codes.union(named, filter(None, [outcome.refused[:60]]))


@cache
def usual(data: Path | None) -> dict[str, frozenset[str]]:
    """What is said of each trial with the thresholds as they are."""
    return {name: said_of(trial) for name, trial in trials(data).items()}


def scaled(value: Any, factor: float, unit: str) -> Any:
    """Give a threshold at a multiple of its value; counts stay whole and positive."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return max(1, round(factor * value))
    fractions = np.asarray(value, float)
    if unit == "1" and ((fractions > 0.5) & (fractions < 1)).all():
        return type(value)(1 - factor * (1 - value))
    return factor * value


def changes(data: Path | None, package: str, threshold: tuple[str, str, str]) -> list[dict]:
    """Process all trials with one threshold at half and at double its value."""
    section, name, unit = threshold
    numbers, rows = read_numbers(package, FILE, section), list[dict]()
    value = getattr(numbers, name)
    for factor in FACTORS:
        before = usual(data)
        setattr(numbers, name, scaled(value, factor, unit))
        try:
            now = {key: said_of(trial) for key, trial in trials(data).items()}
        finally:
            setattr(numbers, name, value)
        differ = [key for key in now if now[key] != before[key]]
        new = sorted({text for key in differ for text in now[key] - before[key]})
        gone = sorted({text for key in differ for text in before[key] - now[key]})
        rows.append(
            {
                "threshold": f"{section}.{name}",
                "factor": factor,
                "sound": sum(key.startswith("sound") for key in differ),
                "faulty": sum(key.startswith("faulty") for key in differ),
                "trials": len(now),
                "new": "; ".join(new),
                "gone": "; ".join(gone),
            }
        )
    return rows


def thresholds(package: str, only: str | None) -> Iterator[tuple[str, str, str]]:
    """Give section, name and unit of each threshold of a room."""
    text = files(package).joinpath(FILE).read_text(encoding="utf-8")
    for section, entries in tomllib.loads(text).items():
        for name, entry in entries.items():
            if only in (None, section):
                yield section, name, entry["unit"]


def decided(data: Path | None, only: str | None, jobs: int) -> pd.DataFrame:
    """Give what the thresholds of trials decide, a row for each value."""
    package = "pipeline.trial"
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        results = pool.map(partial(changes, data, package), thresholds(package, only))
        return pd.DataFrame([row for rows in results for row in rows])
