"""Experiment 2 as tables, figures and a part of the laboratory's page."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from compensation.protocol import ADVISED_BELT_SIGNAL, ADVISED_PLATFORM_SIGNAL
from pipeline.calibration_ranking.ranking import (
    LIMITS,
    Model,
    Ranking,
    belt_interaction,
    best_trials,
    rank_belts,
    rank_platform,
    taken_away,
    thesis_choice,
)
from pipeline.calibration_ranking.trials import BELT_FILTER, RATE_HZ, Trials
from pipeline.calibration_ranking.verdict import (
    best_levels,
    calibration_effects,
    interaction_table,
    recommendation,
)
from pipeline.figures.style import drawing, save_figure
from pipeline.io.write import write_csv
from pipeline.report.blocks import Drawn, Table
from pipeline.report.empty_treadmill import time_figure
from pipeline.report.laboratory import Part, frame_table


def table_2(ranking: Ranking[Model]) -> pd.DataFrame:
    """Lay out the winner's scores like the thesis' Table II.

    Returns
    -------
    pandas.DataFrame
        validation, variable (lab directions: x forward, y left, z up), in_thesis (the same in the
        thesis' frame), unit, rms_raw, rms_compensated, rms_reduction_percent.
    """
    # from x forward, y left, z up to x right, y up, z back
    in_thesis = {"Fx": "Fz", "Fy": "Fx", "Fz": "Fy", "Mx": "Mz", "My": "Mx", "Mz": "My"}
    rows = ranking.scores[ranking.scores["trial"] == ranking.winner]
    return pd.DataFrame(
        {
            "validation": rows["validation"],
            "variable": rows["component"],
            "in_thesis": rows["component"].map(in_thesis),
            "unit": np.where(rows["component"].str.startswith("F"), "N", "N·m"),
            "rms_raw": rows["rms_raw"],
            "rms_compensated": rows["rms_after"],
            "rms_reduction_percent": rows["reduction"],
        }
    )


def write_results(trials: Trials, seed: int, out: Path) -> Part:
    """Rank the calibration trials; write tables and figures.

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
    Part
        For the laboratory's page: which trial to use, and how certain that is.

    Raises
    ------
    ValueError, OSError
        If a recording cannot be used, or a file cannot be written.
    """
    verdicts, tables, figures, model = [], list[Table](), list[Drawn](), None
    if trials.calibration:
        ranking = rank_platform(trials.calibration, trials.validation, seed=seed)
        model = ranking.models[ranking.winner]
        verdicts.append(recommendation(ranking, "pitch and sway", ADVISED_PLATFORM_SIGNAL))
        tables += _ranking_tables(ranking, "Pitch and sway", out, "")
        setup = trials.validation[0].setup
        note = (
            f"Low-pass {setup.cutoff_hz:g} Hz ({setup.filter_method}). Directions: x forward, y "
            "left, z up; in thesis: x right, y up, z back."
        )
        second, best = table_2(ranking), best_trials(ranking).reset_index()
        write_csv(second, out / "table_2.csv")
        write_csv(best, out / "best_trials.csv")
        tables += [
            frame_table(f"Empty plate compensated by {ranking.winner} (Table II)", second, 1, note),
            frame_table("Best trial of every column (Fig. F.7)", best, 1),
        ]
        for trial in trials.validation:
            predicted = model.predict(trial.accelerations)
            drawn = time_figure(trial.wrench, predicted, RATE_HZ)
            text = f"{trial.name}: empty plate before and after {ranking.winner}."
            figures.append(_saved(text, drawn, out, trial.name))
    if trials.belt_calibration:
        of_belts = rank_belts(trials.belt_calibration, trials.belt_validation, seed=seed)
        verdicts.append(recommendation(of_belts, "belts", ADVISED_BELT_SIGNAL))
        tables += _ranking_tables(of_belts, "Belts", out, "belt_")
        validation, model_of_belts = trials.belt_validation, of_belts.models[of_belts.winner]
        # the plate is empty: the person is on the other belt
        person = taken_away(model_of_belts, validation, trials.belt_person)
        write_csv(person, out / "belt_person.csv")
        table, artefact = belt_interaction(validation[0], model, seed=seed)
        write_csv(table, out / "interaction.csv")
        tables += [
            frame_table("Pitch moment with nobody and with a person on the other belt", person, 2),
            frame_table("Do the belts vibrate the accelerometers?", table, 4),
        ]
        verdicts.append(interaction_table(table, artefact))
        for one in (*validation, *trials.belt_person):
            moment = (one.moment - one.moment.mean())[:, None]
            predicted = model_of_belts.predict(one.acceleration)[:, None]
            drawn = time_figure(moment, predicted, RATE_HZ, ["My"])
            text = (
                f"{one.name}: pitch moment before and after {of_belts.winner} ({BELT_FILTER}; "
                f"spline through the speed: {one.spline_cutoff_hz:.0f} Hz)."
            )
            figures.append(_saved(text, drawn, out, one.name))
    return Part("ranking", verdicts, tables, figures)


def _saved(text: str, figure: Figure, out: Path, name: str) -> Drawn:
    save_figure(figure, out / "figures" / name)
    return Drawn(text, drawing(figure, "png"))


def _ranking_tables(ranking: Ranking[Model], title: str, out: Path, prefix: str) -> list[Table]:
    """Write a ranking with what each rule chooses, its scores, and what makes a difference."""
    rules = {ranking.winner: ["mean rank"]}
    rules.setdefault(thesis_choice(ranking.table), []).append("thesis' rule")
    first_by = [" and ".join(rules.get(name, [])) for name in ranking.table["trial"]]
    table = ranking.table.assign(first_by=first_by)
    write_csv(table, out / f"{prefix}ranking.csv")
    write_csv(ranking.scores, out / f"{prefix}scores.csv")
    ranks = frame_table(f"{title}: ranking", table, 2)
    tests, pairs = calibration_effects(ranking.scores)
    if tests.empty:
        return [ranks]
    best = best_levels(pairs)
    write_csv(tests, out / f"{prefix}effects.csv")
    write_csv(pairs, out / f"{prefix}effect_pairs.csv")
    write_csv(best, out / f"{prefix}table_f1.csv")
    note = f'"any": difference below {LIMITS.least_difference:g} N or N·m.'
    return [
        ranks,
        frame_table(f"{title}: effects on the remaining RMS (type III)", tests, 3),
        frame_table(f"{title}: best speed (m/s) and duration (s), Table F.1", best, 1, note),
    ]
