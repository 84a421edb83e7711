"""Experiment 2 as tables, figures and one page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from compensation import BeltModel, InertiaModel
from compensation.protocol import ADVISED_BELT_SIGNAL, ADVISED_PLATFORM_SIGNAL
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.calibration_ranking.ranking import (
    SMALLEST_DIFFERENCE,
    Model,
    Ranking,
    belt_interaction,
    best_trials,
    rank_belts,
    rank_platform,
    taken_away,
    thesis_choice,
)
from pipeline.calibration_ranking.trials import (
    BELT_FILTER,
    RATE_HZ,
    PlatformTrial,
    Trials,
)
from pipeline.calibration_ranking.verdict import (
    best_levels,
    calibration_effects,
    interaction_sentence,
    recommendation,
)
from pipeline.figures.style import COLOURS, STYLE, save_figure
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


def write_results(trials: Trials, seed: int, out: Path) -> list[str]:
    """Rank the calibration trials; write tables, figures and ``ranking.md``.

    Parameters
    ----------
    trials
        All recordings of the experiment.
    seed
        Of the bootstrap.
    out
        Folder to write to.

    Returns
    -------
    list[str]
        The recommendations, a paragraph each.

    Raises
    ------
    ValueError, OSError
        If a recording cannot be used, or a file cannot be written.
    """
    page, advice, model = ["# Which calibration trial?"], [], None
    if trials.calibration:
        ranking = rank_platform(trials.calibration, trials.validation, seed=seed)
        model = ranking.models[ranking.winner]
        advice.append(recommendation(ranking, "pitch and sway", ADVISED_PLATFORM_SIGNAL))
        page += ["## Pitch and sway", advice[-1]]
        page += _platform_section(ranking, trials.validation, out)
    if trials.belt_calibration:
        of_belts = rank_belts(trials.belt_calibration, trials.belt_validation, seed=seed)
        advice.append(recommendation(of_belts, "the belts", ADVISED_BELT_SIGNAL))
        page += ["## Belts", advice[-1], *_belt_section(of_belts, trials, out)]
        table, artefact = belt_interaction(trials.belt_validation[0], model, seed=seed)
        write_csv(table, out / "interaction.csv")
        page += ["## Do the belts vibrate the accelerometers?"]
        page += [interaction_sentence(table, artefact), markdown(table, 4)]
    write_text("\n\n".join(page) + "\n", out / "ranking.md")
    return advice


def _platform_section(
    ranking: Ranking[InertiaModel], validation: Sequence[PlatformTrial], out: Path
) -> list[str]:
    best, winners_scores = best_trials(ranking).reset_index(), table_2(ranking)
    write_csv(ranking.scores, out / "scores.csv")
    write_csv(best, out / "best_trials.csv")
    write_csv(winners_scores, out / "table_2.csv")
    for trial in validation:
        predicted = ranking.models[ranking.winner].predict(trial.accelerations)
        title = f"{trial.name}: empty plate, compensated by {ranking.winner}"
        figure = compensation_figure(title, trial.wrench, predicted, WRENCH_COMPONENTS)
        save_figure(figure, out / "figures" / f"{trial.name}.png")
    setup = validation[0].setup
    return [
        f"Plate and accelerometers were low-passed at {setup.cutoff_hz:g} Hz "
        f"({setup.filter_method}, as 'hbm calibration fit' does).",
        _choices(ranking, out / "ranking.csv"),
        f"What {ranking.winner} leaves (as Table II). Directions: x forward, y left, z up, about "
        "the centre of the plate; the thesis' names beside them (x right, y up, z back).",
        markdown(winners_scores, 1),
        "Best trial of every column (as Fig. F.7):",
        markdown(best),
        *_effects(ranking.scores, out, ""),
    ]


def _choices(ranking: Ranking[Model], path: Path) -> str:
    """Write the table of a ranking with what each rule chooses, and give it for the page."""
    rules = {ranking.winner: ["mean rank"]}
    rules.setdefault(thesis_choice(ranking.table), []).append("thesis' rule")
    first_by = [" and ".join(rules.get(name, [])) for name in ranking.table["trial"]]
    table = ranking.table.assign(first_by=first_by)
    write_csv(table, path)
    return markdown(table)


def _effects(scores: pd.DataFrame, out: Path, prefix: str) -> list[str]:
    """Write what speed, duration and kind of a calibration trial do, and give it for the page."""
    tests, pairs = calibration_effects(scores)
    if tests.empty:
        return [
            "Effects of kind, duration and speed are not tested: the trials' names do not state "
            "them, or the trials are too few."
        ]
    best = best_levels(pairs)
    write_csv(tests, out / f"{prefix}effects.csv")
    write_csv(pairs, out / f"{prefix}effect_pairs.csv")
    write_csv(best, out / f"{prefix}table_f1.csv")
    return [
        "Effects on the remaining RMS (type III, main effects; Bonferroni between levels in "
        f"{prefix}effect_pairs.csv):",
        markdown(tests, 3),
        "Best speed [m/s] and duration [s] of each component (as Table F.1, in lab directions); "
        f'"any" where the difference is below {SMALLEST_DIFFERENCE:g} N or N·m:',
        markdown(best),
    ]


def _belt_section(ranking: Ranking[BeltModel], found: Trials, out: Path) -> list[str]:
    trials = (*found.belt_validation, *found.belt_person)
    person = taken_away(ranking.models[ranking.winner], found.belt_validation, found.belt_person)
    write_csv(person, out / "belt_person.csv")
    write_csv(ranking.scores, out / "belt_scores.csv")
    for trial in trials:
        moment = (trial.moment - trial.moment.mean())[:, None]
        predicted = ranking.models[ranking.winner].predict(trial.acceleration)[:, None]
        title = f"{trial.name}: pitch moment, predicted by {ranking.winner}"
        figure = compensation_figure(title, moment, predicted, ["My"])
        save_figure(figure, out / "figures" / f"{trial.name}.png")
    cutoffs = ", ".join(f"{t.spline_cutoff_hz:.0f} Hz in {t.name}" for t in trials)
    return [
        f"Smoothing splines through the belt's speed have their cut-off at {cutoffs} "
        f"({RATE_HZ / 2:g} Hz: nothing is smoothed); --belt-cutoff-hz sets that of the low-pass "
        f"({BELT_FILTER}, as in D-Flow).",
        _choices(ranking, out / "belt_ranking.csv"),
        "What the first takes away of the pitch moment, with nobody on a belt and with a person on "
        "the other one (7 % in the thesis), who moves the platform; only accelerometers show that:",
        markdown(person),
        *_effects(ranking.scores, out, "belt_"),
    ]


LINES: Final = {
    "measured": COLOURS["measured"],
    "predicted": COLOURS["compensated"],
    "remaining": COLOURS["baseline"],
}
LINE_WIDTHS_PT: Final = (1.6, 0.7, 0.7)
"""So that the prediction does not hide the measurement."""
SHOWN_S: Final = 30.0
"""Of a trial, around its largest load: a period of pitch, six pulses of the belts."""


def compensation_figure(
    title: str, measured: Array, predicted: Array, components: Sequence[str]
) -> Figure:
    """Draw what an empty plate measures, what is predicted, and what remains (Figs 3 to 5).

    Parameters
    ----------
    title
        Of the figure.
    measured, predicted
        (N, C) [N, N·m], at 100 Hz.
    components
        Names of the C components.
    """
    size = np.linalg.norm(measured - measured.mean(axis=0), axis=1)
    count = min(round(SHOWN_S * RATE_HZ), len(size))
    start = int(np.clip(np.argmax(size) - count // 2, 0, len(size) - count))
    shown = slice(start, start + count)
    time = np.arange(len(size))[shown] / RATE_HZ
    series = (measured, predicted, measured - predicted)
    rows = 1 + (len(components) > 3)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 2.5 * rows), layout="constrained")
        panels = figure.subplots(rows, -(-len(components) // rows), squeeze=False).ravel()
        for k, (panel, component) in enumerate(zip(panels, components, strict=True)):
            for label, values, width in zip(LINES, series, LINE_WIDTHS_PT, strict=True):
                panel.plot(time, values[shown, k], color=LINES[label], lw=width, label=label)
            panel.set_title(component, loc="left")
            panel.set_ylabel("N" if component.startswith("F") else "N·m")
            panel.set_xlabel("time (s)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.suptitle(f"{title} (x forward, y left, z up)", fontsize=10)
    return figure
