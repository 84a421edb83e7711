"""One trial on the command line: process, print, write."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from pipeline.figures.residuals import residual_figure
from pipeline.figures.style import save_figure
from pipeline.io.write import write_csv
from pipeline.run.one_trial import Request, process
from pipeline.run.store import write_trial
from pipeline.trial.residuals import marker_rows, residual_rows, residual_table, threshold_rows
from pipeline.trial.result import TrialResult

WARNING: Final = "warning:"


def run(request: Request, out: Path) -> TrialResult:
    """Process one trial, print what came out, write table, frames and figure.

    Parameters
    ----------
    request
        What to do.
    out
        Folder for what it writes.

    Returns
    -------
    TrialResult
        The processed trial.

    Raises
    ------
    ValueError, OSError
        If the input cannot be used; one line that says why and what next.
    """
    console = Console(highlight=False, markup=False)
    _require_folder(out)
    result, _ = process(request, lambda sentence: console.print(sentence, style="dim"))
    print_result(result, console.print)
    stem = out / request.trial.stem
    write_trial(result, request.trial.stem, "", Path(f"{stem}.parquet"))
    write_csv(residual_table(result, request.trial.stem), Path(f"{stem}_residuals.csv"))
    save_figure(residual_figure(result), Path(f"{stem}_residuals"))
    console.print(
        f"written to {out}: {stem.name}.parquet (frames), {stem.name}_residuals.csv, .png and .svg",
        soft_wrap=True,
    )
    return result


def _require_folder(out: Path) -> None:
    """Refuse a folder that cannot be written to before minutes are spent on what goes into it."""
    nearest = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise ValueError(f"--out {out}: {nearest} is a file, not a folder")
    if not os.access(nearest, os.W_OK):
        raise ValueError(f"--out {out}: no permission to write into {nearest}")


def print_result(result: TrialResult, show: Callable[..., None]) -> None:
    """Print a trial's residuals, thresholds, marker errors and notes.

    Parameters
    ----------
    result
        The trial.
    show
        A rich console's ``print``.
    """
    rows = residual_rows(result, result.source.stem)
    count = rows[0].n_cycles
    cycles = f"{count} gait cycle{'' if count == 1 else 's'}"
    view = Table(
        title=f"Pelvis residuals, {result.source.name}, {cycles} "
        f"({result.settings.filter} {result.settings.cutoff_hz:g} Hz)",
        caption="x forward, y right, z up; moments about mid-hip; % of body weight, or of body "
        "weight × stature",
    )
    for name in ("plates", "axis", "RMS", "mean", "SD", "peak", "", "RMS %"):
        view.add_column(name, justify="left" if name in ("plates", "axis", "") else "right")
    for row in rows:
        numbers = [f"{value:.1f}" for value in (row.rms, row.mean, row.sd, row.peak)]
        percent = f"{row.rms_percent:.2f}"
        view.add_row(_plates(row.compensated), row.axis, *numbers, row.unit, percent)
    show(view)
    for limit in threshold_rows(result):
        verdict = "passes" if limit.passed else "FAILS"
        show(
            f"{verdict} Hicks (2015): peak residual {limit.quantity} {limit.peak:.1f} "
            f"{limit.unit}, limit {limit.limit:.1f} {limit.unit} ({_plates(limit.compensated)})"
        )
    *single, every = marker_rows(result)
    single.sort(key=lambda marker: -np.nan_to_num(marker.rms_mm))
    listed = ", ".join(f"{marker.marker} {marker.rms_mm:.1f}" for marker in single)
    show(f"marker error {every.rms_mm:.1f} mm RMS over {len(single)} markers: {listed}")
    for note in sorted(result.notes, key=lambda note: not note.startswith(WARNING)):
        show(f"- {note}", soft_wrap=True, style="bold" if note.startswith(WARNING) else None)


def _plates(compensated: bool) -> str:
    return "compensated" if compensated else "measured"
