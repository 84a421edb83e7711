"""What is said of one trial, on its page and in the terminal: verdict, residuals, quality."""

from collections.abc import Iterable

import numpy as np

from hbm.notes import warnings_of
from hbm.spelling import join_names, mean_sd, written
from pipeline.report.blocks import Table
from pipeline.report.trials import NOT_KNOWN, trial_quality
from pipeline.trial.gait.carried import places_of
from pipeline.trial.gait.cycles import mean_and_sd
from pipeline.trial.gait.spatiotemporal import QUANTITIES, spatiotemporal
from pipeline.trial.joints import joint_spans
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import reference_of, residual_rows, threshold_rows, worst_cycles
from pipeline.trial.result import TrialResult


def verdict_lines(result: TrialResult) -> Iterable[str]:
    """Compare the residuals closest to the truth with others, in one sentence; count the warnings.

    The reference of RMS over gait cycles is healthy walking, or what is expected where markers do
    not show all segments; that of peaks the limits of Hicks et al. (2015).
    """
    if result.shortage:
        yield f"No residuals: {result.shortage}."
    compensated = result.compensated is not None
    shown = [r for r in residual_rows(result) if r.headline and r.compensated == compensated]
    if shown:
        title, reference, _ = reference_of(shown)
        above = [row.axis for row in shown if row.rms > reference[row.axis]]
        beyond = [
            row
            for row in threshold_rows(result)
            if row.compensated == compensated and not row.passed
        ]
        peaks = "peaks within Hicks et al. (2015) limits"
        if beyond:
            quantities = join_names([f"peak {row.quantity}" for row in beyond])
            shares = join_names([f"{row.above_percent:.1f}" for row in beyond])
            peaks = f"{quantities} above Hicks et al. (2015) limits in {shares} % of frames"
        lead = f"RMS of all six axes below {title.lower()} values"
        if result.span is not None:
            lead = "No gait cycles to compare with healthy walking"
        elif above:
            lead = f"{join_names(above) if len(above) < len(shown) else 'All six axes'} above"
            lead += f" {title.lower()} values"
        elif not beyond:
            lead = f"Typical of level walking: {lead}"
        yield f"{lead}; {peaks}."
    warnings = len(warnings_of(result.notes))
    yield f"{warnings or 'No'} warning{'s' * (warnings != 1)}."


def worst_table(result: TrialResult, command: str) -> Iterable[Table]:
    """Show the gait cycles with the largest residuals, and what opens the viewer there."""
    worst = worst_cycles(result)[:5]
    reference = reference_of(residual_rows(result))[0].lower()
    rows = [
        (
            f"{cycle.side}, {cycle.start_s:.2f}–{cycle.stop_s:.2f} s",
            f"{cycle.axis}, {cycle.ratio:.1f} × {reference}",
            f"{cycle.rms:.1f} {cycle.unit}",
            f"{command} --at {cycle.start_s:.2f}",
        )
        for cycle in worst
    ]
    if worst:
        heads = "Gait cycle", "Stands out", "RMS", "In the viewer"
        trial = result.name.stem if result.key else ""
        links = {
            row[0]: f"/?trial={trial}&at={cycle.start_s:.2f}"
            for row, cycle in zip(rows, worst, strict=True)
        }
        yield Table("Worst gait cycles", heads, rows, links=links)


def gait_table(result: TrialResult) -> Iterable[Table]:
    """Show speed, cadence, steps and stance of the gait cycles that count, side by side."""
    feet = places_of(result.body, result.motion.q)[:, 1:]
    if result.platform is not None:
        feet = (feet - result.platform.position[:, None]) @ result.platform.rotation
    posed = free_of(result.quality, Quality.POSE_UNKNOWN | Quality.LIMB_UNSEEN)
    feet = np.where(posed[:, None, None], feet, np.nan)
    measured = spatiotemporal(result.motion.time, feet, result.events, joint_spans(result))
    means = {side: mean_and_sd(values) for side, values in measured.items()}
    rows = []
    for k, (quantity, unit) in enumerate(QUANTITIES.items()):
        digits = 2 if unit.startswith("m") else 0
        cells = [mean_sd(mean[k], sd[k], f".{digits}f") for mean, sd in means.values()]
        if not any(np.isnan(mean[k]) for mean, _ in means.values()):
            rows.append((f"{quantity.capitalize()} ({unit})", *cells))
    if means and rows:
        counts = [f"{side.capitalize()}, n = {len(measured[side])}" for side in means]
        legend = "Against the ground, which the feet that stand on it show; steps by the ankles."
        yield Table("Gait, mean ± SD over cycles", ("Quantity", *counts), rows, "", legend)


def result_tables(result: TrialResult) -> Iterable[Table]:
    """Give the residuals, with what they are compared with, and the quality of the trial."""
    headline = [row for row in residual_rows(result) if row.headline]
    title, reference, meaning = reference_of(headline)
    walked = result.span is None  # the reference is of gait cycles
    heads = ("Residual", "Plates", "RMS", "Mean", "SD", "Peak", "RMS, %", *[title] * walked)
    rows = [
        (
            f"{row.axis} ({row.unit})",
            "compensated" if row.compensated else "measured",
            *(written(value, "z.1f") for value in (row.rms, row.mean, row.sd, row.peak)),
            f"{row.rms_percent:.2f}",
            *[f"{reference[row.axis]:.1f}"] * walked,
        )
        for row in headline
    ]
    legend = (
        "x forward, y right, z up; moments about mid-hip; % of body weight, or of body weight × "
        f"stature. {meaning * walked}"
    )
    if rows:
        yield Table("Pelvis residuals", heads, rows, "numbers", legend)
    rated = trial_quality(result)
    quality = [(item, checks) for item, checks in rated.items() if checks != (NOT_KNOWN,)]
    yield Table("Quality", ("Criterion", "Finding"), quality, "trials")
