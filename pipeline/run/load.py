"""A study's trials gathered: the long residual table, the gait-cycle curves, what is missing."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.run.store import read_facts
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.residuals import AXES


@dataclass(frozen=True, slots=True)
class Results:
    """What `hbm run` left.

    Attributes
    ----------
    folder
        Where.
    residuals
        subject, condition, compensated, axis, unit, rms, rms_of_cycles, mean, sd, peak,
        rms_percent, n_cycles.
    cycles
        subject, condition, compensated, side, cycle, percent, axis, value: every sample of every
        gait cycle over 0–100 %.
    subjects
        subject, sex, height_m, mass_kg, age_years; stature and mass are means over the trials.
    facts
        (subject, condition) -> what the trial says of itself (`pipeline.run.store.trial_facts`).
    """

    folder: Path
    residuals: pd.DataFrame
    cycles: pd.DataFrame
    subjects: pd.DataFrame
    facts: dict[tuple[str, str], dict[str, Any]]


def collect(folder: Path) -> Results:
    """Gather the trials in a results folder.

    Parameters
    ----------
    folder
        Results folder; trials are in ``trials/``.

    Returns
    -------
    Results
        Everything, in order of subject and condition.

    Raises
    ------
    ValueError
        If there is no trial, or one is damaged.
    """
    paths = sorted((folder / "trials").glob("*.parquet"))
    if not paths:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    facts: dict[tuple[str, str], dict[str, Any]] = {}
    curves = []
    for path in paths:
        fact = read_facts(path)
        key = fact["subject"]["id"], fact["condition"]
        facts[key] = fact
        curves.append(_curves(path, fact))
    residuals = pd.DataFrame([row for fact in facts.values() for row in fact["residuals"]])
    cycles = pd.concat(curves, ignore_index=True)
    return Results(folder, residuals, cycles, _subjects(facts), facts)


def only(results: Results, wanted: Collection[tuple[str, str]]) -> Results:
    """Leave out the results of trials that do not count.

    Parameters
    ----------
    results
        Everything.
    wanted
        (subject, condition) of the trials that count.

    Returns
    -------
    Results
        Of these alone.

    Raises
    ------
    ValueError
        If nothing is left.
    """
    facts = {key: fact for key, fact in results.facts.items() if key in wanted}
    if len(facts) == len(results.facts):
        return results
    if not facts:
        raise ValueError(
            f"{results.folder}: every result here is of a trial that failed, is excluded or is no "
            f"longer in the study; run 'hbm run STUDY --out {results.folder}'"
        )
    residuals, cycles = (_of(table, facts) for table in (results.residuals, results.cycles))
    return Results(results.folder, residuals, cycles, _subjects(facts), facts)


def _of(table: pd.DataFrame, wanted: Collection[tuple[str, str]]) -> pd.DataFrame:
    """Give a table's rows of some trials."""
    if table.empty:
        return table
    keys = pd.MultiIndex.from_frame(table[["subject", "condition"]])
    return table[keys.isin(list(wanted))].reset_index(drop=True)


def _subjects(facts: dict[tuple[str, str], dict[str, Any]]) -> pd.DataFrame:
    """List who is in the results."""
    people: dict[str, list[dict[str, Any]]] = {}
    for (subject, _), fact in facts.items():
        people.setdefault(subject, []).append(fact)
    return pd.DataFrame(
        {
            "subject": subject,
            "sex": trials[0]["subject"]["sex"],
            "height_m": np.mean([trial["height_m"] for trial in trials]),
            "mass_kg": np.mean([trial["body_mass_kg"] for trial in trials]),
            "age_years": trials[0]["subject"]["age_years"],
        }
        for subject, trials in people.items()
    )


def _curves(path: Path, fact: dict[str, Any]) -> pd.DataFrame:
    """Cut one trial's residuals into its gait cycles."""
    variants = sorted({row["compensated"] for row in fact["residuals"]})
    names = {False: "measured", True: "compensated"}
    columns = [f"residual.{names[v]}.{axis}" for v in variants for axis in AXES]
    frames = pd.read_parquet(path, columns=["time_s", *columns])
    parts = []
    for side, spans in fact["cycles"].items():
        if not spans:
            continue
        values = normalise(frames["time_s"].to_numpy(), frames[columns].to_numpy(), spans)
        count = len(spans)
        shape = (count, 101, len(variants), len(AXES))
        cycle, percent, variant, axis = (i.ravel() for i in np.indices(shape))
        parts.append(
            pd.DataFrame(
                {
                    "subject": fact["subject"]["id"],
                    "condition": fact["condition"],
                    "compensated": np.array(variants)[variant],
                    "side": side,
                    "cycle": cycle,
                    "percent": percent,
                    "axis": np.array(AXES)[axis],
                    "value": values.reshape(shape).ravel(),
                }
            )
        )
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
