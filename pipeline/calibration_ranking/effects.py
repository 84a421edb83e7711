"""Experiment 2: effects of belt speed, duration and kind of a calibration trial."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from pipeline.calibration_ranking.trials import factors
from pipeline.statistics.factorial import anova, compare_levels

FACTORS: Final = ("speed_mps", "duration_s", "kind")
REFERENCE: Final = "random"
"""Kind of trial that the others are compared with: plain random motion."""


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
        component, factor, first, second, ratio of the RMS after compensation (first by second)
        with ratio_low and ratio_high, p_bonferroni. Both empty where names state no levels.

    Notes
    -----
    Type III, main effects. One observation is the logarithm of a trial's RMS after compensation in
    one validation trial, which is a factor of the model too.

    Deviations from the original: it compared frames of the best trial at two speeds and durations
    (van de Loosdrecht 2018, F.2.4); frames are correlated and make every difference significant,
    so here whole trials are the observations, over all kinds.
    """
    stated = scores["trial"].map(factors)
    if not all(stated):
        return pd.DataFrame(), pd.DataFrame()
    data = pd.concat([scores, pd.DataFrame(list(stated), index=scores.index)], axis=1)
    data["log_rms"] = np.log(data["rms_after"])
    used = [f for f in (*FACTORS, "validation") if data[f].nunique() > 1]
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
    return _anova_columns(tables), _pair_columns(pairs)


def ratio_to_random(pairs: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Give per component the RMS left by one kind of trial, by that left by random motion.

    Returns
    -------
    pandas.DataFrame
        component, ratio, ratio_low, ratio_high, p_bonferroni; below 1 the kind is better.
    """
    if pairs.empty:
        return pairs
    kinds = pairs[pairs["factor"] == "kind"]
    direct = kinds[kinds["first"].str.endswith(kind) & kinds["second"].str.endswith(REFERENCE)]
    reverse = kinds[kinds["second"].str.endswith(kind) & kinds["first"].str.endswith(REFERENCE)]
    inverse = reverse.assign(
        ratio=1 / reverse["ratio"],
        ratio_low=1 / reverse["ratio_high"],
        ratio_high=1 / reverse["ratio_low"],
    )
    columns = ["component", "ratio", "ratio_low", "ratio_high", "p_bonferroni"]
    return pd.concat([direct, inverse])[columns].reset_index(drop=True)


def ratios_to_random(pairs: pd.DataFrame) -> pd.DataFrame:
    """Give per kind of trial the RMS that it leaves, by that left by random motion, least first.

    Returns
    -------
    pandas.DataFrame
        kind, one column per component, and their geometric mean "all".
    """
    kinds = pairs[pairs["factor"] == "kind"]
    rows = []
    for kind in sorted({*kinds["first"], *kinds["second"]} - {REFERENCE}):
        ratios = ratio_to_random(pairs, kind).set_index("component")["ratio"]
        rows.append({"kind": kind, **ratios.to_dict(), "all": float(np.exp(np.log(ratios).mean()))})
    return pd.DataFrame(rows).sort_values("all") if rows else pd.DataFrame()


def _anova_columns(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    columns = ["component", "effect", "df", "f", "p", "partial_eta_squared"]
    return pd.concat(tables, ignore_index=True)[columns]


def _pair_columns(pairs: Sequence[pd.DataFrame]) -> pd.DataFrame:
    table = pd.concat(pairs, ignore_index=True)
    names = {"ratio": "difference", "ratio_low": "ci_low", "ratio_high": "ci_high"}
    for ratio, log in names.items():
        table[ratio] = np.exp(table[log])
    columns = ["component", "factor", "first", "second", *names, "p_bonferroni"]
    return table[columns]
