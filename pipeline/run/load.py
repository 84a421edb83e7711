"""The trials of a results folder together: residual table, gait-cycle curves, summaries."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array, Mask
from pipeline.run.store import StoredTrial, open_trial
from pipeline.trial.gait.cycle_table import cycle_table
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.quality import free_of
from pipeline.trial.residuals import AXES, UNIT_OF, ResidualRow
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
        peak, rms_percent, n_cycles, valid_share,
        compensation_sd.
    cycles
        subject, condition, compensated, side, cycle (from 1 for each side), percent, axis, value:
        every sample of every gait cycle over 0–100 %; NaN where it does not count.
    by_cycle
        subject, condition, compensated, side, cycle, start_s, stop_s, axis, unit, rms, peak,
        valid_share: every gait cycle by itself (`pipeline.trial.gait.cycle_table`).
    subjects
        subject, sex, height_m, mass_kg, age_years; stature and mass are means over the trials.
    summaries
        (subject, condition) -> summary of the trial.
    """

    folder: Path
    residuals: pd.DataFrame
    cycles: pd.DataFrame
    by_cycle: pd.DataFrame
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
    by_cycle: list[pd.DataFrame] = []
    for path in paths:
        stored = open_trial(path)
        trial = stored.summary
        summaries[trial.subject.id, trial.condition] = trial
        curves += _curves(stored)
        by_cycle.append(_by_cycle(stored))
    residuals = pd.DataFrame(
        [row for trial in summaries.values() for row in trial.residuals],
        columns=[field.name for field in fields(ResidualRow)],
    )
    none = pd.DataFrame(columns=CYCLE_COLUMNS)
    cycles = pd.concat(curves, ignore_index=True) if curves else none
    known = [table for table in by_cycle if len(table)]
    each = pd.concat(known, ignore_index=True) if known else by_cycle[0]
    return Results(folder, residuals, cycles, each, _subjects(summaries), summaries)


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
    tables = results.residuals, results.cycles, results.by_cycle
    residuals, cycles, by_cycle = (_rows_of(table, summaries) for table in tables)
    return Results(results.folder, residuals, cycles, by_cycle, _subjects(summaries), summaries)


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


def _residuals(stored: StoredTrial) -> tuple[Array, Mask, dict[bool, Array]]:
    """Read times, which frames count, and the reported residuals of each variant, (T, 6)."""
    names = {False: "measured", True: "compensated"}
    time, quality = stored.columns(["time_s", "quality"]).T
    counts = free_of(quality.astype(int))
    variants = sorted({row.compensated for row in stored.summary.residuals})
    return (
        time,
        counts,
        {v: stored.columns([f"residual.{names[v]}.{axis}" for axis in AXES]) for v in variants},
    )


def _by_cycle(stored: StoredTrial) -> pd.DataFrame:
    """Summarise one trial's gait cycles, as `pipeline.trial.residuals.cycles_of` does."""
    trial = stored.summary
    cycles = {} if trial.span else trial.cycles
    table = cycle_table(*_residuals(stored), cycles, UNIT_OF)
    table.insert(0, "condition", trial.condition)
    table.insert(0, "subject", trial.subject.id)
    return table


def _curves(stored: StoredTrial) -> list[pd.DataFrame]:
    """Cut one trial's residuals into its gait cycles; one table per side that has any."""
    trial = stored.summary
    time, counts, of_variant = _residuals(stored)
    variants = list(of_variant)
    if not variants:
        return []
    residuals = np.where(counts[:, None], np.hstack([*of_variant.values()]), np.nan)
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
                    "cycle": cycle + 1,
                    "percent": percent,
                    "axis": np.array(AXES)[axis],
                    "value": values.reshape(shape).ravel(),
                }
            )
        )
    return parts
