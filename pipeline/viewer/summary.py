"""The summary of a trial that the viewer shows as text, in Markdown."""

from typing import Final

import numpy as np

from hbm.notes import warnings_first
from pipeline.trial.residuals import (
    AXES,
    DIRECTIONS,
    counted,
    marker_table,
    residual_table,
    threshold_table,
)
from pipeline.trial.result import TrialResult

LISTED_MARKERS: Final = 8
"""Those that a reader may want to check; the report lists more."""


def trial_summary(result: TrialResult) -> str:
    """Summarise a trial for a person.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    str
        Markdown: residuals, thresholds, marker errors, notes.
    """
    parts = [f"# {result.subject.id} · {result.source.stem}", _circumstances(result)]
    if counted(result).any():
        parts += [_residuals(result), _thresholds(result)]
    else:
        parts.append("No frame counts, so there is no table of residuals; the notes say why.")
    parts += [_markers(result), _notes(result)]
    return "\n\n".join(parts)


def _circumstances(result: TrialResult) -> str:
    settings, body = result.settings, result.body
    cycles = ", ".join(f"{len(spans)} {side}" for side, spans in result.cycles.items())
    counts = f"gait cycles: {cycles} of {result.found_cycles}"
    if result.part:
        counts += f", of these {result.part.name}"
    if result.span:
        counts = f"{result.span[0]:.2f} to {result.span[1]:.2f} s of the recording"
    return (
        f"{body.mass:.1f} kg, {body.height_m:.2f} m; marker set {body.marker_set.name}; "
        f"{settings.filter.replace('_', ' ')} filter, {settings.cutoff_hz:g} Hz; "
        f"{counts}"
    )


def _residuals(result: TrialResult) -> str:
    names = list(result.variants)
    table = residual_table(result, result.source.stem)
    rows = list(table[table["headline"].astype(bool)].itertuples())
    lines = [
        "## Pelvis residuals (RMS)",
        "|  | direction | " + " | ".join(f"{name} | %" for name in names) + " |",
        "|---|---|" + "---:|---:|" * len(names),
    ]
    for axis, direction in zip(AXES, DIRECTIONS, strict=True):
        cells = [
            f"{row.rms:.1f} {row.unit} | {row.rms_percent:.2f}" for row in rows if row.axis == axis
        ]
        lines.append(f"| {axis} | {direction} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", "% of body weight, or of body weight × stature."])


def _thresholds(result: TrialResult) -> str:
    lines = [
        "## Peaks against Hicks et al. 2015",
        "| plates | residual | peak | limit |  |",
        "|---|---|---:|---:|---|",
    ]
    for row in threshold_table(result).itertuples():
        plates = "compensated" if row.compensated else "measured"
        verdict = "passes" if row.passed else "**fails**"
        lines.append(
            f"| {plates} | {row.quantity} | {row.peak:.1f} {row.unit} "
            f"| {row.limit:.1f} {row.unit} | {verdict} |"
        )
    return "\n".join(lines)


def _markers(result: TrialResult) -> str:
    table = marker_table(result)
    *single, every = table.itertuples()
    seen = list(table[:-1].dropna().sort_values("rms_mm", ascending=False).itertuples())
    unseen = ", ".join(row.marker for row in single if np.isnan(row.rms_mm))
    lines = [
        "## Distance of markers from the model",
        f"The {min(LISTED_MARKERS, len(seen))} largest of {len(seen)}, and all markers."
        + (f" Never seen: {unseen}." if unseen else ""),
        "",
        "| marker | RMS (mm) | peak (mm) | missing (%) |",
        "|---|---:|---:|---:|",
    ]
    for row in [*seen[:LISTED_MARKERS], every] if seen else []:
        lines.append(
            f"| {row.marker} | {row.rms_mm:.1f} | {row.peak_mm:.1f} | {row.missing_percent:.1f} |"
        )
    return "\n".join(lines)


def _notes(result: TrialResult) -> str:
    lines = [
        f"- {'**warning:** ' * (note.level == 'warning')}{note} `{note.code}`"
        for note in warnings_first(result.notes)
    ]
    return "\n".join(["## Notes", *lines])
