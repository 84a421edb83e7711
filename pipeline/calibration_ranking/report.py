"""Experiment 2 as tables, figures and one page."""

from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from pipeline.calibration_ranking.belts import Interaction
from pipeline.calibration_ranking.effects import (
    calibration_effects,
    ratio_to_random,
    ratios_to_random,
)
from pipeline.calibration_ranking.experiment import BeltResults, PlatformResults, RankingResults
from pipeline.calibration_ranking.figures import (
    belt_figure,
    compensation_figure,
    interaction_figure,
    rank_figure,
)
from pipeline.calibration_ranking.ranking import Model, Ranking, best_trials
from pipeline.calibration_ranking.trials import BELT_FILTER, RATE_HZ
from pipeline.figures.style import save_figure
from pipeline.io.write import markdown, write_csv, write_text

THESIS_NAMES: Final = {"Fx": "Fz", "Fy": "Fx", "Fz": "Fy", "Mx": "Mz", "My": "Mx", "Mz": "My"}
"""Components in lab directions (x forward, y left, z up) -> the thesis' (x right, y up, z back)."""
ALPHA: Final = 0.05
"""Level of significance, Bonferroni-corrected."""


def recommendation(ranking: Ranking[Model], purpose: str) -> str:
    """Recommend a calibration trial in one sentence, with how certain that is."""
    first = ranking.table.iloc[0]
    columns = len(ranking.scores) // len(ranking.table)
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
        f"Use {ranking.winner} for {purpose}: mean rank {first['mean_rank']:.1f} of "
        f"{len(ranking.table)}, best in {first['firsts']:.0f} of {columns} columns and in "
        f"{100 * first['wins']:.0f} % of the bootstrap's resamples, {certainty}; it leaves "
        f"{ratio:.2f} times the RMS of the median trial."
    )


def table_2(ranking: Ranking[Model]) -> pd.DataFrame:
    """Lay out the winner's scores like the thesis' Table II.

    Returns
    -------
    pandas.DataFrame
        validation, variable (lab directions: x forward, y left, z up), in_thesis (the same in the
        thesis' frame), unit, rms_raw, rms_compensated, rms_reduction_percent.
    """
    rows = ranking.scores[ranking.scores["trial"] == ranking.winner]
    return pd.DataFrame(
        {
            "validation": rows["validation"],
            "variable": rows["component"],
            "in_thesis": rows["component"].map(THESIS_NAMES),
            "unit": np.where(rows["component"].str.startswith("F"), "N", "N·m"),
            "rms_raw": rows["rms_raw"],
            "rms_compensated": rows["rms_after"],
            "rms_reduction_percent": rows["reduction"],
        }
    )


def write_results(found: RankingResults, out: Path) -> list[str]:
    """Write tables, figures and ``ranking.md``.

    Parameters
    ----------
    found
        The results.
    out
        Folder to write to.

    Returns
    -------
    list[str]
        The recommendations, one sentence each.
    """
    page, advice = ["# Which calibration trial?"], []
    if found.platform is not None:
        advice.append(recommendation(found.platform.ranking, "pitch and sway"))
        page += ["## Pitch and sway", advice[-1], *_platform_section(found.platform, out)]
    if found.belts is not None:
        advice.append(recommendation(found.belts.ranking, "the belts"))
        page += [
            "## Belts",
            advice[-1],
            *_belt_section(found.belts, out),
            "## Do the belts vibrate the accelerometers?",
            *_interaction_section(found.belts, out),
        ]
    write_text("\n\n".join(page) + "\n", out / "ranking.md")
    return advice


def _platform_section(found: PlatformResults, out: Path) -> list[str]:
    ranking, validation = found.ranking, found.validation
    best, winners_scores = best_trials(ranking).reset_index(), table_2(ranking)
    write_csv(ranking.table, out / "ranking.csv")
    write_csv(ranking.scores, out / "scores.csv")
    write_csv(best, out / "best_trials.csv")
    write_csv(winners_scores, out / "table_2.csv")
    note = (
        f"Calibration trial: {ranking.winner}. Directions: x forward, y left, z up, about the "
        "centre of the plate; the thesis' names beside them (x right, y up, z back)."
    )
    write_text(f"{note}\n\n{markdown(winners_scores, 1)}\n", out / "table_2.md")
    for trial in validation:
        figure = compensation_figure(trial, ranking.models[ranking.winner], ranking.winner)
        save_figure(figure, out / "figures" / f"{trial.name}.png")
    save_figure(rank_figure(ranking), out / "figures" / "ranks.png")
    w, p = ranking.concordance
    setup = validation[0].setup
    return [
        f"Plate and accelerometers were low-passed at {setup.cutoff_hz:g} Hz "
        f"({setup.filter_method}, as 'hbm calibration fit' does).",
        f"Agreement of the columns: Kendall's W = {w:.2f} (p = {p:.2g}; 1 means the same order "
        "in all).",
        markdown(ranking.table),
        "Best trial of every column:",
        markdown(best),
        *_effects_section(ranking, out),
    ]


def _effects_section(ranking: Ranking[Model], out: Path) -> list[str]:
    tests, pairs = calibration_effects(ranking.scores)
    if tests.empty:
        return ["The names do not state kind, duration and speed: their effects are not tested."]
    write_csv(tests, out / "effects.csv")
    write_csv(pairs, out / "effect_pairs.csv")
    return [
        "Effects on the remaining RMS (type III, main effects; Bonferroni between levels in "
        "effect_pairs.csv):",
        markdown(tests, 3),
        "Remaining RMS of each kind, by that of plain random motion (all: geometric mean):",
        markdown(ratios_to_random(pairs)),
        square_sway_effect(ratio_to_random(pairs, "square_sway")),
    ]


def square_sway_effect(ratios: pd.DataFrame) -> str:
    """State whether square waves of sway improve a calibration, and in which components."""
    if ratios.empty:
        return "Square waves of sway were not compared with random motion."
    significant = ratios[ratios["p_bonferroni"] < ALPHA]
    mean = float(np.exp(np.log(ratios["ratio"]).mean()))
    less = list(significant["component"][significant["ratio"] < 1])
    more = list(significant["component"][significant["ratio"] > 1])
    if not less and not more:
        difference = "no component differs significantly"
    else:
        difference = (
            f"significantly less is left in {', '.join(less) or 'none'}, "
            f"more in {', '.join(more) or 'none'}"
        )
    return (
        f"Square waves of sway leave {mean:.2f} times the RMS of plain random motion: {difference}."
    )


def _belt_section(found: BeltResults, out: Path) -> list[str]:
    ranking, trials = found.ranking, found.trials
    fitted = pd.DataFrame(
        [
            (name, m.r_squared, m.rms_measured, m.rms_compensated, m.rms_reduction)
            for name, m in ranking.models.items()
        ],
        columns=["trial", "r_squared", "rms_raw", "rms_compensated", "rms_reduction_percent"],
    )
    write_csv(ranking.table, out / "belt_ranking.csv")
    write_csv(ranking.scores, out / "belt_scores.csv")
    write_csv(fitted, out / "belt_models.csv")
    for trial in trials:
        figure = belt_figure(trial, ranking.models[ranking.winner], ranking.winner)
        save_figure(figure, out / "figures" / f"{trial.name}.png")
    cutoffs = ", ".join(f"{t.spline_cutoff_hz:.0f} Hz in {t.name}" for t in trials)
    section = [
        f"Smoothing splines through the belt's speed have their cut-off at {cutoffs} "
        f"({RATE_HZ / 2:g} Hz: nothing is smoothed); --belt-cutoff-hz sets that of the low-pass "
        f"({BELT_FILTER}, as in D-Flow).",
        markdown(ranking.scores, 3),
        "Each model on its own calibration trial:",
        markdown(fitted, 3),
    ]
    tests, pairs = calibration_effects(ranking.scores)
    if tests.empty:
        return section
    write_csv(tests, out / "belt_effects.csv")
    write_csv(pairs, out / "belt_effect_pairs.csv")
    return [*section, markdown(tests, 3)]


def _interaction_section(found: BeltResults, out: Path) -> list[str]:
    interaction = found.interaction
    write_csv(interaction.table, out / "interaction.csv")
    figure = interaction_figure(found.trials[0])
    save_figure(figure, out / "figures" / "interaction.png")
    return [_interaction_sentence(interaction), markdown(interaction.table, 4)]


def _interaction_sentence(interaction: Interaction) -> str:
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
