"""Experiment 2 as tables, figures and one page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from compensation import BeltModel
from pipeline.calibration_ranking.belts import Interaction
from pipeline.calibration_ranking.effects import better_than_random, effects, kinds_by_random
from pipeline.calibration_ranking.figures import (
    belt_figure,
    compensation_figure,
    interaction_figure,
    rank_figure,
)
from pipeline.calibration_ranking.ranking import Ranking, best_trials
from pipeline.calibration_ranking.trials import (
    BELT_FILTER,
    RATE_HZ,
    BeltTrial,
    PlatformTrial,
)
from pipeline.figures.style import save_figure
from pipeline.io.write import markdown, write_csv, write_text

THESIS_NAMES: Final = {"Fx": "Fz", "Fy": "Fx", "Fz": "Fy", "Mx": "Mz", "My": "Mx", "Mz": "My"}
"""Components in lab directions (x forward, y left, z up) -> the thesis' (x right, y up, z back)."""


@dataclass(frozen=True, slots=True)
class Experiment2:
    """All that experiment 2 found; None where it had no recordings.

    Attributes
    ----------
    platform
        Ranking of the pitch and sway calibrations.
    validation
        Its validation trials.
    belts
        Ranking of the belt calibrations, and their models.
    belt_trials
        Belt validation trials, then those with a person.
    interaction
        Belts against accelerometers, and the channels' names.
    """

    platform: Ranking | None = None
    validation: tuple[PlatformTrial, ...] = ()
    belts: tuple[Ranking, dict[str, BeltModel]] | None = None
    belt_trials: tuple[BeltTrial, ...] = ()
    interaction: tuple[Interaction, tuple[str, ...]] | None = None


def recommendation(ranking: Ranking, what: str) -> str:
    """Say in one sentence which calibration trial to use, and how sure that is."""
    first = ranking.table.iloc[0]
    columns = len(ranking.scores) // len(ranking.table)
    alike = [name for name in ranking.alike if name != ranking.winner]
    scores = ranking.scores.set_index(["trial", "validation", "component"])["rms_after"]
    ratio = float(
        np.exp(np.mean(np.log(scores[ranking.winner] / scores.groupby(level=[1, 2]).median())))
    )
    sure = (
        f"but {', '.join(alike)} might be as good"
        if alike
        else "and no other trial is likely to be better"
    )
    return (
        f"Use {ranking.winner} for {what}: mean rank {first['mean_rank']:.1f} of "
        f"{len(ranking.table)}, best in {first['firsts']:.0f} of {columns} columns, winner in "
        f"{100 * first['wins']:.0f} % of the repetitions drawn, {sure}; it leaves "
        f"{ratio:.2f} times the RMS of the median trial."
    )


def table_2(ranking: Ranking) -> pd.DataFrame:
    """Lay out the winner's scores as the thesis' Table II.

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


def write_experiment(found: Experiment2, out: Path) -> list[str]:
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
    page, said = ["# Which calibration trial?"], []
    if found.platform is not None:
        said.append(recommendation(found.platform, "pitch and sway"))
        page += ["## Pitch and sway", said[-1], *_platform(found.platform, found.validation, out)]
    if found.belts is not None:
        ranking, models = found.belts
        said.append(recommendation(ranking, "the belts"))
        page += ["## Belts", said[-1], *_belts(ranking, models, found.belt_trials, out)]
    if found.interaction is not None:
        page += [
            "## Do the belts shake the accelerometers?",
            *_interaction(*found.interaction, out),
        ]
        save_figure(
            interaction_figure(found.belt_trials[0], found.interaction[1]),
            out / "figures" / "interaction.png",
        )
    write_text("\n\n".join(page) + "\n", out / "ranking.md")
    return said


def _platform(ranking: Ranking, validation: tuple[PlatformTrial, ...], out: Path) -> list[str]:
    best, reduced = best_trials(ranking).reset_index(), table_2(ranking)
    write_csv(ranking.table, out / "ranking.csv")
    write_csv(ranking.scores, out / "scores.csv")
    write_csv(best, out / "best_trials.csv")
    write_csv(reduced, out / "table_2.csv")
    note = (
        f"Calibration trial: {ranking.winner}. Directions: x forward, y left, z up, about the "
        "middle of the plate; the thesis' names beside them (x right, y up, z back)."
    )
    write_text(f"{note}\n\n{markdown(reduced, 1)}\n", out / "table_2.md")
    for trial in validation:
        figure = compensation_figure(trial, ranking.models[ranking.winner], ranking.winner)
        save_figure(figure, out / "figures" / f"{trial.name}.png")
    save_figure(rank_figure(ranking), out / "figures" / "ranks.png")
    w, p = ranking.concordance
    tests, pairs = effects(ranking.scores)
    setup = validation[0].setup
    said = [
        f"Plate and accelerometers were low-passed at {setup.cutoff_hz:g} Hz "
        f"({setup.filter_method}, as 'hbm calibration fit' does).",
        f"Agreement of the columns: Kendall's W = {w:.2f} (p = {p:.2g}; 1 would be the same order "
        "in all).",
        markdown(ranking.table),
        "Best trial of every column:",
        markdown(best),
    ]
    if tests.empty:
        return [
            *said,
            "The names do not state kind, duration and speed: their effects are untested.",
        ]
    write_csv(tests, out / "effects.csv")
    write_csv(pairs, out / "effect_pairs.csv")
    squares = better_than_random(pairs, "square_sway")
    return [
        *said,
        "Effects on the RMS that is left (type III, main effects; Bonferroni between levels in "
        "effect_pairs.csv):",
        markdown(tests, 3),
        "RMS left by each kind, by that of plain random motion (all: geometric mean):",
        markdown(kinds_by_random(pairs)),
        squares_of_sway(squares),
    ]


def squares_of_sway(squares: pd.DataFrame) -> str:
    """Say whether square waves of sway help, and where."""
    if squares.empty:
        return "Square waves of sway were not compared with random motion."
    clear = squares[squares["p_bonferroni"] < 0.05]
    ratio = float(np.exp(np.log(squares["ratio"]).mean()))
    helps = [c for c, r in zip(clear["component"], clear["ratio"], strict=True) if r < 1]
    harms = [c for c, r in zip(clear["component"], clear["ratio"], strict=True) if r > 1]
    if not helps and not harms:
        verdict = "no component shows a difference beyond chance"
    else:
        verdict = (
            f"clearly less is left in {', '.join(helps) or 'none'}, "
            f"more in {', '.join(harms) or 'none'}"
        )
    return (
        f"Square waves of sway leave {ratio:.2f} times the RMS of plain random motion: {verdict}."
    )


def _belts(
    ranking: Ranking, models: dict[str, BeltModel], trials: tuple[BeltTrial, ...], out: Path
) -> list[str]:
    fitted = pd.DataFrame(
        [
            (name, m.r_squared, m.rms_measured, m.rms_compensated, m.rms_reduction)
            for name, m in models.items()
        ],
        columns=["trial", "r_squared", "rms_raw", "rms_compensated", "rms_reduction_percent"],
    )
    write_csv(ranking.table, out / "belt_ranking.csv")
    write_csv(ranking.scores, out / "belt_scores.csv")
    write_csv(fitted, out / "belt_models.csv")
    tests, pairs = effects(ranking.scores)
    for trial in trials:
        figure = belt_figure(trial, models[ranking.winner], ranking.winner)
        save_figure(figure, out / "figures" / f"{trial.name}.png")
    cutoffs = ", ".join(f"{t.spline_cutoff_hz:.0f} Hz in {t.name}" for t in trials)
    said = [
        f"Smoothing splines through the belt's speed cut off at {cutoffs} "
        f"({RATE_HZ / 2:g} Hz: they smooth nothing); --belt-cutoff-hz sets what is used "
        f"({BELT_FILTER}, as D-Flow does while it runs).",
        markdown(ranking.scores, 3),
        "Each model on its own calibration trial:",
        markdown(fitted, 3),
    ]
    if tests.empty:
        return said
    write_csv(tests, out / "belt_effects.csv")
    write_csv(pairs, out / "belt_effect_pairs.csv")
    return [*said, markdown(tests, 3)]


def _interaction(found: Interaction, names: tuple[str, ...], out: Path) -> list[str]:
    write_csv(found.table, out / "interaction.csv")
    level = 0.05 / len(found.table)
    noticed, louder = (found.table[found.table[p] < level] for p in ("p", "p_louder"))
    said = (
        f"{', '.join(noticed['channel'])} follow the belt's acceleration beyond chance"
        if len(noticed)
        else f"none of {', '.join(names)} follows the belt's acceleration beyond chance"
    )
    if len(louder):
        loud = ", ".join(
            f"{row.channel} {row.louder:.1f} times" for row in louder.itertuples(index=False)
        )
        said += f"; while it accelerates, and half a second after, they shake more ({loud})"
    if np.isfinite(found.artefact).all():
        force, moment = found.artefact[:3].max(), found.artefact[3:].max()
        said += f"; compensation makes up to {force:.2f} N and {moment:.2f} N·m RMS of what follows"
    return [f"{said[0].upper()}{said[1:]}.", markdown(found.table, 4)]
