"""Experiment 2: which calibration trial to choose, and between which it makes no difference."""

from typing import Final

import pandas as pd

from pipeline.calibration_ranking.ranking import Model, Ranking
from pipeline.calibration_ranking.trials import factors

SMALLEST_DIFFERENCE: Final = 0.1
"""Of what two calibrations leave, above which it matters [N, N·m]: the last digit of the thesis'
Tables II and III. A smaller one changes neither, however certain it is."""


def thesis_choice(table: pd.DataFrame) -> str:
    """Choose a calibration trial by the thesis' rule.

    Parameters
    ----------
    table
        trial, mean_rank and firsts, as in `pipeline.calibration_ranking.ranking.Ranking`.

    Returns
    -------
    str
        The trial that is foremost in both of the thesis' tables: the ranking, and the best trials
        of the columns (van de Loosdrecht 2018, D.4). Where they disagree, the one with the smallest
        sum of its two places, then with the lower mean rank; the thesis does not state how it
        weighs them.

    Examples
    --------
    >>> table = pd.DataFrame(
    ...     {"trial": ["a", "b", "c"], "mean_rank": [1.5, 1.7, 2.8], "firsts": [2, 4, 0]}
    ... )
    >>> thesis_choice(table)
    'a'
    """
    places = table["mean_rank"].rank(method="min")
    places += table["firsts"].rank(method="min", ascending=False)
    foremost = table[places == places.min()].sort_values("mean_rank")
    return str(foremost["trial"].iloc[0])


def count_best(best: pd.DataFrame) -> pd.DataFrame:
    """Count how often each kind, belt speed and duration is among the best trials (F.2.3, F.2.4).

    Parameters
    ----------
    best
        Names of trials in any layout, as `best_trials` gives them.

    Returns
    -------
    pandas.DataFrame
        factor, level, columns (in which a trial of that level is the best), most first; empty where
        names state no levels.
    """
    stated = [factors(str(name)) for name in best.to_numpy().ravel()]
    if not all(stated):
        return pd.DataFrame()
    levels = [
        (factor, f"{level:g}" if isinstance(level, float) else level)
        for one in stated
        for factor, level in one.items()
    ]
    counts = pd.DataFrame(levels, columns=["factor", "level"]).value_counts()
    table = counts.rename("columns").reset_index()
    return table.sort_values(["factor", "columns"], ascending=[True, False], ignore_index=True)


def excess(ranking: Ranking[Model], name: str) -> pd.Series:
    """Give how much more a trial leaves than the winner in each column [N, N·m]."""
    left = ranking.scores.pivot(
        index=["validation", "component"], columns="trial", values="rms_after"
    )
    return left[name] - left[ranking.winner]


def as_good(ranking: Ranking[Model]) -> list[str]:
    """Name the trials that leave as much as the winner in every column, the winner first.

    They leave less than `SMALLEST_DIFFERENCE` more than it, or less than it, and so do the upper
    ends of the 95 % intervals of that.
    """
    most = ranking.scores.groupby("trial")["excess_high"].max()
    return [
        name
        for name in ranking.table["trial"]
        if max(excess(ranking, name).max(), most[name]) < SMALLEST_DIFFERENCE
    ]
