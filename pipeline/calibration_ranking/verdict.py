"""Experiment 2 in tests and sentences: what makes a difference, and which trial to use."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import pandas as pd

from pipeline.calibration_ranking.ranking import (
    SMALLEST_DIFFERENCE,
    Interaction,
    Model,
    Ranking,
    as_good,
    excess,
    thesis_choice,
)
from pipeline.calibration_ranking.trials import factors
from pipeline.statistics.factorial import anova, compare_levels

ALPHA: Final = 0.05
"""Level of significance, Bonferroni-corrected."""
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
        component, factor, first, second; rms_first and rms_second, the marginal means of the RMS
        after compensation [N, N·m]; difference, the first minus the second, with difference_low
        and difference_high; their ratio with ratio_low and ratio_high; p_bonferroni; verdict on
        the first: "no difference" where the interval of the difference lies within
        ± `SMALLEST_DIFFERENCE`, or the difference is significant and smaller than that, else
        "less" or "more" where it is significant, else "undecided". Both empty where names state no
        levels. Intervals hold together at 95 % (Bonferroni).

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


def ratio_to_random(pairs: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Give per component the RMS left by one kind of trial, by that left by random motion.

    Returns
    -------
    pandas.DataFrame
        component, ratio, ratio_low, ratio_high, difference, difference_low, difference_high
        [N, N·m], p_bonferroni, verdict; below 1 the kind is better.
    """
    kinds = pairs[pairs["factor"] == "kind"]
    if kinds.empty:
        return kinds
    direct = kinds[kinds["first"].str.endswith(kind) & kinds["second"].str.endswith(REFERENCE)]
    reverse = kinds[kinds["second"].str.endswith(kind) & kinds["first"].str.endswith(REFERENCE)]
    inverse = reverse.assign(
        ratio=1 / reverse["ratio"],
        ratio_low=1 / reverse["ratio_high"],
        ratio_high=1 / reverse["ratio_low"],
        difference=-reverse["difference"],
        difference_low=-reverse["difference_high"],
        difference_high=-reverse["difference_low"],
        verdict=reverse["verdict"].replace({"less": "more", "more": "less"}),
    )
    columns = [
        *("component", "ratio", "ratio_low", "ratio_high"),
        *("difference", "difference_low", "difference_high", "p_bonferroni", "verdict"),
    ]
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
    level = np.sqrt(table["rms_first"] * table["rms_second"])
    for name, log_ratio in (("", "difference"), ("_low", "ci_low"), ("_high", "ci_high")):
        table[f"difference{name}"] = 2 * level * np.sinh(logs[log_ratio] / 2)
    significant = table["p_bonferroni"] < ALPHA
    small = table["difference"].abs() < SMALLEST_DIFFERENCE
    ends = table[["difference_low", "difference_high"]].abs()
    within = (ends < SMALLEST_DIFFERENCE).all(axis=1)
    table["verdict"] = np.select(
        [
            within | (significant & small),
            significant & (table["difference"] < 0),
            significant,
        ],
        ["no difference", "less", "more"],
        "undecided",
    )
    return table


QUANTITIES: Final = {"speed_mps": ("Belt speed", "m/s"), "duration_s": ("Duration", "s")}


def recommendation(ranking: Ranking[Model], purpose: str, advised: str) -> str:
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
    good = as_good(ranking)
    first, *others = good
    if len(good) == len(ranking.table):
        use = (
            f"Any of the {len(good)} trials will do for {purpose}: none leaves "
            f"{SMALLEST_DIFFERENCE:g} N or N·m more than {first} in any column, by the bootstrap's "
            "95 % intervals."
        )
    else:
        as_well = f"; {', '.join(others)} will do as well" if others else ""
        use = f"Use {first} for {purpose}{as_well}. {_certainty(ranking)}"
    return f"{use} {_by_both_rules(ranking)} {_advice(ranking, advised)}"


def _certainty(ranking: Ranking[Model]) -> str:
    """Say how certainly the winner is the best, and how much that matters."""
    wins = 100 * ranking.table["wins"].iloc[0]
    others = [name for name in ranking.possibly_best if name != ranking.winner]
    scores = ranking.scores.set_index(["trial", "validation", "component"])["rms_after"]
    ratio = float(
        np.exp(np.mean(np.log(scores[ranking.winner] / scores.groupby(level=[1, 2]).median())))
    )
    certainty = (
        f"but {', '.join(others)} might be as good"
        if others
        else "and no other trial is likely to be better"
    )
    return (
        f"It is the best in {wins:.0f} % of the bootstrap's resamples, {certainty}; it leaves "
        f"{ratio:.2f} times the RMS of the median trial."
    )


def _by_both_rules(ranking: Ranking[Model]) -> str:
    """Say which trial is the first by mean rank, and which by the thesis' rule."""
    table, columns = ranking.table, len(ranking.scores) // len(ranking.table)
    place = list(table["trial"]).index(thesis_choice(table))
    rule = table.iloc[place]
    by_rule = (
        "and by the thesis' rule (foremost in the ranking and among the best trials of the "
        "columns) too"
        if place == 0
        else f"by the thesis' rule (foremost in the ranking and among the best trials of the "
        f"columns) {rule['trial']} (place {place + 1}, best in {rule['firsts']:.0f})"
    )
    return (
        f"By mean rank the first is {ranking.winner} (mean rank {table['mean_rank'].iloc[0]:.1f} "
        f"of {len(table)}, best in {table['firsts'].iloc[0]:.0f} of {columns} columns), {by_rule}."
    )


def _advice(ranking: Ranking[Model], advised: str) -> str:
    """Say how good the advised signal is here."""
    names = list(ranking.table["trial"])
    if advised not in names:
        return f"The signal that is advised for any machine, {advised}, is not among these trials."
    more = excess(ranking, advised).sort_values()
    validation, component = more.index[-1]
    largest, unit = more.iloc[-1], "N" if component.startswith("F") else "N·m"
    most = (
        "as much as the first"
        if advised in as_good(ranking)
        else f"at most {largest:.3g} {unit} more than the first ({component} in {validation})"
    )
    return (
        f"The signal that is advised for any machine, {advised}, is in place "
        f"{names.index(advised) + 1} and leaves {most}."
    )


def person_sentence(table: pd.DataFrame) -> str:
    """State what a belt model takes away with and without a person, given `taken_away`."""

    def taken(answer: str) -> str:
        """Give the range of the reductions, with nobody or with a person."""
        reductions = table["reduction"][table["person"] == answer]
        low, high = f"{reductions.min():.0f}", f"{reductions.max():.0f}"
        return f"{low} %" if low == high else f"{low} to {high} %"

    text = f"{taken('no')} of the pitch moment is taken away with nobody on a belt"
    if not (table["person"] == "yes").any():
        return f"{text}; there is no recording with a person (belt_person)."
    return (
        f"{text}, {taken('yes')} with a person on the other belt (7 % in the thesis): a person "
        "moves the platform, which accelerometers show and the belts' acceleration does not."
    )


def _verdicts(rows: pd.DataFrame, less: str, more: str) -> str:
    """Name the components of every verdict."""
    texts = {"less": less, "more": more, "undecided": "undecided", "no difference": "no difference"}
    return "; ".join(
        f"{text} in {', '.join(rows['component'][rows['verdict'] == verdict])}"
        for verdict, text in texts.items()
        if (rows["verdict"] == verdict).any()
    )


def level_sentences(pairs: pd.DataFrame) -> list[str]:
    """State per factor of two levels which of them leaves less, and in which components."""
    sentences = []
    for factor, (name, unit) in QUANTITIES.items():
        rows = pairs[pairs["factor"] == factor]
        if len(rows) != rows["component"].nunique() or rows.empty:
            continue
        first, second = (f"{rows[side].iloc[0]:g} {unit}" for side in ("first", "second"))
        if (rows["verdict"] == "no difference").all():
            sentences.append(f"{name}: {first} or {second}, any will do ({_largest(rows)}).")
            continue
        verdicts = _verdicts(rows, f"{first} leaves less", f"{second} leaves less")
        sentences.append(f"{name}: {verdicts} ({_largest(rows)}).")
    return sentences


def square_sway_effect(ratios: pd.DataFrame) -> str:
    """State whether square waves of sway improve a calibration, and in which components."""
    if ratios.empty:
        return "Square waves of sway were not compared with random motion."
    mean = float(np.exp(np.log(ratios["ratio"]).mean()))
    return (
        f"Square waves of sway leave {mean:.2f} times the RMS of plain random motion: "
        f"{_verdicts(ratios, 'less is left', 'more is left')} ({_largest(ratios)})."
    )


def _largest(rows: pd.DataFrame) -> str:
    """State the largest of some differences, its interval, and the smallest that matters."""
    row = rows.iloc[int(np.argmax(np.abs(rows["difference"])))]
    ends = row["difference_low"], row["difference_high"]
    low, high = ends if row["difference"] >= 0 else (-ends[1], -ends[0])
    unit = "N" if row["component"].startswith("F") else "N·m"
    return (
        f"the largest difference is {abs(row['difference']):.2g} {unit} "
        f"({low:.2g} to {high:.2g}), in {row['component']}; none below {SMALLEST_DIFFERENCE:g} "
        "counts"
    )


def interaction_sentence(interaction: Interaction) -> str:
    """State which accelerometers respond to the belts, and what that costs."""
    table = interaction.table
    level = ALPHA / len(table)
    following, shaken = (table[table[p] < level] for p in ("p", "p_rms_ratio"))
    if len(following):
        text = f"{', '.join(following['channel'])} follow the belt's acceleration significantly"
    else:
        text = (
            f"None of {', '.join(table['channel'])} follows the belt's acceleration significantly"
        )
    if len(shaken):
        ratios = ", ".join(
            f"{row.channel} {row.rms_ratio:.1f} times" for row in shaken.itertuples()
        )
        text += f"; while it accelerates, and half a second after, they vibrate more ({ratios})"
    if np.isfinite(interaction.artefact).all():
        force, moment = interaction.artefact[:3].max(), interaction.artefact[3:].max()
        text += (
            f"; compensation adds up to {force:.2f} N and {moment:.2f} N·m RMS due to the part "
            "that follows"
        )
    return f"{text}."
