"""What a trial's residuals are made of, with what follows from it: files, and errors of a study."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ConfigDict, TypeAdapter, ValidationError

from pipeline.budgets.words import Mending, budget_lines, most_worth_mending
from pipeline.config.toml_file import fault_of
from pipeline.explain.budget import Bands, Budget
from pipeline.explain.explain import explain_trial
from pipeline.io.recording import Recording
from pipeline.io.write import whole_file, write_text
from pipeline.statistics.measurement import Covariances, measurement_covariances
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES
from pipeline.trial.result import TrialResult

FORMAT_VERSION: Final = 2
"""Of the files; raised with every change of what they hold."""
SUFFIX: Final = "_explained.json"
BANDS_SUFFIX: Final = "_bands.parquet"
Trial = tuple[str, str]
"""Subject and condition."""
COLUMNS: Final = ("subject", "condition", "compensated", "axis", "error", "level", "change")


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a trial's residuals are made of, and what follows from it.

    Attributes
    ----------
    version
        `FORMAT_VERSION` of the program that made it.
    key
        Digest of everything that it depends on; empty for a trial of no study.
    budget
        What they are made of.
    mending
        What is most worth mending.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    version: int
    key: str
    budget: Budget
    mending: tuple[Mending, ...]

    def lines(self) -> Iterator[str]:
        """Say what a table of shares does not: sizes, what to mend, what is merged, the check."""
        return budget_lines(self.budget, self.mending)

    def to_json(self) -> str:
        """Give the content of the file; numbers come back exactly."""
        return _JSON.dump_json(self, indent=1).decode()


_JSON: Final = TypeAdapter(Explanation)


def explain(
    recording: Recording,
    laboratory: Laboratory,
    result: TrialResult,
    key: str = "",
) -> Explanation:
    """Explain the residuals of a processed trial; parameters as for `explain_trial`."""
    found = explain_trial(recording, laboratory, result)
    budget = replace(found, source=Path(found.source.name))
    mending = most_worth_mending(budget, result, laboratory)
    return Explanation(FORMAT_VERSION, key, budget, mending)


def write_explanation(explanation: Explanation, path: Path) -> None:
    """Write an explanation as JSON, whole or not at all."""
    write_text(explanation.to_json(), path)


def read_explanation(path: Path) -> Explanation:
    """Read an explanation back.

    Raises
    ------
    ValueError
        If the file is damaged, or written by another version.
    OSError
        If it cannot be opened.
    """
    try:
        found = _JSON.validate_json(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"{path.name} is damaged: {fault_of(error)}") from error
    if found.version != FORMAT_VERSION:
        raise ValueError(f"{path.name}: written by another version of hbm")
    return found


def write_bands(bands: Bands, path: Path) -> None:
    """Write residuals over time: a row per frame, whole or not at all.

    Parameters
    ----------
    bands
        Of a trial.
    path
        The file. Its columns are ``time_s``; ``cycle``, the number of the gait cycle; and per axis,
        as reported, ``residual.Fx`` and ``deviation.Fx``, one standard deviation [N, N·m].
    """
    columns: dict[str, np.ndarray] = {"time_s": bands.time, "cycle": bands.cycle}
    for name in ("residual", "deviation"):
        values = getattr(bands, name)
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
    with whole_file(path) as temporary:
        pq.write_table(pa.table(columns), temporary)


def read_bands(path: Path) -> Bands:
    """Read residuals over time back.

    Raises
    ------
    ValueError
        If the file is damaged, or none of `write_bands`.
    OSError
        If it cannot be opened.
    """
    try:
        table = pq.read_table(path)
        six = {
            name: np.column_stack([table[f"{name}.{axis}"].to_numpy() for axis in AXES])
            for name in ("residual", "deviation")
        }
        return Bands(table["time_s"].to_numpy(), table["cycle"].to_numpy(), **six)
    except (pa.ArrowInvalid, KeyError) as error:
        raise ValueError(
            f"{path.name}: no residuals with bands; run 'hbm explain' again"
        ) from error


def study_covariances(
    explained: Mapping[Trial, Explanation], residuals: pd.DataFrame
) -> Covariances | None:
    """Give how errors of measurement vary together in a study's residuals.

    Parameters
    ----------
    explained
        Explanations of its trials.
    residuals
        Long table of RMS residuals, each of the window that its condition asks for.

    Returns
    -------
    Mapping or None
        As `pipeline.statistics.measurement.measurement_covariances` gives it; None unless every
        trial of the table is explained.
    """
    wanted, budgets = _trials(residuals), _budgets(explained, residuals)
    if not wanted or not wanted <= set(budgets):
        return None
    rows = [row for trial in sorted(wanted) for row in _errors(trial, budgets[trial])]
    return measurement_covariances(pd.DataFrame(rows, columns=COLUMNS))


def what_is_missing(explained: Mapping[Trial, Explanation], residuals: pd.DataFrame) -> str:
    """Say why there are no intervals of measurement, and what adds them; empty where there are."""
    wanted = _trials(residuals)
    have = len(wanted & set(_budgets(explained, residuals)))
    if have == len(wanted):
        return ""
    some = f"; {have} of {len(wanted)} trials are explained" * (have > 0)
    return f"'hbm explain RESULTS' adds intervals of measurement{some}."


def _trials(residuals: pd.DataFrame) -> set[Trial]:
    return set(residuals[["subject", "condition"]].itertuples(index=False, name=None))


def _budgets(
    explained: Mapping[Trial, Explanation], residuals: pd.DataFrame
) -> dict[Trial, Budget]:
    """Give what is known of trials, as far as it is of the window that their residuals are of."""
    of_part = _trials(residuals[~residuals["window"].isin(("cycle", "span"))])
    return {
        trial: own.budget
        for trial, own in explained.items()
        if trial not in of_part or own.budget.of_window
    }


def _errors(trial: Trial, budget: Budget) -> Iterator[tuple[object, ...]]:
    """List what errors change the RMS of a trial's residuals by: draws, which trials share."""
    for values in budget.of_window or budget.uncertainty:
        apart = (values.draws - values.draws.mean(axis=0)) / np.sqrt(len(values.draws) - 1)
        for number, changes in enumerate(apart.tolist()):
            for axis, change in zip(AXES, changes, strict=True):
                yield (*trial, values.compensated, axis, number, "laboratory", change)
