"""The tests of every residual on the page of a report: which effects are shown, and tables."""

from collections.abc import Callable, Iterator
from math import isnan
from typing import Any, Final

import pandas as pd

from pipeline.report.blocks import Table, Text, table_of
from pipeline.statistics.comparison import MIXED_ANOVA, RM_ANOVA
from pipeline.statistics.design import ALPHA, Design
from pipeline.statistics.table_3 import format_p, number
from pipeline.trial.residuals import AXES, DIRECTIONS, rows_of

FORMS: Final = {"mean difference": "+z.1f", "partial eta squared": ".2f", "Kendall's W": ".2f"}
"""Effect size -> how it is written; others with their sign."""


def residual_tests(statistics: pd.DataFrame, design: Design) -> list[tuple[Text, list[Table]]]:
    """Show the tests of every residual: which effects are shown, and a table of each test.

    Parameters
    ----------
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned.
    design
        The design that it was computed for.

    Returns
    -------
    list
        In order of the axes: the residual with the effects that are shown and not, or why nothing
        was tested; a table of each test and of the estimates, pairs with the correction that the
        design names. One for all residuals where no test of any was computed for the same reason.
    """
    found = [
        (Text(f"{axis} {direction}", tuple(_lines(of_axis))), [*_tables(of_axis, design)])
        for axis, direction in zip(AXES, DIRECTIONS, strict=True)
        if not (of_axis := statistics[statistics["axis"] == axis]).empty
    ]
    reasons = {text.lines for text, _ in found}
    if len(found) > 1 and len(reasons) == 1 and not any(tables for _, tables in found):
        return [(Text("All residuals", *reasons), [])]
    return found


def _tables(tests: pd.DataFrame, design: Design) -> Iterator[Table]:
    """Show each test that was computed, and the estimates, a row per effect or pair."""
    is_of_pairs = tests["correction"].str.startswith(("Bonferroni", "Holm"))
    as_stated = tests["correction"].str.startswith(design.correction.capitalize())
    computed = tests["p_corrected"].notna() | (tests["test"] == "estimate")
    columns: dict[str, Callable[[Any], str]] = {
        "Effect": lambda row: row.effect.replace(":", " × ").replace(" - ", " − "),
        "n": lambda row: str(row.n),
        "statistic": lambda row: f"{row.statistic_name} {number(row.statistic, '.3f')}".strip(" –"),
        "df": lambda row: ", ".join(f"{df:.4g}" for df in (row.df1, row.df2) if not isnan(df)),
        "ε GG": lambda row: number(row.epsilon, ".3f"),
        "p": lambda row: format_p(row.p_uncorrected),
        "p corrected": lambda row: format_p(row.p_corrected),
        "correction": lambda row: row.correction,
        "effect size [95 % CI]": _effect_size,
        "remark": lambda row: row.note,
    }
    for test, rows in tests[computed & (as_stated | ~is_of_pairs)].groupby("test", sort=False):
        title = f"{str(test)[0].upper()}{str(test)[1:]}"
        if rows["effect"].str.contains(" - ").any():
            title += ", all groups together" * (design.group is not None)
            title += "; each interval is of one pair alone" * (len(design.pairs) > 1)
        table = table_of(title, columns, rows_of(rows))
        filled = [
            k for k in range(len(columns)) if any(row[k] not in ("", "–") for row in table.rows)
        ]
        heads = [table.heads[k] for k in filled]
        yield Table(title, heads, [[row[k] for k in filled] for row in table.rows], "numbers tests")


def _effect_size(row: Any) -> str:
    """Write an effect size with its interval."""
    if not row.effect_size_name:
        return "–"
    form = FORMS.get(row.effect_size_name, "+z.2f")
    value = f"{row.effect_size_name} {number(row.effect_size, form)}"
    if isnan(row.ci_low):
        return value
    return f"{value} [{number(row.ci_low, form)}, {number(row.ci_high, form)}]"


def _by_effect(tests: pd.DataFrame, test: str) -> dict[str, float]:
    """Give the p-values of a test that were computed, by their effects."""
    rows = tests[(tests["test"] == test) & tests["p_corrected"].notna()]
    return dict(zip(rows["effect"], rows["p_corrected"], strict=True))


def _lines(tests: pd.DataFrame) -> Iterator[str]:
    """Say which effects are shown and which are not, or why nothing was tested."""
    of_variance = RM_ANOVA, MIXED_ANOVA
    names = [name for name in tests["test"].unique() if name.partition(" with ")[0] in of_variance]
    effects = _by_effect(tests, names[0]) if names else {}
    if not effects:
        notes = tests.loc[tests["test"].isin((*names, "all")), "note"]
        reason = str(notes.iloc[0]) if len(notes) else "nothing was tested"
        yield f"{reason[0].upper()}{reason[1:]}."
    p_of = {name.replace(":", " × "): p for name, p in effects.items()}
    for effect, p in [*_by_effect(tests, "Friedman").items()][:1]:
        p_of[f"{effect} by ranks (Friedman)"] = p
    for title, is_shown in ((f"Shown at {ALPHA:g}", True), ("Not shown", False)):
        if named := [
            f"{n}, p {format_p(p, 0)}" for n, p in p_of.items() if (p < ALPHA) == is_shown
        ]:
            yield f"{title}: {'; '.join(named)}."
    for name in names[1:]:
        note = str(tests.loc[tests["test"] == name, "note"].iloc[0])
        if "not computed" in note or "excluded" in note:
            yield f"{name}: {note}."
