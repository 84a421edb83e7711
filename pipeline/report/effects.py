"""The tests of factors on every residual, as a paper writes them."""

from math import isnan
from typing import Any, Final

import pandas as pd

from hbm.spelling import p_equation
from pipeline.report.blocks import Table
from pipeline.trial.residuals import AXES, rows_of

STATISTICS: Final = {"F": "F", "chi2": "χ²"}
"""Statistic of a test of a factor -> its symbol."""


def tests_table(statistics: pd.DataFrame) -> Table | None:
    """Show the tests of factors: a row per test and effect, a column per residual.

    Of the table that `pipeline.statistics.comparison.statistics` returned; why a test was not
    computed is below. None where there is nothing to say.
    """
    of_factors = statistics[statistics["statistic_name"].isin(STATISTICS)]
    computed = of_factors[of_factors["p_corrected"].notna()]
    rows = []
    for (test, effect), group in computed.groupby(["test", "effect"], sort=False):
        cells = {row.axis: written_test(row) for row in rows_of(group)}
        rows.append([f"{test}: {named(effect)}", *(cells.get(axis, "–") for axis in AXES)])
    uncomputed = statistics[statistics["p_corrected"].isna() & (statistics["test"] != "estimate")]
    reasons = dict.fromkeys(
        f"{row.test}: {row.note}.".removeprefix("all: ") for row in rows_of(uncomputed) if row.note
    )
    if not (rows or reasons):
        return None
    return Table("Effects of factors", ("", *AXES), rows, "tests", " ".join(reasons))


def named(effect: object) -> str:
    """Write an effect: its factors, or the two cells of a pair."""
    return str(effect).replace(":", " × ").replace(" - ", " − ")


def written_test(row: Any) -> str:
    """Write a test as APA has it, with the degrees of freedom that its p-value has."""
    factor = row.epsilon if row.correction == "Greenhouse-Geisser" else 1.0
    corrected = (factor * df for df in (row.df1, row.df2) if not isnan(df))
    degrees = [f"{df:.2f}".rstrip("0").rstrip(".") for df in corrected]
    text = f"{STATISTICS[row.statistic_name]}({', '.join(degrees)}) = {row.statistic:.2f}, "
    text += p_equation(row.p_corrected)
    if isnan(row.effect_size):
        return text
    low, high = (f"{bound:.2f}" for bound in (row.ci_low, row.ci_high))
    interval = "" if isnan(row.ci_low) else f" [{low}, {high}]"
    symbol = {"partial eta squared": "ηp²", "Kendall's W": "W"}[row.effect_size_name]
    return f"{text}, {symbol} = {row.effect_size:.2f}{interval}"
