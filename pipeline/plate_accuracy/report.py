"""Experiment 1 as Table I and a verdict on one page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from pipeline.figures.style import save_figure
from pipeline.io.write import markdown, write_csv, write_text
from pipeline.plate_accuracy.accuracy import Experiment1
from pipeline.plate_accuracy.figures import (
    error_figure,
    hammer_figure,
    linearity_figure,
    static_figure,
    vibration_figure,
)
from pipeline.plate_accuracy.trials import THESIS_FILTER
from pipeline.plate_accuracy.verdict import marker_share, said, sentence, unexamined, verdict

COLUMNS: Final = {
    "COPx (mm)": ("COPy", 1000.0),
    "COPy (mm)": (None, 1.0),
    "COPz (mm)": ("COPx", 1000.0),
    "Fx (N)": ("Fy", 1.0),
    "Fy (N)": ("Fz", 1.0),
    "Fz (N)": ("Fx", 1.0),
    "Mx (Nm)": ("My", 1.0),
    "My (Nm)": ("Mz", 1.0),
    "Mz (Nm)": ("Mx", 1.0),
}
"""The thesis' columns (x right, y up, z back) -> quantity in lab axes (x forward, y left, z up)."""
TABLE_NOTE: Final = (
    "Root mean square errors. Axes of the thesis: x to the right, y up, z back. "
    "Without another word: orthogonal (TLLS), with supports where there are recordings."
)
LAB_NOTE: Final = "Lab axes: x forward, y left, z up."


def table_1(errors: pd.DataFrame) -> pd.DataFrame:
    """Lay errors out as the thesis' Table I.

    Parameters
    ----------
    errors
        As in `pipeline.plate_accuracy.accuracy.Experiment1`.

    Returns
    -------
    pandas.DataFrame
        First column "condition"; the others as `COLUMNS`. Means over recordings. From the third
        block on, orthogonal errors with supports (without, where there are none with).
    """
    whole = errors[errors["zone"] == "all"]
    rows = []
    for label, way in (("Normal error", "difference"), ("TLLS", "orthogonal")):
        for supports, words in ((True, "support"), (False, "no support")):
            part = whole[whole["supports"] == supports]
            if len(part):
                rows.append(_row(f"{label} - {words}", part, way))
    best = whole["supports"].any()
    chosen = whole[whole["supports"] == best]
    zones = errors[(errors["zone"] != "all") & (errors["supports"] == best)]
    for part, factor, form in (
        (chosen, "speed_mps", "speed = {:g} m/s"),
        (chosen, "position_m", "startpos = {:g} m"),
        (zones, "zone", "AP = {}"),
        (chosen, "mass_kg", "weight = {:.2f} kg"),
        (chosen, "profile", "profile = {}"),
        (chosen, "belt", "belt = {}"),
    ):
        rows += [
            _row(form.format(level), group, "orthogonal")
            for level, group in part.groupby(factor, sort=factor != "zone")
        ]
    return pd.DataFrame(rows)


def write_report(found: Experiment1, out: Path) -> str:
    """Write tables, figures and ``verdict.md``.

    Parameters
    ----------
    found
        The results.
    out
        Folder to write to.

    Returns
    -------
    str
        The verdict in one sentence.
    """
    table = table_1(found.errors)
    write_csv(table, out / "table_1.csv")
    write_csv(found.errors, out / "errors.csv")
    listed = pd.DataFrame(
        [
            {
                "belt": e.belt,
                "fault": e.fault,
                "value": e.value,
                "standard_error": e.error,
                "unit": e.unit,
                "found": e.found,
                "hz": e.hz[0],
            }
            for e in found.estimates
        ]
    )
    write_csv(listed, out / "faults.csv")
    write_text(f"{TABLE_NOTE}\n\n{markdown(table, 1)}\n", out / "table_1.md")
    if len(found.tests):
        write_csv(found.tests, out / "anova.csv")
        write_csv(found.pairs, out / "pairs.csv")
    figures = {
        "error_by_place_and_speed": error_figure(found.errors, "zone", "speed_mps"),
        "error_by_position": error_figure(found.errors, "position_m", "belt"),
        "linearity": linearity_figure(found.trials),
        "vibration": vibration_figure(found.trials),
        "static": static_figure(found.places, found.alignments),
        "delay": hammer_figure(found.delays),
    }
    for name, figure in figures.items():
        if figure is not None:
            save_figure(figure, out / "figures" / f"{name}.png")
    fit, against, correct = verdict(found)
    said_so = sentence(fit, against, correct, unexamined(found))
    write_text(_page(found, said_so, against, correct), out / "verdict.md")
    return said_so


def _page(found: Experiment1, said_so: str, against: Sequence[str], correct: Sequence[str]) -> str:
    faults = [e for e in found.estimates if e.found]
    lines = [f"# {found.study.file.name}", f"**{said_so}**"]
    for title, items in (("Against", against), ("To correct", correct)):
        if items:
            lines.append(f"## {title}\n\n" + "\n".join(f"- {item}" for item in items))
    lines.append(
        f"## Faults different from zero beyond chance\n\n{LAB_NOTE}\n\n"
        + ("\n".join(f"- {said(e)}" for e in faults) or "None.")
    )
    facts = [
        f"- {belt}: aligned on static places, {1000 * a.rms_before:.2f} mm RMS before, "
        f"{1000 * a.rms_after:.2f} mm after"
        for belt, a in found.alignments.items()
    ]
    facts += [
        f"- {belt}: non-linearity {x.nonlinearity:.2f} N, {x.percent_of_full_scale:.2f} % of full "
        f"scale; R² {x.r_squared_first:.5f}, of second order {x.r_squared_second:.5f}"
        for belt, x in found.linearities.items()
    ]
    facts += [
        f"- {said(e)}, plates later than cameras ({len(found.delays[e.belt].differences)} blows)"
        for e in found.estimates
        if e.fault == "delay"
    ]
    share = marker_share(found)
    facts += [
        f"- {belt}: the marker's noise makes about {share[belt, 'Fz']:.1f} N of each force error"
        for belt in sorted({t.weight.belt for t in found.trials})
    ]
    for belt in sorted({t.weight.belt for t in found.trials}):
        noise = np.mean([t.noise for t in found.trials if t.weight.belt == belt], axis=0)
        facts.append(
            f"- {belt}: noise above {found.study.file.cutoff_hz:g} Hz "
            f"{noise[0]:.2f}, {noise[1]:.2f}, {noise[2]:.2f} N and "
            f"{noise[3]:.2f}, {noise[4]:.2f}, {noise[5]:.2f} N·m"
        )
    lines += [
        "## Measured\n\n" + "\n".join(facts),
        f"Marker and plate were low-passed at {found.study.file.cutoff_hz:g} Hz, forward and "
        "backward, with half the amplitude left at that frequency as in the thesis "
        f"({THESIS_FILTER}).",
        "## Table I",
        TABLE_NOTE,
        markdown(table_1(found.errors), 1),
    ]
    if len(found.tests):
        lines += [
            "## Do speed, position and weight matter?",
            f"{LAB_NOTE} Orthogonal errors after a Box–Cox transformation (exponent), analysis of "
            "variance of type III, main effects; pairs of levels are in pairs.csv.",
            markdown(found.tests, 3),
        ]
    return "\n\n".join(lines) + "\n"


def _row(condition: str, part: pd.DataFrame, way: str) -> dict[str, object]:
    means = part.groupby("quantity")[way].mean()
    row: dict[str, object] = {"condition": condition}
    for column, (quantity, scale) in COLUMNS.items():
        row[column] = "-" if quantity is None else float(means[quantity]) * scale
    return row
