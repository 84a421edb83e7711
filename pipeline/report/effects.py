"""The tests of every residual on the page of a report: which effects are shown, and tables."""

from collections.abc import Callable, Iterator
from math import isnan
from typing import Any, Final

import pandas as pd

from pipeline.report.blocks import Table, Text, table_of
from pipeline.statistics.comparison import MIXED_ANOVA, MIXED_MODEL, RM_ANOVA
from pipeline.statistics.design import ALPHA, Design
from pipeline.statistics.table_3 import format_p, number
from pipeline.trial.residuals import AXES, DIRECTIONS, rows_of

CSS: Final = "numbers tests"


def residual_tests(statistics: pd.DataFrame, design: Design) -> list[tuple[Text, list[Table]]]:
    """Show the tests of every residual: which effects are shown, and the tables.

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
        was tested;
        tables of the analyses of variance, Friedman's test and the planned pairs that were
        computed. One for all residuals where no test of any was computed for the same reason.
    """
    found = []
    for k, axis in enumerate(AXES):
        own = statistics[statistics["axis"] == axis]
        if not own.empty:
            name = f"{axis} {'' if k < 3 else 'about '}{DIRECTIONS[k]}"
            mixed, others = own["test"] == MIXED_MODEL, own[own["test"] != MIXED_MODEL]
            tables = [*_mixed_tables(own[mixed], design)]
            tables += [t for name in _anova_names(others) for t in _anova_table(others, name)]
            tables += [*_friedman_table(others), *_pair_table(others, design)]
            found.append((Text(name, tuple(_lines(own))), tables))
    reasons = {text.lines for text, _ in found}
    if len(found) > 1 and len(reasons) == 1 and not any(tables for _, tables in found):
        return [(Text("All residuals", *reasons), [])]
    return found


def _computed(tests: pd.DataFrame, test: str) -> pd.DataFrame:
    """Give the rows of a test that have a p-value."""
    return tests[(tests["test"] == test) & tests["p_corrected"].notna()]


def _by(tests: pd.DataFrame, key: str) -> dict[str, Any]:
    """Give rows by their test or effect."""
    return {getattr(row, key): row for row in rows_of(tests)}


def _anova_names(tests: pd.DataFrame) -> list[str]:
    """Give the names of the analyses of variance, the one with covariates last."""
    names = tests["test"].drop_duplicates()
    return [n for n in names if n.partition(" with ")[0] in (RM_ANOVA, MIXED_ANOVA)]


def _mixed_tables(tests: pd.DataFrame, design: Design) -> Iterator[Table]:
    """Show mixed models of all recordings: planned pairs, and factors."""
    computed = tests[tests["p_corrected"].notna()]
    pairs = rows_of(_of_correction(computed[computed["statistic_name"] == "t"], design))
    if pairs:
        columns: dict[str, Callable[[Any], str]] = {
            "Pair": lambda row: row.effect.replace(" - ", " − "),
            "n": lambda row: f"{row.n} ({row.note})",
            "mean difference [95 % CI]": lambda row: _with_interval(row, "+z.1f"),
            "t": lambda row: number(row.statistic, ".2f"),
            "df": lambda row: f"{row.df1:.1f}",
            "p": lambda row: format_p(row.p_corrected),
        }
        caption = f"All recordings, a mixed model per pair: planned pairs{_correction(design)}"
        yield table_of(caption, columns, pairs, CSS)
    factors = rows_of(computed[computed["statistic_name"] == "F"])
    if factors:
        columns = {
            "Effect": lambda row: row.effect.replace(":", " × "),
            "F": lambda row: number(row.statistic, ".2f"),
            "df": lambda row: f"{row.df1:g}, {row.df2:.1f}",
            "p": lambda row: format_p(row.p_corrected),
        }
        caption = f"All recordings, a mixed model of all cells: {factors[0].note}"
        yield table_of(caption, columns, factors, CSS)


def _of_correction(tests: pd.DataFrame, design: Design) -> pd.DataFrame:
    """Give the rows of planned pairs with the correction that the design names."""
    return tests[tests["correction"].astype(str).str.lower().str.startswith(design.correction)]


def _correction(design: Design) -> str:
    """Say how p of planned pairs is corrected, and for what intervals hold."""
    count = len(design.pairs)
    how = f", p {design.correction.capitalize()}-corrected for {count}" * (count > 1)
    how += ", all groups together" * (design.group is not None)
    return how + "; each interval is of one pair alone" * (count > 1)


def _anova_table(tests: pd.DataFrame, test: str) -> Iterator[Table]:
    """Show an analysis of variance with Mauchly's test."""
    mauchly = _by(tests[tests["test"] == f"Mauchly, {test}"], "effect")
    effects = rows_of(_computed(tests, test))
    columns: dict[str, Callable[[Any], str]] = {
        "Effect": lambda row: row.effect.replace(":", " × "),
        "F": lambda row: number(row.statistic, ".2f"),
        "df": lambda row: f"{row.df1:g}, {row.df2:g}",
        "ε GG": lambda row: number(row.epsilon, ".3f") if row.df1 > 1 and row.epsilon < 1 else "–",
        "p": lambda row: format_p(row.p_uncorrected),
        "p corrected": lambda row: format_p(row.p_corrected) + " GG" * (row.correction != "none"),
        "partial η² [95 % CI]": lambda row: _with_interval(row, ".2f"),
        "power": lambda row: number(row.power, ".2f"),
        "Mauchly's W": lambda row: (
            number(mauchly[row.effect].statistic, ".3f") if row.effect in mauchly else "–"
        ),
        "its p": lambda row: (
            format_p(mauchly[row.effect].p_corrected) if row.effect in mauchly else "–"
        ),
    }
    if effects:
        yield table_of(f"{test}, n = {effects[0].n}", columns, effects, CSS)


def _friedman_table(tests: pd.DataFrame) -> Iterator[Table]:
    """Show Friedman's test."""
    columns: dict[str, Callable[[Any], str]] = {
        "Cells": lambda row: row.effect,
        "χ²": lambda row: number(row.statistic, ".2f"),
        "df": lambda row: f"{row.df1:g}",
        "p": lambda row: format_p(row.p_corrected),
        "Kendall's W": lambda row: number(row.effect_size, ".2f"),
    }
    if rows := rows_of(_computed(tests, "Friedman")):
        yield table_of("Friedman's test", columns, rows, CSS)


def _pair_table(tests: pd.DataFrame, design: Design) -> Iterator[Table]:
    """Give planned pairs with effect sizes and both Wilcoxon p-values side by side."""
    corrected, of_pairs = _of_correction(tests, design), []
    for first, second in design.pairs:
        pair = f"{first} - {second}"
        if of_pair := _by(corrected[corrected["effect"] == pair], "test"):
            sizes = tests[(tests["effect"] == pair) & (tests["test"] == "estimate")]
            of_pairs.append(of_pair | _by(sizes, "effect_size_name"))
    columns: dict[str, Callable[[Any], str]] = {
        "Pair": lambda of: of["Wilcoxon exact"].effect.replace(" - ", " − "),
        "n": lambda of: str(of["Wilcoxon exact"].n),
        "mean difference [95 % CI]": lambda of: _with_interval(of["mean difference"], "+z.1f"),
        "Cohen's dz [95 % CI]": lambda of: _with_interval(of["Cohen's dz"], "+z.2f"),
        "p, t": lambda of: format_p(of["paired t"].p_corrected),
        "p, Wilcoxon exact": lambda of: format_p(of["Wilcoxon exact"].p_corrected),
        "p, Wilcoxon asymptotic": lambda of: format_p(of["Wilcoxon asymptotic"].p_corrected),
        "rank-biserial": lambda of: number(of["Wilcoxon exact"].effect_size, "+z.2f"),
    }
    if of_pairs:
        yield table_of(f"Planned pairs{_correction(design)}", columns, of_pairs, CSS)


def _with_interval(row: Any, form: str) -> str:
    """Write an effect size with its interval."""
    value = number(row.effect_size, form)
    if isnan(row.ci_low):
        return value
    return f"{value} [{number(row.ci_low, form)}, {number(row.ci_high, form)}]"


def _lines(tests: pd.DataFrame) -> Iterator[str]:
    """Say which effects are shown and which are not, or why nothing was tested."""
    names = _anova_names(tests)
    effects = _by(_computed(tests, names[0]), "effect") if names else {}
    if not effects:
        notes = tests.loc[tests["test"].isin((*names, "all")), "note"]
        reason = str(notes.iloc[0]) if len(notes) else "nothing was tested"
        yield f"{reason[0].upper()}{reason[1:]}."
    found = {name.replace(":", " × "): row.p_corrected for name, row in effects.items()}
    for row in rows_of(_computed(tests, "Friedman"))[:1]:
        found[f"{row.effect} by ranks (Friedman)"] = row.p_corrected
    for title, is_shown in ((f"Shown at {ALPHA:g}", True), ("Not shown", False)):
        own = [
            f"{name}, p {format_p(p, 0)}" for name, p in found.items() if (p < ALPHA) == is_shown
        ]
        if own:
            yield f"{title}: {'; '.join(own)}."
    for name in names[1:]:
        note = str(tests.loc[tests["test"] == name, "note"].iloc[0])
        if "not computed" in note or "excluded" in note:
            yield f"{name}: {note}."
