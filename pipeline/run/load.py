"""The trials of a results folder together: residual table, gait-cycle curves, summaries."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from joblib import cpu_count, delayed

from pipeline.config.schema import TrialName
from pipeline.run.processes import in_processes
from pipeline.run.store import read_trial
from pipeline.trial.joints import joint_tables
from pipeline.trial.residuals import (
    AXES,
    TRIAL_COLUMNS,
    counted,
    cycle_residuals,
    cycles_of,
    residual_table,
)
from pipeline.trial.result import TrialResult

CYCLE_COLUMNS: Final = (
    *TRIAL_COLUMNS,
    "compensated",
    *("side", "cycle", "percent", "axis", "value"),
)
MIN_TRIALS: Final = 10
"""Of each process, which takes as long to start."""
TABLES: Final = ("residuals", "cycles", "by_cycle", "joints", "joint_cycles")
"""Of `Results`."""


@dataclass(frozen=True, slots=True)
class Results:
    """What `hbm run` wrote.

    Attributes
    ----------
    folder
        Results folder.
    residuals
        As `pipeline.trial.residuals.residual_table`, of all trials.
    cycles
        subject, condition, recording, session, compensated, side, cycle (from 1 for each side),
        percent, axis, value:
        every sample of every gait cycle over 0–100 %; NaN where it does not count.
    by_cycle
        As `pipeline.trial.residuals.cycles_of`, of all trials.
    joints, joint_cycles
        As `pipeline.trial.joints.joint_tables`, of all trials.
    subjects
        subject, sex, height_m, mass_kg, age_years; stature and mass are means over the trials.
    trials
        Name -> the trial without its frames.
    ratings
        Name -> what was found of it with its frames.
    """

    folder: Path
    residuals: pd.DataFrame
    cycles: pd.DataFrame
    by_cycle: pd.DataFrame
    joints: pd.DataFrame
    joint_cycles: pd.DataFrame
    subjects: pd.DataFrame
    trials: dict[TrialName, TrialResult]
    ratings: Mapping[TrialName, Any]


def collect(folder: Path, rate: Callable[[TrialResult], Any] = lambda trial: None) -> Results:
    """Gather the trials in a results folder, in as many processes as there are processors.

    Parameters
    ----------
    folder
        Results folder; trials are in ``trials/``.
    rate
        Of each trial with its frames, which are too many for a whole study: what it gives is kept.

    Returns
    -------
    Results
        Results, in order of subject and condition.

    Raises
    ------
    ValueError
        If there is no trial, or one is damaged.
    """
    paths = sorted((folder / "trials").glob("*.parquet"))
    if not paths:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    tasks = (delayed(_trial_and_tables)(path, rate) for path in paths)
    workers = min(cpu_count(), -(-len(paths) // MIN_TRIALS))
    found, ratings, *tables = zip(*in_processes(tasks, workers, ordered=True), strict=True)
    trials = {trial.name: trial for trial in found}
    joined = dict(zip(TABLES, map(_joined, tables), strict=True))
    return Results(
        folder=folder,
        subjects=_subjects(trials),
        trials=trials,
        ratings=dict(zip(trials, ratings, strict=True)),
        **joined,
    )


def _trial_and_tables(path: Path, rate: Callable[[TrialResult], Any]) -> tuple[Any, ...]:
    """Read a trial; give it without its frames, its rating, and its rows of `TABLES`."""
    trial = read_trial(path)
    name, short = trial.condition, read_trial(path, frames=False)
    of_residuals = residual_table(trial, name), _curves(trial), cycles_of(trial, name)
    return short, rate(trial), *of_residuals, *joint_tables(trial, name)


def _joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Put tables below each other; types of columns are those of tables with rows."""
    return pd.concat([t for t in tables if len(t)] or tables[:1], ignore_index=True)


def select_trials(results: Results, wanted: Collection[TrialName]) -> Results:
    """Keep the results of some trials.

    Parameters
    ----------
    results
        All results.
    wanted
        Names of the trials to keep.

    Returns
    -------
    Results
        Those of the trials to keep.

    Raises
    ------
    ValueError
        If nothing is left.
    """
    trials = {key: trial for key, trial in results.trials.items() if key in wanted}
    if len(trials) == len(results.trials):
        return results
    if not trials:
        raise ValueError(
            f"{results.folder}: every result here is of a trial that failed, is excluded or is no "
            f"longer in the study; run 'hbm run STUDY --out {results.folder}'"
        )
    tables: dict[str, Any] = {name: _rows_of(getattr(results, name), trials) for name in TABLES}
    return replace(results, subjects=_subjects(trials), trials=trials, **tables)


def _rows_of(table: pd.DataFrame, wanted: Collection[TrialName]) -> pd.DataFrame:
    """Give a table's rows of some trials."""
    names = pd.MultiIndex.from_frame(table[[*TrialName._fields]])
    return table[names.isin([*wanted])].reset_index(drop=True)


def _subjects(trials: Mapping[TrialName, TrialResult]) -> pd.DataFrame:
    """List the subjects of the results."""
    rows = [
        {
            "subject": trial.subject.id,
            "sex": trial.subject.sex,
            "height_m": trial.body.height_m,
            "mass_kg": trial.body.mass,
            "age_years": trial.subject.age_years,
        }
        for trial in trials.values()
    ]
    how = {"sex": "first", "height_m": "mean", "mass_kg": "mean", "age_years": "first"}
    return pd.DataFrame(rows).groupby("subject", sort=False, as_index=False).agg(how)


def _curves(trial: TrialResult) -> pd.DataFrame:
    """Give one trial's residuals over 0–100 % of each gait cycle; empty where nothing counts."""
    parts = [pd.DataFrame(columns=CYCLE_COLUMNS)]
    if not counted(trial).any():
        return parts[0]
    of_variant = {name: cycle_residuals(trial, name) for name in trial.variants}
    for side in trial.cycles:
        values = np.stack([curves[side] for curves in of_variant.values()], axis=2)
        cycle, percent, variant, axis = (index.ravel() for index in np.indices(values.shape))
        compensated = np.array([name == "compensated" for name in of_variant])
        parts.append(
            pd.DataFrame(
                {
                    "subject": trial.subject.id,
                    "condition": trial.condition,
                    "recording": trial.recording,
                    "session": trial.session,
                    "compensated": compensated[variant],
                    "side": side,
                    "cycle": cycle + 1,
                    "percent": percent,
                    "axis": np.array(AXES)[axis],
                    "value": values.ravel(),
                }
            )
        )
    return _joined([part for part in parts if len(part)] or parts)
