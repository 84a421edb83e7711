"""Experiment 2 in tests and tables: what makes a difference, and which trial to use."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.calibration_ranking.ranking import (
    LIMITS,
    Model,
    Ranking,
    as_good,
    excess,
    thesis_choice,
)
from pipeline.calibration_ranking.trials import factors
from pipeline.report.blocks import Check, Table
from pipeline.statistics.factorial import anova, compare_levels

ALPHA: Final = 0.05
"""Level of significance, Bonferroni-corrected."""


def calibration_effects(scores: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Test belt speed, duration and kind of the calibration trials, per component.

    Parameters
    ----------
    scores
        As in `pipeline.calibration_ranking.ranking.Ranking`; the trials' names state kind,
        duration and speed.

    Returns
    -------
    anova
        component, effect, df, f, p, partial_eta_squared.
    pairs
        component, factor, first, second; rms_first and rms_second, the marginal means of the RMS
        after compensation [N, N·m]; difference, the first minus the second, with difference_low
        and difference_high; their ratio with ratio_low and ratio_high; p_bonferroni; verdict on
        the first: "no difference" where the interval of the difference lies within
        ± the least difference that matters, or the difference is significant and smaller than
        that, else "less" or "more" where it is significant, else "undecided". Both empty where
        names state no levels. Intervals hold together at 95 % (Bonferroni).

    Notes
    -----
    Type III, main effects. One observation is the logarithm of a trial's RMS after compensation in
    one validation trial, which is a factor of the model too; marginal means are geometric. The
    interval of the difference is that of the ratio at the geometric mean of both levels, g:
    g (√ratio − 1/√ratio).

    Deviations from the original: it compared frames of the best trial at two speeds and durations
    (van de Loosdrecht 2018, F.2.4); frames are correlated and make every difference significant,
    so here whole trials are the observations, over all kinds.
    """
    by_name = scores["trial"].map(factors)
    if not all(by_name):
        return pd.DataFrame(), pd.DataFrame()
    data = pd.concat([scores, pd.DataFrame(list(by_name), index=scores.index)], axis=1)
    # logarithms, since signals change what is left by a factor, large or small as it may be
    data["log_rms"] = np.log(data["rms_after"])
    used = [f for f in ("speed_mps", "duration_s", "kind", "validation") if data[f].nunique() > 1]
    tested = [f for f in used if f != "validation"]
    tables, pairs = [], []
    for component, part in data.groupby("component", sort=False):
        try:
            table = anova(part, "log_rms", used)
        except ValueError:
            return pd.DataFrame(), pd.DataFrame()
        table = table[table["effect"].isin(tested)]
        tables.append(table.assign(component=component))
        for factor in tested:
            compared = compare_levels(part, "log_rms", used, factor)
            pairs.append(compared.assign(component=component, factor=factor))
    columns = ["component", "effect", "df", "f", "p", "partial_eta_squared"]
    return pd.concat(tables, ignore_index=True)[columns], _pair_columns(pairs)


def best_levels(pairs: pd.DataFrame) -> pd.DataFrame:
    """Give the best belt speed and duration per component, like the thesis' Table F.1.

    Parameters
    ----------
    pairs
        From `calibration_effects`.

    Returns
    -------
    pandas.DataFrame
        A row per factor of two levels: factor, and per component the level that leaves less, "any"
        where they make no difference, or "undecided" where that is not known.
    """
    numbers = pairs[pairs["factor"].isin(["speed_mps", "duration_s"])]
    two = numbers.groupby(["factor", "component"]).filter(lambda compared: len(compared) == 1)
    best = np.select(
        [two["verdict"] == "less", two["verdict"] == "more", two["verdict"] == "no difference"],
        [two["first"].map("{:g}".format), two["second"].map("{:g}".format), "any"],
        "undecided",
    )
    wide = two.assign(best=best).pivot(index="factor", columns="component", values="best")
    return wide[list(dict.fromkeys(two["component"]))].reset_index()


def _pair_columns(pairs: Sequence[pd.DataFrame]) -> pd.DataFrame:
    logs = pd.concat(pairs, ignore_index=True)
    table = logs[["component", "factor", "first", "second"]].assign(
        rms_first=np.exp(logs["mean_first"]),
        rms_second=np.exp(logs["mean_second"]),
        ratio=np.exp(logs["difference"]),
        ratio_low=np.exp(logs["ci_low"]),
        ratio_high=np.exp(logs["ci_high"]),
        p_bonferroni=logs["p_bonferroni"],
    )
    # from a difference of logarithms, d, to g (√r - 1/√r) = 2 g sinh(d / 2) at the geometric mean
    level = np.sqrt(table["rms_first"] * table["rms_second"])
    for name, log_ratio in (("", "difference"), ("_low", "ci_low"), ("_high", "ci_high")):
        table[f"difference{name}"] = 2 * level * np.sinh(logs[log_ratio] / 2)
    # no difference: shown to be small, whether significant or not
    significant = table["p_bonferroni"] < ALPHA
    least = LIMITS.least_difference
    small = table["difference"].abs() < least
    within = (table[["difference_low", "difference_high"]].abs() < least).all(axis=1)
    none, less = within | (significant & small), significant & (table["difference"] < 0)
    verdicts = ["no difference", "less", "more"]
    table["verdict"] = np.select([none, less, significant], verdicts, "undecided")
    return table


def recommendation(ranking: Ranking[Model], purpose: str, advised: str) -> Table:
    """Recommend a calibration trial, by mean rank and by the thesis' rule, and how certain that is.

    Parameters
    ----------
    ranking
        The trials.
    purpose
        What they calibrate.
    advised
        Name of the protocol's signal that is advised for that.
    """
    table, top = ranking.table, ranking.table.iloc[0]
    names, (first, *others) = list(table["trial"]), as_good(ranking)
    rivals = [name for name in ranking.possibly_best if name != ranking.winner]
    by_rule, columns = thesis_choice(table), len(ranking.scores) // len(names)
    place = "not among these trials"
    if advised in names:
        more = excess(ranking, advised).sort_values()
        validation, component = more.index[-1]
        unit = "N" if component.startswith("F") else "N·m"
        place = (
            f"place {names.index(advised) + 1}, at most {more.iloc[-1]:.3g} {unit} more "
            f"({component} in {validation})"
        )
    rows: list[tuple[str, str | list[Check]]] = [
        ("Use", [("pass", first, "")]),
        (f"As good to {LIMITS.least_difference:g} N or N·m", ", ".join(others) or "none"),
        ("Best in the bootstrap", f"{100 * top['wins']:.0f} % of the resamples"),
        ("May be better", ", ".join(rivals) or "none"),
        (
            "Mean rank",
            f"{top['mean_rank']:.1f} of {len(names)}, best in {top['firsts']:.0f} of {columns} "
            "columns",
        ),
        ("By the thesis' rule", f"{by_rule}, place {names.index(by_rule) + 1}"),
        (f"Advised: {advised}", place),
    ]
    return Table(f"Signal for {purpose}", ("Question", "Answer"), rows, "answers")


def interaction_table(table: pd.DataFrame, artefact: Array) -> Table:
    """State which accelerometers respond to the belts, and what that costs."""
    following = table["channel"][table["p"] < ALPHA / len(table)]
    rows = [("Follow the belt's acceleration", ", ".join(following) or "none")]
    if np.isfinite(artefact).all():
        text = f"{artefact[:3].max():.2f} N, {artefact[3:].max():.2f} N·m RMS at most"
        rows.append(("Added by compensation", text))
    return Table("Accelerometers and belts", ("Question", "Answer"), rows, "answers")
