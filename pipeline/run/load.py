"""The trials of a results folder together: residual table, gait-cycle curves, summaries."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from joblib import delayed

from hbm.spatial import Array
from pipeline.config.schema import TrialName
from pipeline.io.write import whole_file
from pipeline.run.processes import MIN_TASKS, in_processes
from pipeline.run.store import OF_FRAMES, parquet_writer, read_trial
from pipeline.trial.joints import CURVE_COLUMNS, JOINT_COLUMNS, joint_curves, joint_rows
from pipeline.trial.residuals import (
    AXES,
    CYCLE_COLUMNS,
    TRIAL_COLUMNS,
    Residual,
    cycle_residuals,
    cycle_rows,
    residual_rows,
    trial_columns,
)
from pipeline.trial.result import TrialResult

TEXT: Final = pa.dictionary(pa.int32(), pa.string())
OF_CYCLE: Final = {
    **dict.fromkeys(TRIAL_COLUMNS, TEXT),
    **{"compensated": pa.bool_(), "side": TEXT, "cycle": pa.int64(), "percent": pa.int64()},
}
CURVES: Final = {
    "cycles": pa.schema({**OF_CYCLE, "axis": TEXT, "value": pa.float64()}),
    "joint_cycles": pa.schema({**OF_CYCLE, **dict.fromkeys(CURVE_COLUMNS, pa.float32())}),
}
"""Table of gait cycles -> its columns."""
TABLES: Final = {
    "residuals": Residual._fields,
    "by_cycle": CYCLE_COLUMNS,
    "joints": JOINT_COLUMNS,
}
"""Of `Results`, with their columns."""
AT_ONCE: Final = 10
"""Trials that a process reads together at most, and whose curves are one group of rows."""


@dataclass(frozen=True, slots=True)
class Curves:
    """A table of gait cycles, in its file: there may be too many for memory.

    Attributes
    ----------
    path
        ``cycles.parquet``: subject, condition, recording, session, compensated, side, cycle (from 1
        for each side), percent, axis, value: every sample of every gait cycle over 0–100 %; or
        ``joint_cycles.parquet``, with a column for every joint motion and curve in place of axis
        and value, such as hip_flexion_angle [deg], hip_flexion_moment [N·m/kg] and
        hip_flexion_power [W/kg]. NaN where a frame does not count.
    """

    path: Path

    def read(self, columns: Sequence[str] | None = None, **where: Any) -> pd.DataFrame:
        """Read columns of the rows that have these values; texts are categories."""
        rows = [(name, "==", value) for name, value in where.items()]
        categories = (*TRIAL_COLUMNS, "side", "axis")
        table = pq.read_table(
            self.path,
            columns=None if columns is None else [*columns],
            filters=rows or None,
            read_dictionary=categories,
        )
        frame: pd.DataFrame = table.to_pandas(split_blocks=True, self_destruct=True)
        texts = {name: column.cat for name, column in frame.items() if name in categories}
        ordered = {name: of.set_categories(sorted(of.categories)) for name, of in texts.items()}
        return frame.assign(**ordered)


@dataclass(frozen=True, slots=True)
class Results:
    """What `hbm run` wrote.

    Attributes
    ----------
    folder
        Results folder.
    residuals
        As `pipeline.trial.residuals.residual_table`, of all trials.
    by_cycle
        As `pipeline.trial.residuals.cycle_rows`, of all trials.
    joints
        As `pipeline.trial.joints.joint_rows`, of all trials.
    subjects
        subject, sex, height_m, mass_kg, age_years; stature and mass are means over the trials.
    trials
        Name -> the trial without its frames, and without the segments of its body.
    ratings
        Name -> what was found of it with its frames.
    """

    folder: Path
    residuals: pd.DataFrame
    by_cycle: pd.DataFrame
    joints: pd.DataFrame
    subjects: pd.DataFrame
    trials: dict[TrialName, TrialResult]
    ratings: Mapping[TrialName, Any]


def collect(
    folder: Path,
    rate: Callable[[TrialResult], Any] = lambda trial: None,
    in_curves: Callable[[TrialResult], bool] | None = None,
    follow: Callable[[int, int], None] = lambda done, trials: None,
) -> Results:
    """Gather the trials in a results folder, in as many processes as pays.

    Parameters
    ----------
    folder
        Results folder; trials are in ``trials/``.
    rate
        Of each trial with its frames, which are too many for a whole study: what it gives is kept.
    in_curves
        Of which trials `Curves` are written into the folder; without it, none are.
    follow
        Called with the number of trials that are read, and of all.

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
    if not paths and (folder / "study.toml").is_file():
        raise ValueError(f"{folder}: is a study; 'hbm run {folder}' writes its results")
    if not paths:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    size = min(AT_ONCE, 1 + len(paths) // AT_ONCE)
    batches = [paths[k : k + size] for k in range(0, len(paths), size)]
    tasks = (delayed(_gathered)(batch, rate, in_curves is not None) for batch in batches)
    trials: dict[TrialName, TrialResult] = {}
    ratings: list[Any] = []
    parts: dict[str, list[pd.DataFrame]] = {name: [] for name in TABLES}
    with ExitStack() as opened:
        files = {
            name: opened.enter_context(_written(folder / f"{name}.parquet", schema))
            for name, schema in CURVES.items()
            if in_curves is not None
        }
        gathered = in_processes(tasks, ordered=True, least=-(-MIN_TASKS // size))
        for read, rated, tables, curves in gathered:
            for name, part in tables.items():
                parts[name].append(part)
            ratings += rated
            trials |= {trial.name: trial for trial in read}
            follow(len(trials), len(paths))
            for name, file in files.items():
                of_trials = zip(read, curves[name], strict=True)
                shown = [table for trial, table in of_trials if in_curves and in_curves(trial)]
                file.write_table(
                    pa.concat_tables([CURVES[name].empty_table(), *shown]).unify_dictionaries()
                )
    return Results(
        folder=folder,
        subjects=_subjects(trials),
        trials=trials,
        ratings=dict(zip(trials, ratings, strict=True)),
        # types of columns are those of tables with rows
        **{
            name: pd.concat([t for t in part if len(t)] or part[:1], ignore_index=True)
            for name, part in parts.items()
        },
    )


def _gathered(
    paths: Sequence[Path], rate: Callable[[TrialResult], Any], curves: bool
) -> tuple[Any, ...]:
    """Read trials: give them without frames, their ratings, `TABLES`, and each one's `CURVES`."""
    trials, ratings = list[TrialResult](), list[Any]()
    rows: dict[str, list[tuple[Any, ...]]] = {name: [] for name in TABLES}
    of_cycles: dict[str, list[pa.Table]] = {name: [] for name in CURVES}
    for path in paths:
        trial = read_trial(path)
        joints = joint_curves(trial)
        rows["residuals"] += residual_rows(trial, trial.condition)
        rows["by_cycle"] += cycle_rows(trial, trial.condition)
        rows["joints"] += joint_rows(trial, trial.condition, joints)
        if curves:
            of_cycles["cycles"].append(_residual_cycles(trial))
            of_cycles["joint_cycles"].append(_joint_cycles(trial, joints))
        ratings.append(rate(trial))
        short = {name: _without_frames(getattr(trial, name)) for name in OF_FRAMES}
        # the segments of 10,000 bodies would be half of the memory of a report
        body = replace(trial.body, offsets={}, axes={}, segments={}, lengths={}, notes=())
        trials.append(replace(trial, body=body, **short))
    tables = {name: pd.DataFrame(rows[name], columns=columns) for name, columns in TABLES.items()}
    return trials, ratings, tables, of_cycles


@contextmanager
def _written(path: Path, schema: pa.Schema) -> Iterator[pq.ParquetWriter]:
    """Write a table whole or not at all, in groups of rows."""
    with whole_file(path) as temporary, parquet_writer(temporary, schema) as file:
        yield file


def _without_frames(value: Any) -> Any:
    """Give what has a value in each frame without any."""
    if isinstance(value, np.ndarray):
        return value[:0].copy()  # a view would keep all
    if isinstance(value, Mapping):
        return {name: _without_frames(one) for name, one in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return replace(
            value, **{f.name: _without_frames(getattr(value, f.name)) for f in fields(value)}
        )
    return value


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


def _rows_of(table: pd.DataFrame, trials: Collection[TrialName]) -> pd.DataFrame:
    """Give a table's rows of some trials."""
    names = pd.MultiIndex.from_frame(table[[*TrialName._fields]])
    return table[names.isin([*trials])].reset_index(drop=True)


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


def _residual_cycles(trial: TrialResult) -> pa.Table:
    """Give one trial's residuals over 0–100 % of each gait cycle; empty where nothing counts."""
    parts = [CURVES["cycles"].empty_table()]
    variants = [*trial.variants] if trial.counted.any() else []
    of_variants = [cycle_residuals(trial, name) for name in variants]
    for side in trial.cycles if variants else ():
        values = np.stack([curves[side] for curves in of_variants], axis=2)
        cycle, percent, variant, axis = map(np.ravel, np.indices(values.shape))
        compensated = np.array(variants)[variant] == "compensated"
        axes = pa.DictionaryArray.from_arrays(axis.astype(np.int32), [*AXES])
        columns = compensated, cycle, percent, axes, values.ravel()
        parts.append(_curve_table(trial, "cycles", side, *columns))
    return pa.concat_tables(parts)


def _joint_cycles(trial: TrialResult, curves: Mapping[str, Mapping[str, Array]]) -> pa.Table:
    """Give one trial's joint curves over 0–100 % of each gait cycle."""
    parts = [CURVES["joint_cycles"].empty_table()]
    for side in next(iter(curves.values()), ()):
        # variants beside each other: where no plate matters, they are equal, and so compressed
        values = np.stack([of_sides[side] for of_sides in curves.values()], axis=1)
        cycle, variant, percent = map(np.ravel, np.indices(values.shape[:3]))
        compensated = np.array([*curves])[variant] == "compensated"
        of_joints = values.reshape(len(cycle), -1).T.astype(np.float32, order="C")
        columns = compensated, cycle, percent, *of_joints
        parts.append(_curve_table(trial, "joint_cycles", side, *columns))
    return pa.concat_tables(parts)


def _curve_table(
    trial: TrialResult, name: str, side: str, compensated: Any, cycle: Any, *others: Any
) -> pa.Table:
    """Put columns of a table of `CURVES` together, of one side of a trial."""
    texts = (*trial_columns(trial, trial.condition), side)
    *of_trial, of_side = (pa.repeat(text, len(cycle)).dictionary_encode() for text in texts)
    columns = *of_trial, compensated, of_side, cycle + 1, *others
    arrays = [pa.array(column, from_pandas=True) for column in columns]
    return pa.Table.from_arrays(arrays, schema=CURVES[name])
