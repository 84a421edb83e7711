"""The errors of measurement of a study's residuals, from the explanations of its trials."""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import pandas as pd

from pipeline.budgets.explanation import Explanation
from pipeline.explain.budget import Budget
from pipeline.statistics.measurement import Covariances, measurement_covariances
from pipeline.trial.residuals import AXES

Trial = tuple[str, str]
"""Subject and condition."""
COLUMNS: Final = ("subject", "condition", "compensated", "axis", "error", "level", "change")


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
