"""Experiment 1 on one page and as files: verdict, faults, Table I, the calibration."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from compensation import PlateCalibrations
from compensation.plate_calibration import to_json
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.plate_study import FILE, BeltSide, WeightRecording
from pipeline.figures.style import COLOURS, STYLE, save_figure
from pipeline.io.write import markdown, write_csv, write_text
from pipeline.plate_accuracy.accuracy import (
    PlateAccuracy,
    condition_effects,
    mean_loads,
    quantities,
    reported_errors,
    trial_errors,
)
from pipeline.plate_accuracy.trials import THESIS_FILTER, WeightTrial
from pipeline.plate_accuracy.verdict import PlateVerdict, describe, judge
from pipeline.run.job import file_digest

CALIBRATION: Final = "plate_calibration.json"
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
TOTAL_NOTE: Final = (
    "Total errors: root mean square over the loads of one foot in walking (vertical force 0.75 to "
    "1.2, forward ± 0.25, lateral ± 0.05 body weights; centre of pressure up to 0.4 m along and "
    "0.1 m across from the middle of the plate) of a person of {mass:g} kg; moments about a centre "
    "of mass 1 m above the belt. They hold the plate's response to the true wrench, zero, a minute "
    "of drift, and scatter. The weights were {lightest:g} to {heaviest:g} kg: at loads above the "
    "largest recorded one ({largest:.0f} N), the straight and the squared part of the response are "
    "extrapolated, and their uncertainty with them; any other deviation there is not known. Errors "
    "of the stated masses, of the marker's place above a weight's centre and of center_height_m "
    "are not in the intervals."
)
TABLE_NOTE: Final = (
    "Root mean square errors. Axes of the thesis: x to the right, y up, z back. "
    "Orthogonal errors (TLLS) with supports, where nothing else is stated and there are such "
    "recordings."
)
EFFECTS_NOTE: Final = (
    "Orthogonal errors after a Box–Cox transform (exponent), analysis of variance of type III, "
    "main effects. The thirds of the belt (zone: antero-posterior position) are compared within "
    "recordings; all others between recordings. shapiro_p is the Shapiro–Wilk test of the "
    "residuals. Pairs of levels, Bonferroni-corrected, are in pairs.csv."
)


def write_report(found: PlateAccuracy, out: Path) -> tuple[PlateVerdict, ...]:
    """Write tables, figures, ``verdict.md``, and ``plate_calibration.json`` where one is needed.

    Parameters
    ----------
    found
        The results.
    out
        Folder to write to.

    Returns
    -------
    tuple[PlateVerdict, ...]
        Whether each plate is fit for inverse dynamics.
    """
    errors, verdicts = trial_errors(found.trials), judge(found)
    tests, pairs, remarks = condition_effects(errors)
    faults = pd.DataFrame(found.faults).drop(columns="degrees_of_freedom", errors="ignore")
    thesis = table_1(errors)
    write_csv(thesis, out / "table_1.csv")
    write_csv(errors, out / "errors.csv")
    write_csv(faults, out / "faults.csv")
    write_csv(judged_table(verdicts), out / "judged.csv")
    if len(tests):
        write_csv(tests, out / "anova.csv")
        write_csv(pairs, out / "pairs.csv")
    figures = {
        "error_by_place_and_speed": error_figure(errors, "zone", "speed_mps"),
        "error_by_position": error_figure(errors, "position_m", "belt"),
        "linearity": linearity_figure(found.trials),
        "vibration": vibration_figure(found.trials),
    }
    for name, figure in figures.items():
        save_figure(figure, out / "figures" / f"{name}.png")
    masses = [trial.weight.mass_kg for trial in found.trials]
    page = [f"# {found.study.file.name}", "Lab axes: x forward, y left, z up."]
    for verdict in verdicts:
        page += _section(verdict)
    page += [
        TOTAL_NOTE.format(
            mass=found.study.file.body_mass_kg,
            lightest=min(masses),
            heaviest=max(masses),
            largest=GRAVITY_MPS2 * max(masses),
        ),
        "## Faults that differ significantly from zero",
        _listed([describe(fault) for fault in found.faults if fault.significant]) or "None.",
        "## Table I",
        f"{TABLE_NOTE} Marker and plate were low-passed at {found.study.file.cutoff_hz:g} Hz, "
        "forward and backward, with half the amplitude left at that frequency as in the thesis "
        f"({THESIS_FILTER}).",
        _listed(_alignment_and_linearity(found)),
        markdown(thesis, 1),
        "## Effects of the conditions",
        EFFECTS_NOTE if len(tests) else "",
        markdown(tests, 3) if len(tests) else "",
        _listed(remarks),
    ]
    write_text("\n\n".join(part for part in page if part) + "\n", out / "verdict.md")
    _write_calibration(found, verdicts, out)
    return verdicts


def _section(verdict: PlateVerdict) -> list[str]:
    """Give every error of a plate beside its limit, what to correct and what is not known."""
    errors = [f"{one.status}: {one.sentence}" for one in (*verdict.judged, *verdict.corrected)]
    lines = [f"## {verdict.belt} plate", f"**{verdict.sentence}**", _listed(errors)]
    if verdict.corrections:
        lines.append(
            f"The calibration is in {CALIBRATION}; study.toml names it:\n\n"
            f'```toml\n[plates]\ncalibration = "{CALIBRATION}"\n```'
        )
    elif verdict.calibration is not None:
        lines.append(
            f"{CALIBRATION} holds a correction of this plate, which is not known to be enough."
        )
    elif verdict.corrected:
        lines.append(
            "No calibration of this plate is written: with it, a total error would be beyond "
            "its limit and larger than without it."
        )
    lines.append("Not examined:\n\n" + _listed((*verdict.to_record, *verdict.remarks)))
    return lines


def _alignment_and_linearity(found: PlateAccuracy) -> list[str]:
    lines = [
        f"{belt}: aligned on static places, {1000 * a.rms_before:.2f} mm RMS before, "
        f"{1000 * a.rms_after:.2f} mm after"
        for belt, a in found.alignments.items()
    ]
    lines += [
        f"{belt}: slope of measured over known load {x.slope:.5f} ± {x.slope_uncertainty:.5f}; "
        f"non-linearity {x.nonlinearity:.2f} N, {x.percent_of_full_scale:.2f} % of full scale; "
        f"R² {x.r_squared_first:.5f}, of second order {x.r_squared_second:.5f}"
        for belt, x in found.linearities.items()
    ]
    return lines


def _listed(items: Sequence[str]) -> str:
    return "\n".join(f"- {item}" for item in items)


def judged_table(verdicts: Sequence[PlateVerdict]) -> pd.DataFrame:
    """Give every error beside its limit, one row each, in SI units."""
    rows = [
        [verdict.belt, one.name, one.size, one.low, one.high, one.limit, one.unit, one.status]
        for verdict in verdicts
        for one in (*verdict.judged, *verdict.corrected)
    ]
    columns = ["belt", "error", "size", "low", "high", "limit", "unit", "status"]
    return pd.DataFrame(rows, columns=columns)


def _write_calibration(found: PlateAccuracy, verdicts: Sequence[PlateVerdict], out: Path) -> None:
    """Write ``plate_calibration.json`` with the plates that need one, if any does."""
    plates = tuple(one.calibration for one in verdicts if one.calibration is not None)
    if not plates:
        return
    provenance = {
        "study": found.study.file.name,
        "sha256": file_digest(found.study.folder / FILE),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "program": f"hbm-residuals {version('hbm-residuals')}",
    }
    write_text(to_json(PlateCalibrations(plates, provenance)), out / CALIBRATION)


def use_of_calibration(verdicts: Sequence[PlateVerdict], out: Path) -> str | None:
    """Say how to use the calibration that was written; None where no plate is to be corrected."""
    if not any(one.corrections for one in verdicts):
        return None
    return (
        f'to correct trials, in study.toml: [plates] calibration = "{out / CALIBRATION}"; '
        f"for one trial: hbm residuals TRIAL --plate-calibration {out / CALIBRATION}"
    )


def table_1(errors: pd.DataFrame) -> pd.DataFrame:
    """Lay out errors like the thesis' Table I.

    Parameters
    ----------
    errors
        As `trial_errors` gives them.

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
    reported = reported_errors(errors)
    chosen, zones = (reported[(reported["zone"] == "all") == entire] for entire in (True, False))
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


def _row(condition: str, part: pd.DataFrame, way: str) -> dict[str, str | float]:
    means = part.groupby("quantity")[way].mean()
    row: dict[str, str | float] = {"condition": condition}
    for column, (quantity, scale) in COLUMNS.items():
        row[column] = "-" if quantity is None else float(means[quantity]) * scale
    return row


CONDITIONS: Final = {
    "zone": "part of the belt",
    "speed_mps": "speed (m/s)",
    "position_m": "start, from the belt's outer edge (m)",
}
"""Column of the errors -> its name on an axis."""
SHOWN_S: Final = 10.0
"""Of a recording: thirty periods of a vibration of 3 Hz."""
BAR_GROUP_WIDTH: Final = 0.8
"""Of the distance between levels, shared by the bars of a level."""


def error_figure(errors: pd.DataFrame, along: str, group: str) -> Figure:
    """Draw the error of the centre of pressure along the belt per two conditions (Figs 2, F.1b).

    Parameters
    ----------
    errors
        As `pipeline.plate_accuracy.accuracy.trial_errors` gives them.
    along, group
        Columns: on the axis, and side by side.
    """
    part = reported_errors(errors)
    part = part[part["quantity"] == "COPx"]
    part = part[(part["zone"] == "all") == (along != "zone")]
    levels = list(dict.fromkeys(part[along])) if along == "zone" else sorted(part[along].unique())
    groups = sorted(part[group].unique())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 3.5), layout="constrained")
        panel = figure.subplots()
        width = BAR_GROUP_WIDTH / len(groups)
        for g, label in enumerate(groups):
            cells = part[part[group] == label].groupby(along)["orthogonal"]
            mean, sd = (1000 * x.reindex(levels) for x in (cells.mean(), cells.std()))
            at = np.arange(len(levels)) + (g - (len(groups) - 1) / 2) * width
            panel.bar(at, mean, 0.9 * width, label=str(label), color=f"C{g}")
            panel.errorbar(at, mean, sd, fmt="none", ecolor="black", lw=0.8)
        panel.set_xticks(range(len(levels)), [str(level) for level in levels])
        panel.set_xlabel(CONDITIONS.get(along, along))
        panel.set_ylabel("CoP along the belt, RMSE (mm)")
        figure.legend(title=CONDITIONS.get(group, group), loc="outside right upper")
    return figure


def linearity_figure(trials: Sequence[WeightTrial]) -> Figure:
    """Draw measured against known vertical force, a line through both, and the difference.

    Like Fig. F.1d.
    """
    sides: tuple[tuple[BeltSide, str, str], ...] = (
        ("left", "o", "measured"),
        ("right", "x", "compensated"),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for belt, marker, colour in sides:
            known, measured = mean_loads(trials, belt)
            if not len(known):
                continue
            look = {"ms": 4, "mfc": "none", "color": COLOURS[colour]}
            above.plot(known, measured, marker, label=belt, **look)
            below.plot(known, measured - known, marker, **look)
            if len(np.unique(known.round())) > 1:
                line = np.polynomial.Polynomial.fit(known, measured, 1)
                ends = np.array([known.min(), known.max()])
                above.plot(ends, line(ends), color=COLOURS[colour], lw=0.8)
                below.plot(ends, line(ends) - ends, color=COLOURS[colour], lw=0.8)
        above.set_ylabel("measured (N)")
        below.set_ylabel("measured − known (N)")
        below.set_xlabel("known vertical force (N)")
        above.legend(frameon=False)
    return figure


def vibration_figure(trials: Sequence[WeightTrial]) -> Figure:
    """Draw the centre of pressure in time, minus the marker (Fig. F.1c).

    Of two recordings of equal conditions but for the supports, if there are such, where they are
    compared with the weight.
    """
    groups: dict[WeightRecording, dict[bool, WeightTrial]] = {}
    for trial in trials:
        conditions = trial.weight.model_copy(update={"file": "", "supports": True})
        groups.setdefault(conditions, {})[trial.weight.supports] = trial
    weight, alike = max(groups.items(), key=lambda group: len(group[1]))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6, 3), layout="constrained")
        panel = figure.subplots()
        for supports, trial in alike.items():
            time = trial.time - trial.time[trial.used][0]
            shown = trial.used & (time <= SHOWN_S)
            off = 1000 * (quantities(trial.measured)[:, 0] - trial.marker[:, 0])
            panel.plot(
                time,
                np.where(shown, off, np.nan),
                color=COLOURS["compensated" if supports else "measured"],
                label="with supports" if supports else "without supports",
                lw=0.8,
                zorder=2 + supports,
            )
        panel.set_title(
            f"{weight.belt}, {weight.profile} at {weight.speed_mps:g} m/s, {weight.mass_kg:g} kg, "
            f"{weight.position_m:g} m from the edge",
            loc="left",
        )
        panel.set_xlabel("time (s)")
        panel.set_ylabel("CoP along the belt − marker (mm)")
        panel.legend(frameon=False)
    return figure
