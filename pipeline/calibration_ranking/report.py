"""Experiment 2 as tables, figures and one page."""

from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from compensation.protocol import ADVISED_BELT_SIGNAL, ADVISED_PLATFORM_SIGNAL
from pipeline.calibration_ranking.belts import taken_away
from pipeline.calibration_ranking.choice import count_best, thesis_choice
from pipeline.calibration_ranking.effects import (
    best_levels,
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
from pipeline.calibration_ranking.verdict import (
    interaction_sentence,
    level_sentences,
    person_sentence,
    recommendation,
    square_sway_effect,
)
from pipeline.figures.style import save_figure
from pipeline.io.write import markdown, write_csv, write_text

THESIS_NAMES: Final = {"Fx": "Fz", "Fy": "Fx", "Fz": "Fy", "Mx": "Mz", "My": "Mx", "Mz": "My"}
"""Components in lab directions (x forward, y left, z up) -> the thesis' (x right, y up, z back)."""


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
        The recommendations, a paragraph each.
    """
    page, advice = ["# Which calibration trial?"], []
    if found.platform is not None:
        ranking = found.platform.ranking
        advice.append(recommendation(ranking, "pitch and sway", ADVISED_PLATFORM_SIGNAL))
        page += ["## Pitch and sway", advice[-1], *_platform_section(found.platform, out)]
    if found.belts is not None:
        advice.append(recommendation(found.belts.ranking, "the belts", ADVISED_BELT_SIGNAL))
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
    table = _with_choices(ranking)
    write_csv(table, out / "ranking.csv")
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
        markdown(table),
        "Best trial of every column (as Fig. F.7):",
        markdown(best),
        *_best_counts(best_trials(ranking), out),
        *_effects_section(ranking.scores, out),
    ]


def _with_choices(ranking: Ranking[Model]) -> pd.DataFrame:
    """Give the table of a ranking with what each rule chooses."""
    rules = {ranking.winner: ["mean rank"]}
    rules.setdefault(thesis_choice(ranking.table), []).append("thesis' rule")
    first_by = [" and ".join(rules.get(name, [])) for name in ranking.table["trial"]]
    return ranking.table.assign(first_by=first_by)


def _best_counts(best: pd.DataFrame, out: Path) -> list[str]:
    counts = count_best(best)
    if counts.empty:
        return []
    write_csv(counts, out / "best_counts.csv")
    return ["How often each kind, speed and duration is the best (as in F.2.4):", markdown(counts)]


def _effects_section(scores: pd.DataFrame, out: Path) -> list[str]:
    tests, pairs = calibration_effects(scores)
    if tests.empty:
        return [
            "Effects of kind, duration and speed are not tested: the trials' names do not state "
            "them, or the trials are too few."
        ]
    write_csv(tests, out / "effects.csv")
    write_csv(pairs, out / "effect_pairs.csv")
    f1 = best_levels(pairs)
    in_thesis = ", ".join(f"{ours} is {theirs}" for ours, theirs in THESIS_NAMES.items())
    write_csv(f1, out / "table_f1.csv")
    return [
        "Effects on the remaining RMS (type III, main effects; Bonferroni between levels in "
        "effect_pairs.csv):",
        markdown(tests, 3),
        "Best speed [m/s] and duration [s] of each component (as Table F.1; in the thesis' frame, "
        f"{in_thesis}):",
        markdown(f1),
        *level_sentences(pairs),
        *_kinds_section(pairs),
    ]


def _kinds_section(pairs: pd.DataFrame) -> list[str]:
    kinds = ratios_to_random(pairs)
    if kinds.empty:
        return []
    return [
        "Remaining RMS of each kind, by that of plain random motion (all: geometric mean):",
        markdown(kinds),
        square_sway_effect(ratio_to_random(pairs, "square_sway")),
    ]


def _belt_section(found: BeltResults, out: Path) -> list[str]:
    ranking, trials = found.ranking, (*found.validation, *found.person)
    fitted = pd.DataFrame(
        [
            (name, m.r_squared, m.rms_measured, m.rms_compensated, m.rms_reduction)
            for name, m in ranking.models.items()
        ],
        columns=["trial", "r_squared", "rms_raw", "rms_compensated", "rms_reduction_percent"],
    )
    person = taken_away(ranking.models[ranking.winner], found.validation, found.person)
    table = _with_choices(ranking)
    write_csv(table, out / "belt_ranking.csv")
    write_csv(person, out / "belt_person.csv")
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
        markdown(table),
        markdown(ranking.scores, 3),
        person_sentence(person),
        markdown(person),
        "Each model on its own calibration trial:",
        markdown(fitted, 3),
    ]
    tests, pairs = calibration_effects(ranking.scores)
    if tests.empty:
        return section
    write_csv(tests, out / "belt_effects.csv")
    write_csv(pairs, out / "belt_effect_pairs.csv")
    return [*section, markdown(tests, 3), *level_sentences(pairs)]


def _interaction_section(found: BeltResults, out: Path) -> list[str]:
    interaction = found.interaction
    write_csv(interaction.table, out / "interaction.csv")
    figure = interaction_figure(found.validation[0])
    save_figure(figure, out / "figures" / "interaction.png")
    return [interaction_sentence(interaction), markdown(interaction.table, 4)]
