"""The tests of every residual on the page of a report: tables, and each effect in words."""

from collections.abc import Iterator
from math import isnan
from typing import Any, Final

import pandas as pd

from pipeline.report.blocks import Table, Text
from pipeline.statistics.comparison import ALL_CELLS, MIXED_ANOVA, RM_ANOVA
from pipeline.statistics.design import ALPHA, COMPENSATION, Design
from pipeline.statistics.table_3 import format_p, number
from pipeline.statistics.verdict import join_names
from pipeline.trial.residuals import AXES, DIRECTIONS, rows_of

ANOVA_HEADS: Final = (
    *("Effect", "F", "df", "ε GG", "p", "p corrected", "partial η² [95 % CI]"),
    *("power", "Mauchly's W", "its p"),
)
FRIEDMAN_HEADS: Final = ("Cells", "χ²", "df", "p", "Kendall's W")
PAIR_HEADS: Final = (
    *("Pair", "n", "mean difference [95 % CI]", "Cohen's dz [95 % CI]"),
    *("p, t", "p, Wilcoxon exact", "p, Wilcoxon asymptotic", "rank-biserial"),
)


def residual_tests(statistics: pd.DataFrame, design: Design) -> list[tuple[Text, list[Table]]]:
    """Show the tests of every residual: each effect in a sentence, and the tables.

    Parameters
    ----------
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned.
    design
        The design that it was computed for.

    Returns
    -------
    list
        In order of the axes: the residual with a sentence per effect, or why nothing was tested;
        tables of the analyses of variance, Friedman's test and the planned pairs that were
        computed. One for all residuals where no test of any was computed for the same reason.
    """
    found = []
    for k, axis in enumerate(AXES):
        own = statistics[statistics["axis"] == axis]
        if not own.empty:
            name = f"{axis} {'' if k < 3 else 'about '}{DIRECTIONS[k]}"
            tables = [*_anova_tables(own), *_friedman_table(own), *_pair_table(own, design)]
            found.append((Text(name, tuple(_sentences(own, design))), tables))
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


def _anova_tables(tests: pd.DataFrame) -> Iterator[Table]:
    """Show each analysis of variance with Mauchly's test."""
    for test in _anova_names(tests):
        mauchly = _by(tests[tests["test"] == f"Mauchly, {test}"], "effect")
        effects = _by(_computed(tests, test), "effect")
        rows = tuple(_anova_row(row, mauchly.get(effect)) for effect, row in effects.items())
        if rows:
            n = next(iter(effects.values())).n
            yield Table(f"{test}, n = {n}", ANOVA_HEADS, rows, "numbers tests")


def _anova_row(row: Any, sphericity: Any) -> tuple[str, ...]:
    """Show one effect."""
    several = row.df1 > 1 and row.epsilon < 1
    w_and_p = ("–", "–")
    if sphericity is not None:
        w_and_p = (number(sphericity.statistic, ".3f"), format_p(sphericity.p_corrected))
    return (
        row.effect.replace(":", " × "),
        number(row.statistic, ".2f"),
        f"{row.df1:g}, {row.df2:g}",
        number(row.epsilon, ".3f") if several else "–",
        format_p(row.p_uncorrected),
        format_p(row.p_corrected) + " GG" * (row.correction != "none"),
        _with_interval(row, ".2f"),
        number(row.power, ".2f"),
        *w_and_p,
    )


def _friedman_table(tests: pd.DataFrame) -> Iterator[Table]:
    """Show Friedman's test."""
    rows = tuple(
        (
            row.effect,
            number(row.statistic, ".2f"),
            f"{row.df1:g}",
            format_p(row.p_corrected),
            number(row.effect_size, ".2f"),
        )
        for row in _by(_computed(tests, "Friedman"), "effect").values()
    )
    if rows:
        yield Table("Friedman's test", FRIEDMAN_HEADS, rows, "numbers tests")


def _pair_table(tests: pd.DataFrame, design: Design) -> Iterator[Table]:
    """Give planned pairs with effect sizes and both Wilcoxon p-values side by side."""
    rows = []
    correction = tests["correction"].astype(str).str.lower()
    corrected = tests[correction.str.startswith(design.correction)]
    for first, second in design.pairs:
        pair = f"{first} - {second}"
        of_pair = _by(corrected[corrected["effect"] == pair], "test")
        if not of_pair:
            continue
        own = tests[tests["effect"] == pair]
        sizes = _by(own[own["test"] == "estimate"], "effect_size_name")
        exact = of_pair["Wilcoxon exact"]
        rows.append(
            (
                pair.replace(" - ", " − "),
                str(exact.n),
                _with_interval(sizes["mean difference"], "+z.1f"),
                _with_interval(sizes["Cohen's dz"], "+z.2f"),
                format_p(of_pair["paired t"].p_corrected),
                format_p(exact.p_corrected),
                format_p(of_pair["Wilcoxon asymptotic"].p_corrected),
                number(exact.effect_size, "+z.2f"),
            )
        )
    if rows:
        count = len(design.pairs)
        how = f", p {design.correction.capitalize()}-corrected for {count}" * (count > 1)
        how += ", all groups together" * (design.group is not None)
        alone = "; each interval is of one pair alone" * (count > 1)
        yield Table(f"Planned pairs{how}{alone}", PAIR_HEADS, tuple(rows), "numbers tests")


def _with_interval(row: Any, form: str) -> str:
    """Write an effect size with its interval."""
    value = number(row.effect_size, form)
    if isnan(row.ci_low):
        return value
    return f"{value} [{number(row.ci_low, form)}, {number(row.ci_high, form)}]"


def _sentences(tests: pd.DataFrame, design: Design) -> Iterator[str]:
    """Say of every effect whether it is shown."""
    names = _anova_names(tests)
    effects = _by(_computed(tests, names[0]), "effect") if names else {}
    if not effects:
        notes = tests.loc[tests["test"].isin((*names, "all")), "note"]
        reason = str(notes.iloc[0]) if len(notes) else "nothing was tested"
        yield f"{reason[0].upper()}{reason[1:]}."
    for effect, row in effects.items():
        share = 1.0 if row.correction == "none" else row.epsilon
        yield _sentence(
            _effect_in_words(effect.split(":"), design),
            row.p_corrected,
            f"F({share * row.df1:.3g}, {share * row.df2:.3g}) = {row.statistic:.2f}",
            f"partial η² {number(row.effect_size, '.2f')}",
        )
    for name in names[1:]:
        own = tests[tests["test"] == name]
        left_out = own["note"].iloc[:1].str.findall(r"[^;]* left out: [^;]*").explode().dropna()
        if own["p_corrected"].isna().all():
            yield f"{name}: {own['note'].iloc[0]}."
        elif len(left_out):
            yield f"{name}: {'; '.join(left_out.str.strip())}."
    friedman = list(_by(_computed(tests, "Friedman"), "effect").values())
    for row in friedman[:1]:
        ranked = "the cells" if row.effect == ALL_CELLS else f"the levels of {row.effect}"
        yield _sentence(
            f"By ranks (Friedman), {ranked} differ",
            row.p_corrected,
            f"χ²({row.df1:g}) = {row.statistic:.2f}",
            f"Kendall's W {number(row.effect_size, '.2f')}",
        )


def _sentence(claim: str, p: float, statistic: str, size: str) -> str:
    """Say whether a claim is shown."""
    written = format_p(p, alpha=0)
    numbers = f"{statistic}, p {written if written.startswith('<') else f'= {written}'}, {size}"
    if p < ALPHA:
        return f"{claim} ({numbers})."
    return f"Not shown: {claim[0].lower()}{claim[1:]} ({numbers})."


def _effect_in_words(parts: list[str], design: Design) -> str:
    """Give an effect as the claim that its test is of."""
    levels = {
        COMPENSATION: "between IC and no IC",
        design.factor: f"between the levels of {design.factor}",
        design.group: "between the groups",
    }
    if len(parts) > 1:
        rest = ["group" if part == design.group else part for part in parts[1:]]
        return f"The difference {levels[parts[0]]} depends on {join_names(rest)}"
    others = [factor for factor in design.factors if factor not in parts]
    claim = f"differs {levels[parts[0]]}" if parts[0] in levels else f"depends on {parts[0]}"
    average = f", on average over {join_names(others)}," if others else ""
    return f"The residual{average} {claim}"
