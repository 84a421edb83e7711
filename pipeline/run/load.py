"""The trials of a results folder together: residual table, gait-cycle curves, summaries."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from pipeline.run.frames import MASKS
from pipeline.run.store import StoredTrial, open_trial
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.residuals import AXES, ResidualRow
from pipeline.trial.summary import TrialSummary

CYCLE_COLUMNS: Final = (
    *("subject", "condition", "compensated"),
    *("side", "cycle", "percent", "axis", "value"),
)


@dataclass(frozen=True, slots=True)
class Results:
    """What `hbm run` wrote.

    Attributes
    ----------
    folder
        Results folder.
    residuals
        subject, condition, compensated, window, headline, axis, unit, rms, rms_of_cycles, mean, sd,
        peak, rms_percent, n_cycles, valid_share.
    cycles
        subject, condition, compensated, side, cycle, percent, axis, value: every sample of every
        gait cycle over 0–100 %; NaN where it does not count.
    subjects
        subject, sex, height_m, mass_kg, age_years; stature and mass are means over the trials.
    summaries
        (subject, condition) -> summary of the trial.
    """

    folder: Path
    residuals: pd.DataFrame
    cycles: pd.DataFrame
    subjects: pd.DataFrame
    summaries: dict[tuple[str, str], TrialSummary]


def collect(folder: Path) -> Results:
    """Gather the trials in a results folder.

    Parameters
    ----------
    folder
        Results folder; trials are in ``trials/``.

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
    summaries: dict[tuple[str, str], TrialSummary] = {}
    curves: list[pd.DataFrame] = []
    for path in paths:
        stored = open_trial(path)
        trial = stored.summary
        summaries[trial.subject.id, trial.condition] = trial
        curves += _curves(stored)
    residuals = pd.DataFrame(
        [row for trial in summaries.values() for row in trial.residuals],
        columns=[field.name for field in fields(ResidualRow)],
    )
    none = pd.DataFrame(columns=CYCLE_COLUMNS)
    cycles = pd.concat(curves, ignore_index=True) if curves else none
    return Results(folder, residuals, cycles, _subjects(summaries), summaries)


def select_trials(results: Results, wanted: Collection[tuple[str, str]]) -> Results:
    """Keep the results of some trials.

    Parameters
    ----------
    results
        All results.
    wanted
        (subject, condition) of the trials to keep.

    Returns
    -------
    Results
        Those of the trials to keep.

    Raises
    ------
    ValueError
        If nothing is left.
    """
    summaries = {key: trial for key, trial in results.summaries.items() if key in wanted}
    if len(summaries) == len(results.summaries):
        return results
    if not summaries:
        raise ValueError(
            f"{results.folder}: every result here is of a trial that failed, is excluded or is no "
            f"longer in the study; run 'hbm run STUDY --out {results.folder}'"
        )
    residuals, cycles = (_rows_of(t, summaries) for t in (results.residuals, results.cycles))
    return Results(results.folder, residuals, cycles, _subjects(summaries), summaries)


def _rows_of(table: pd.DataFrame, wanted: Collection[tuple[str, str]]) -> pd.DataFrame:
    """Give a table's rows of some trials."""
    if table.empty:
        return table
    keys = pd.MultiIndex.from_frame(table[["subject", "condition"]])
    return table[keys.isin(list(wanted))].reset_index(drop=True)


def _subjects(summaries: Mapping[tuple[str, str], TrialSummary]) -> pd.DataFrame:
    """List the subjects of the results."""
    people: dict[str, list[TrialSummary]] = {}
    for trial in summaries.values():
        people.setdefault(trial.subject.id, []).append(trial)
    return pd.DataFrame(
        {
            "subject": subject,
            "sex": trials[0].subject.sex,
            "height_m": np.mean([trial.height_m for trial in trials]),
            "mass_kg": np.mean([trial.body_mass_kg for trial in trials]),
            "age_years": trials[0].subject.age_years,
        }
        for subject, trials in people.items()
    )


def _curves(stored: StoredTrial) -> list[pd.DataFrame]:
    """Cut one trial's residuals into its gait cycles; one table per side that has any."""
    trial = stored.summary
    variants = sorted({row.compensated for row in trial.residuals})
    names = {False: "measured", True: "compensated"}
    columns = [f"residual.{names[v]}.{axis}" for v in variants for axis in AXES]
    time, *_ = stored.columns(["time_s"]).T
    counts = stored.columns([f"valid.{name}" for name in MASKS]).all(axis=1, keepdims=True)
    residuals = np.where(counts, stored.columns(columns), np.nan)
    parts = []
    for side, spans in trial.cycles.items():
        if not spans:
            continue
        values = normalise(time, residuals, spans)
        shape = (*values.shape[:2], len(variants), len(AXES))
        cycle, percent, variant, axis = (i.ravel() for i in np.indices(shape))
        parts.append(
            pd.DataFrame(
                {
                    "subject": trial.subject.id,
                    "condition": trial.condition,
                    "compensated": np.array(variants)[variant],
                    "side": side,
                    "cycle": cycle,
                    "percent": percent,
                    "axis": np.array(AXES)[axis],
                    "value": values.reshape(shape).ravel(),
                }
            )
        )
    return parts
