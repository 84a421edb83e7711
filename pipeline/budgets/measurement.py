"""The errors of measurement of a study's residuals, from the explanations of its trials."""

from collections.abc import Iterator, Mapping
from typing import Final

import pandas as pd

from hbm.spatial import Array
from pipeline.budgets.explanation import Explanation
from pipeline.explain.budget import Budget, RmsUncertainty
from pipeline.explain.cause import SHARED_WITHIN
from pipeline.statistics.measurement import Covariances, Level, measurement_covariances
from pipeline.trial.residuals import AXES

Trial = tuple[str, str]
"""Subject and condition."""
COLUMNS: Final = ("subject", "condition", "compensated", "axis", "error", "level", "change")
LEVELS: Final[Mapping[str, Level]] = {str(group): own for group, own in SHARED_WITHIN.items()}


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
    """List what each error changes the RMS of a trial's residuals by."""
    for values in budget.of_window or budget.uncertainty:
        for error, level, change in _changes(values):
            for axis, own in zip(AXES, change.tolist(), strict=True):
                yield (*trial, values.compensated, axis, error, level, own)


def _changes(values: RmsUncertainty) -> Iterator[tuple[str, Level, Array]]:
    """Give name, level and change of the errors of a value; a cause and its square are two."""
    for cause in values.causes:
        level = LEVELS[cause.group]
        yield cause.name, level, cause.change
        yield f"{cause.name}, squared", level, cause.square
    yield "noise", "sample", values.of_noise
