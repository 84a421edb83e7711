"""Experiment 2 in sentences: which calibration trial to use, and what makes a difference."""

from typing import Final

import numpy as np
import pandas as pd

from pipeline.calibration_ranking.belts import Interaction
from pipeline.calibration_ranking.choice import (
    SMALLEST_DIFFERENCE,
    as_good,
    excess,
    thesis_choice,
)
from pipeline.calibration_ranking.effects import ALPHA
from pipeline.calibration_ranking.ranking import Model, Ranking

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
    nobody, person = (table["reduction"][table["person"] == answer] for answer in ("no", "yes"))
    text = f"{_range(nobody)} of the pitch moment is taken away with nobody on a belt"
    if person.empty:
        return f"{text}; there is no recording with a person (belt_person)."
    return (
        f"{text}, {_range(person)} with a person on the other belt (7 % in the thesis): a person "
        "moves the platform, which accelerometers show and the belts' acceleration does not."
    )


def _range(reductions: pd.Series) -> str:
    low, high = reductions.min(), reductions.max()
    return f"{low:.0f} %" if f"{low:.0f}" == f"{high:.0f}" else f"{low:.0f} to {high:.0f} %"


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
