"""What is said of one trial, on its page and in the terminal: verdict, residuals, quality."""

from collections.abc import Iterable

from hbm.notes import warnings_of
from hbm.spelling import join_names, written
from pipeline.report.blocks import Table
from pipeline.report.trials import NOT_KNOWN, trial_quality
from pipeline.trial.residuals import (
    AXES,
    HEALTHY_RMS,
    reference_of,
    residual_rows,
    threshold_rows,
    unseen_sentence,
)
from pipeline.trial.result import TrialResult


def verdict_lines(result: TrialResult) -> Iterable[str]:
    """Compare the residuals closest to the truth with others; count the warnings.

    The first sentence says what is expected where markers do not show all segments. Else one holds
    both comparisons: with healthy walking, whose markers showed all, and with published limits.
    """
    if result.shortage:
        yield f"No residuals: {result.shortage}."
    rows, compensated = residual_rows(result), result.compensated is not None
    if unseen := unseen_sentence(result, rows):
        yield unseen
    best = [row for row in threshold_rows(result) if row.compensated == compensated]
    if best:
        shown = [row for row in rows if row.headline and row.compensated == compensated]
        healthy = dict(zip(AXES, HEALTHY_RMS, strict=True))
        above = [row.axis for row in shown if row.rms > healthy[row.axis]]
        beyond = [row.quantity for row in best if not row.passed]
        rms = "are below healthy walking in all six axes"
        if unseen:
            rms = "have no healthy reference with these markers"
        elif above:
            rms = f"exceed healthy walking in {join_names(above)}"
        peaks = f"peaks of {join_names(beyond)} exceed" if beyond else "peaks are within"
        limits = "published limits (Hicks et al. 2015)"
        yield f"RMS residuals{' with compensation' * compensated} {rms}; {peaks} {limits}."
    warnings = len(warnings_of(result.notes))
    yield f"{warnings or 'No'} warning{'s' * (warnings != 1)}."


def result_tables(result: TrialResult) -> Iterable[Table]:
    """Give the residuals, with what they are compared with, and the quality of the trial."""
    headline = [row for row in residual_rows(result) if row.headline]
    title, reference, meaning = reference_of(headline)
    heads = ("Residual", "Plates", "RMS", "Mean", "SD", "Peak", "RMS, %", title)
    rows = [
        (
            f"{row.axis} ({row.unit})",
            "compensated" if row.compensated else "measured",
            *(written(value, "z.1f") for value in (row.rms, row.mean, row.sd, row.peak)),
            f"{row.rms_percent:.2f}",
            f"{reference[row.axis]:.1f}",
        )
        for row in headline
    ]
    legend = (
        "x forward, y right, z up; moments about mid-hip; % of body weight, or of body weight × "
        f"stature. {meaning}"
    )
    if rows:
        yield Table("Pelvis residuals", heads, rows, "numbers", legend)
    rated = trial_quality(result)
    quality = [(item, checks) for item, checks in rated.items() if checks != (NOT_KNOWN,)]
    yield Table("Quality", ("Criterion", "Finding"), quality, "trials")
