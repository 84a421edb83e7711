"""Table III of the thesis: residuals without and with compensation, and the planned pairs."""

from math import isnan, nan

import pandas as pd

from pipeline.statistics.design import CONDITIONS

MIN_PRINTED_P = 0.001
"""A p-value has three decimals and is never printed as zero."""


def reduction_percent(uncompensated: float, compensated: float) -> float:
    """Give the reduction of a residual by compensation, 100 · (1 − IC / no IC) [%].

    Negative where the residual increases; NaN where it is zero without compensation.
    """
    return 100 * (1 - compensated / uncompensated) if uncompensated > 0 else nan


def table_3(residuals: pd.DataFrame, statistics: pd.DataFrame) -> pd.DataFrame:
    """Arrange the residuals and the planned comparisons as the thesis' Table III.

    Parameters
    ----------
    residuals
        Long table of RMS residuals, as `pipeline.statistics.comparison.statistics` takes it.
    statistics
        The table that `pipeline.statistics.comparison.statistics` returned for it.

    Returns
    -------
    pandas.DataFrame
        One row per residual and condition:

        - `axis`, `unit`, `condition`, `n` subjects, and those `without` one of the two cells;
        - `mean_no_ic`, `sd_no_ic`, `mean_ic`, `sd_ic` over subjects;
        - `ic_minus_baseline_no_ic` and `ic_minus_baseline_ic`, mean differences;
        - `reduction_percent`, of the means;
        - Bonferroni-corrected p-values, paired t and exact Wilcoxon, of IC against no IC (`p_t`,
          `p_wilcoxon`) and against the baseline without IC (`p_t_baseline`,
          `p_wilcoxon_baseline`).

    Notes
    -----
    Means are over the subjects who have both cells of a row, n of them; a difference from the
    baseline is over those who have both of its cells.

    Deviations from the original: the thesis' column "IC − Base no IC" holds differences from the
    baseline *with* compensation; both are here. Its non-parametric p-values are asymptotic.
    """
    rows: list[dict[str, object]] = []
    for (axis, unit), group in residuals.groupby(["axis", "unit"], sort=False):
        rms = group.pivot(index="subject", columns=["compensated", "condition"], values="rms")
        wanted = pd.MultiIndex.from_product([[False, True], CONDITIONS])
        rms = rms.reindex(columns=wanted)
        tests = statistics[statistics["axis"] == axis]
        for condition in CONDITIONS:
            both = rms[[(False, condition), (True, condition)]].dropna()
            no_ic, ic = both[False, condition], both[True, condition]
            row = {
                "axis": axis,
                "unit": unit,
                "condition": condition,
                "n": len(both),
                "without": ", ".join(map(str, rms.index.difference(both.index))),
                "mean_no_ic": no_ic.mean(),
                "sd_no_ic": no_ic.std(),
                "mean_ic": ic.mean(),
                "sd_ic": ic.std(),
                "ic_minus_baseline_no_ic": nan,
                "ic_minus_baseline_ic": nan,
                "reduction_percent": reduction_percent(no_ic.mean(), ic.mean()),
            }
            if condition != "baseline":
                for name, compensated in (("no_ic", False), ("ic", True)):
                    difference = rms[True, condition] - rms[compensated, "baseline"]
                    row[f"ic_minus_baseline_{name}"] = difference.mean()
            pairs = {"": f"{condition} IC - {condition} no IC"}
            pairs["_baseline"] = f"{condition} IC - baseline no IC" * (condition != "baseline")
            for test, name in (("paired t", "p_t"), ("Wilcoxon exact", "p_wilcoxon")):
                for suffix, pair in pairs.items():
                    row[name + suffix] = _p_bonferroni(tests, test, pair)
            rows.append(row)
    return pd.DataFrame(rows)


def _p_bonferroni(tests: pd.DataFrame, test: str, effect: str) -> float:
    bonferroni = tests["correction"].astype(str).str.startswith("Bonferroni")
    p = tests.loc[bonferroni & (tests["test"] == test) & (tests["effect"] == effect), "p_corrected"]
    return float(p.iloc[0]) if len(p) else nan


def format_p(p: float, alpha: float = 0.05) -> str:
    """Write a p-value for a table: three decimals, "<0.001" below that, a star below alpha."""
    if isnan(p):
        return "–"
    return (f"<{MIN_PRINTED_P}" if p < MIN_PRINTED_P else f"{p:.3f}") + "*" * (p < alpha)


def table_3_markdown(table: pd.DataFrame) -> str:
    """Render `table_3` as Markdown, with a legend below."""
    heads = (
        *("Residual", "Condition", "n", "No IC", "IC", "IC − base (no IC)", "IC − base (IC)"),
        *("Reduction", "t: IC − no IC", "t: IC − base (no IC)"),
        *("Wilcoxon: IC − no IC", "Wilcoxon: IC − base (no IC)"),
    )
    lines = [heads, tuple("---" for _ in heads)]
    for row in table.to_dict("records"):
        first = row["condition"] == CONDITIONS[0]
        lines.append(
            (
                f"{row['axis']} ({row['unit']})" if first else "",
                row["condition"],
                str(row["n"]),
                _mean_sd(row["mean_no_ic"], row["sd_no_ic"]),
                _mean_sd(row["mean_ic"], row["sd_ic"]),
                _number(row["ic_minus_baseline_no_ic"], "+.1f"),
                _number(row["ic_minus_baseline_ic"], "+.1f"),
                _number(row["reduction_percent"], "z.0f", " %"),
                format_p(row["p_t"]),
                format_p(row["p_t_baseline"]),
                format_p(row["p_wilcoxon"]),
                format_p(row["p_wilcoxon_baseline"]),
            )
        )
    incomplete = {
        f"{row['condition']} without {row['without']}."
        for row in table.to_dict("records")
        if row["without"]
    }
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"""{body}

Root mean square residuals, mean ± standard deviation over n subjects, without and with inertia
compensation (IC). Differences are from the baseline without and with compensation, as labelled;
reduction is 100 · (1 − IC / no IC). p-values: paired t-test and exact Wilcoxon signed-rank test,
Bonferroni-corrected for five planned pairs; * p < 0.05. {" ".join(sorted(incomplete))}
"""


def _mean_sd(mean: float, sd: float) -> str:
    return f"{_number(mean, '.1f')} ± {_number(sd, '.1f')}"


def _number(value: float, form: str, unit: str = "") -> str:
    return "–" if isnan(value) else f"{value:{form}}{unit}"
