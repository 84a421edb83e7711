"""Experiment 1 as Table I and a verdict on one page."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from pipeline.figures import save_figure
from pipeline.plates import Experiment1
from pipeline.plates_faults import Estimate
from pipeline.plates_figures import (
    error_figure,
    hammer_figure,
    linearity_figure,
    static_figure,
    vibration_figure,
)
from pipeline.ranking_report import markdown, write_text
from pipeline.trial_files import write_csv

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
SHOWN_AS: Final = {"m": (1000.0, "mm"), "s": (1000.0, "ms"), "1": (100.0, "%")}


def table_1(errors: pd.DataFrame) -> pd.DataFrame:
    """Lay errors out as the thesis' Table I.

    Parameters
    ----------
    errors
        As in `pipeline.plates.Experiment1`.

    Returns
    -------
    pandas.DataFrame
        First column "condition"; the others as `COLUMNS`. Means over recordings. From the third
        block on, orthogonal errors with supports (without, where there are none with).
    """
    whole = errors[errors["zone"] == "all"]
    rows = []
    for label, way in (("Normal error", "difference"), ("TLLS", "orthogonal")):
        for supports, said in ((True, "support"), (False, "no support")):
            part = whole[whole["supports"] == supports]
            if len(part):
                rows.append(_row(f"{label} - {said}", part, way))
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


def verdict(found: Experiment1) -> tuple[bool, list[str], list[str]]:
    """Judge whether the plates are fit for inverse dynamics.

    Returns
    -------
    fit
        True if nothing that cannot be corrected exceeds its limit.
    against
        What exceeds its limit, as sentences.
    correct
        What must or may be corrected, and how.
    """
    limits, against, correct = found.study.file.limits, [], []
    supported = any(t.weight.supports for t in found.trials)
    in_use = f"vibration {'with' if supported else 'without'} supports"
    for one in found.estimates:
        if not one.found:
            continue
        size, name = abs(one.value), one.fault
        if (name == "angle" and size > limits.angle_deg) or (
            name.startswith("offset") and size > limits.offset_m
        ):
            correct.append(f"{said(one)}: align the {one.belt} plate with the cameras")
        elif name == "delay" and size > limits.delay_s:
            correct.append(f"{said(one)}: state plate_delay_s = {one.value:.4f} in study.toml")
        elif name == in_use and size > limits.cop_m:
            against.append(f"{said(one)}, more than {1000 * limits.cop_m:g} mm")
        elif name.startswith("vibration") and size > limits.cop_m:
            correct.append(f"{said(one)}: measure with the supports")
    for belt, straight in found.linearities.items():
        if straight.percent_of_full_scale > limits.nonlinearity_percent:
            against.append(
                f"{belt}: non-linearity {straight.nonlinearity:.1f} N, "
                f"{straight.percent_of_full_scale:.1f} % of full scale, more than "
                f"{limits.nonlinearity_percent:g} %"
            )
    whole = found.errors[found.errors["zone"] == "all"]
    whole = whole[whole["supports"] == whole["supports"].any()]
    means = whole.groupby(["belt", "quantity"])["orthogonal"].mean()
    noise = marker_share(found)
    for belt, quantity, value in means.reset_index().itertuples(index=False):
        limit = limits.cop_m if quantity.startswith("COP") else limits.force_n
        own = float(np.sqrt(max(value**2 - noise.get((belt, quantity), 0.0) ** 2, 0.0)))
        if quantity[0] != "M" and own > limit:
            shown = f"{1000 * own:.1f} mm" if quantity[0] == "C" else f"{own:.1f} N"
            most = f"{1000 * limit:g} mm" if quantity[0] == "C" else f"{limit:g} N"
            against.append(f"{belt}: {quantity} is off by {shown} RMS, more than {most}")
    return not against, against, correct


def marker_share(found: Experiment1) -> dict[tuple[str, str], float]:
    """Give the part of each orthogonal error that the marker's own noise makes, per belt.

    The weight does not leave the belt, so what its marker's vertical acceleration shows is noise;
    along the belt it is taken to be as large.
    """
    share: dict[tuple[str, str], float] = {}
    for belt in {t.weight.belt for t in found.trials}:
        trials = [t for t in found.trials if t.weight.belt == belt]
        force = float(np.mean([np.std(t.truth[t.used, 2]) for t in trials]))
        lever = found.study.file.center_height_m
        load = float(np.mean([np.mean(t.truth[t.used, 2]) for t in trials]))
        share[belt, "Fx"] = share[belt, "Fz"] = share[belt, "Fy"] = force
        share[belt, "COPx"] = share[belt, "COPy"] = lever * force / load
    return share


def said(one: Estimate) -> str:
    """Say an estimate with its 95 % uncertainty."""
    scale, unit = SHOWN_AS.get(one.unit, (1.0, one.unit))
    error = scale * one.uncertainty
    digits = max(1 - math.floor(math.log10(error)), 0) if error > 0 else 3
    text = f"{one.belt}: {one.fault} {scale * one.value:.{digits}f} ± {error:.{digits}f} {unit}"
    if np.isfinite(one.hz[0]):
        text += f" at {one.hz[0]:.2f} Hz in the centre of pressure along the belt"
    return text


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
    sentence = _sentence(fit, against, correct)
    write_text(_page(found, sentence, against, correct), out / "verdict.md")
    return sentence


def _sentence(fit: bool, against: Sequence[str], correct: Sequence[str]) -> str:
    if not fit:
        return f"Not fit for inverse dynamics: {'; '.join(against)}."
    if correct:
        return f"Fit for inverse dynamics once corrected: {'; '.join(correct)}."
    return "Fit for inverse dynamics."


def _page(found: Experiment1, sentence: str, against: Sequence[str], correct: Sequence[str]) -> str:
    faults = [e for e in found.estimates if e.found]
    lines = [f"# {found.study.file.name}", f"**{sentence}**"]
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
