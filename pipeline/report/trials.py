"""Single trials on the page of a report: problems, quality, what their residuals are made of."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from math import isnan
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spelling import listed, written
from pipeline.config.schema import NOUNS, TrialName
from pipeline.io.write import read_csv
from pipeline.report.blocks import Check, Interval, Table, Text
from pipeline.trial.quality import frames_within
from pipeline.trial.residuals import LIMITS as RESIDUALS
from pipeline.trial.residuals import (
    marker_rows,
    threshold_rows,
)
from pipeline.trial.result import TrialResult

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.budgets.explanation import Explanation
    from pipeline.config.study import Study
    from pipeline.run.load import Results
    from pipeline.run.provenance import Provenance, TrialState

QUALITY: Final = read_numbers("pipeline.report", "thresholds.toml", "quality")
NOT_KNOWN: Final[Check] = ("none", "–", "")
"""What no trial has is not shown."""
LIMITS: Final = {
    "force_percent": f"{100 * RESIDUALS.largest_force:g}",
    "moment_percent": f"{100 * RESIDUALS.largest_moment:g}",
    "marker_rms_mm": f"{QUALITY.marker_error:g}",
    "marker_peak_mm": f"{QUALITY.marker_peak:g}",
    "gap_percent": f"{QUALITY.marker_gaps:g}",
    "delay_ms": f"{1000 * QUALITY.largest_delay:g}",
}


def problems(
    states: Sequence["TrialState"],
    provenance: "Provenance",
    results: "Results",
    compared: Collection[TrialName],
) -> dict[str, Any]:
    """Name trials that are not simply done or not compared, and settings or versions that differ.

    Lines are pairs of a trial and a text.
    """
    alike = dict[tuple[str, str], list[TrialName]]()
    for state in states:
        if state.state != "done":
            alike.setdefault((state.state, state.reason), []).append(state.name)
    lines = [
        (f"{listed(names, 3 if of == 'outdated' else len(names))} {of}", reason)
        for (of, reason), names in alike.items()
    ]
    for name, trial in results.trials.items():
        if trial.span is not None and name not in compared:
            text = (
                f"uses {trial.span[0]:.2f} to {trial.span[1]:.2f} s of the recording, without gait "
                "cycles; not in tables and tests; its residuals are in residuals.csv"
            )
            lines.append((str(name), text))
    for quantity in ("settings", "versions", "engines"):
        if (count := len(getattr(provenance, quantity))) > 1:
            text = f"Trials were processed with {count} different {quantity}: run them again."
            lines.append(("", text))
    missing = sum(not s.in_tables for s in states)
    lead = "The following affects all results below."
    if missing:
        lead = f"{missing} of {len(states)} trials are not in the tables and figures."
    return {"lead": lead, "lines": lines}


def corrections_table(study: "Study | None", headline: "pd.DataFrame") -> Table | None:
    """Name what 'hbm explain --apply' corrected, and residuals before and after; None without.

    `headline` has the residuals of this study's trials; those before are in the results that were
    explained, as long as these are there.
    """
    if study is None or not study.file.corrections:
        return None
    rows = []
    for made in study.file.corrections:
        effect = f"{made.residual} {made.before:.1f} → {made.after:.1f}"
        held_out = f"{written(made.held_out_percent, 'z.0f')} %"
        rows.append((made.cause, made.setting, str(made.trials), effect, held_out))
    before = study.folder / study.file.corrections[0].source / "residuals.csv"
    legend = "The results before the corrections are missing."
    with suppress(OSError, KeyError, ValueError):
        old = _mean_rms(read_csv(before).query("headline"))
        new = _mean_rms(headline)
        fall = ", ".join(f"{axis} {old[axis]:.1f} → {new[axis]:.1f}" for axis in new.index)
        legend = f"Mean RMS over all trials before and after all corrections: {fall}."
    heads = ("Cause", "Setting", "Trials", "Effect alone", "Held-out")
    caption = "Corrections. Held-out: percentage of the mean square in other trials or cycles"
    return Table(caption, heads, rows, "numbers", legend)


def _mean_rms(headline: "pd.DataFrame") -> "pd.Series":
    """Give the mean RMS of each residual, compensated where it is."""
    best = headline[headline["compensated"].astype(bool) == headline["compensated"].any()]
    return best.groupby("axis", sort=False)["rms"].mean()


def quality_table(
    rated: Mapping[str, Mapping[str, tuple[Check, ...]]], links: Mapping[str, str]
) -> Table:
    """Show what `trial_quality` says of every trial, with links to pages."""
    criteria, of_trials = next(iter(rated.values())), rated.values()
    shown = [c for c in criteria if any(checks[c] != (NOT_KNOWN,) for checks in of_trials)]
    heads = ("Trial", *shown)
    rows: list[tuple[str | Sequence[Check], ...]] = [
        (name, *(checks[item] for item in shown)) for name, checks in rated.items()
    ]
    return Table("Quality of every trial", heads, rows, "trials", links=links)


def trial_quality(trial: TrialResult) -> dict[str, tuple[Check, ...]]:
    """Rate a trial: criterion -> findings, in the same order for every trial."""
    solved, locked = trial.motion.converged, len(trial.body.locked)
    unsolved = int(np.count_nonzero(~solved))
    markers, limits = marker_rows(trial), threshold_rows(trial)
    return {
        "Gait cycles": (_counted(trial),),
        "Marker error (RMS)": (_marker_error(markers),),
        "Marker gaps": (_marker_gaps(markers),),
        "Delay of plates": (_delay(trial.delay_s, trial.delay_uncertainty_s),),
        "Unsolved frames": (("check" if unsolved else "pass", str(unsolved), f"of {len(solved)}"),),
        "Uncertainty added by compensation (1σ)": tuple(_compensation(trial)) or (NOT_KNOWN,),
        "Joint angles held": (("none", str(locked), "at neutral" * bool(locked)),),
        "Peak force": tuple(_peaks(limits, "force")),
        "Peak moment": tuple(_peaks(limits, "moment")),
    }


def _counted(trial: TrialResult) -> Check:
    """Say how many gait cycles count, or which span, and for how much of it."""
    counts = {side: len(spans) for side, spans in trial.cycles.items() if len(spans)}
    inside = frames_within(trial.motion.time, *trial.spans.values())
    valid = float(np.mean(trial.counts[inside])) if inside.any() else 0.0
    share = f"{100 * valid:.0f} % of frames" if 0 < valid < 1 else ""
    if trial.span is not None:
        value, sides = f"{trial.span[0]:.2f}–{trial.span[1]:.2f} s", "no gait cycles"
    else:
        value = f"{sum(counts.values())} of {trial.found_cycles}"
        value += "" if trial.unit == "cycle" else f" {NOUNS[trial.unit]}s"
        sides = ", ".join(f"{n} {side}" for side, n in counts.items())
        sides += f"; {trial.part.name}" if trial.part else ""
    return "none", value, "; ".join(filter(None, (sides, share)))


def _compensation(trial: TrialResult) -> Iterator[Check]:
    """Say how uncertain the compensation makes forces and moments, at most, where that is known."""
    counts = trial.counted
    if trial.uncertainty is not None and counts.any():
        spread = np.sqrt(np.mean(trial.uncertainty[counts] ** 2, axis=0))
        yield from (
            ("none", f"{sd.max():.1f} {u}", "")
            for u, sd in (("N", spread[:3]), ("N·m", spread[3:]))
        )


def _marker_error(markers: Sequence[Any]) -> Check:
    """Rate the distance of markers from the model by OpenSim's guideline."""
    overall, segments = markers[-1], [row for row in markers[:-1] if not isnan(row.rms_mm)]
    if not segments:
        return "fail", "unknown", ""
    worst = max(segments, key=lambda row: row.rms_mm)
    rating = "pass" if overall.peak_mm <= QUALITY.marker_peak else "check"
    if overall.rms_mm >= QUALITY.marker_error:
        rating = "fail"
    detail = f"{worst.marker} {worst.rms_mm:.1f}, peak {overall.peak_mm:.0f}"
    return rating, f"{overall.rms_mm:.1f} mm", detail


def _marker_gaps(markers: Sequence[Any]) -> Check:
    """Rate for how much of the trial markers are missing."""
    worst = max(markers[:-1], key=lambda row: row.missing_percent)
    percent = worst.missing_percent
    rating = "check" if percent > QUALITY.marker_gaps else "pass"
    detail = f"{worst.marker} {percent:.1f} %" if percent else ""
    return rating, f"{markers[-1].missing_percent:.1f} %", detail


def _peaks(thresholds: Sequence[Any], quantity: str) -> Iterator[Check]:
    """Rate peak residuals by the limits of Hicks et al."""
    names = {False: "no IC ", True: "IC "} if len(thresholds) > 2 else {}
    for row in thresholds:
        if row.quantity == quantity:
            name = names.get(row.compensated, "")
            value = f"{name}{row.peak:.0f} {row.unit}, limit {row.limit:.0f} {row.unit}"
            above = f"above in {row.above_percent:.1f} % of frames"
            yield "pass" if row.passed else "fail", value, "" if row.passed else above


def _delay(delay_s: float, uncertainty_s: float) -> Check:
    """Rate the delay between plates and markers."""
    if np.isnan(delay_s):
        return "check", "unknown", ""
    spread = "" if np.isnan(uncertainty_s) else f" ± {1000 * uncertainty_s:.1f}"
    rating = "check" if abs(delay_s) > QUALITY.largest_delay else "pass"
    return rating, f"{written(1000 * delay_s, 'z.1f')}{spread} ms", ""


def causes(name: str, explanation: "Explanation") -> tuple[Text, Table]:
    """Show what a trial's residuals are made of: percentages, sizes, what to fix, what is open."""
    from pipeline.budgets.words import Share, budget_table

    title, axes, rows = budget_table(explanation.budget)
    shares = [cell for _, cells in rows for cell in cells if isinstance(cell, Share)]
    # one scale for all cells, which holds 0 and 100 %; what is beyond -100 and 200 %, as intervals
    # of what is unknown are, ends at the border
    low = max(min(0.0, *(share.percent - share.half for share in shares)), -100.0)
    high = min(max(100.0, *(share.percent + share.half for share in shares)), 200.0)

    def drawn(share: Share) -> Interval:
        ends = share.percent - share.half, share.percent, share.percent + share.half, 0.0, 100.0
        places = (np.clip(np.array(ends), low, high) - low) / (high - low)
        return Interval([f"{3 + 94 * place:.1f}%" for place in places], f"{share} %")

    legend = (
        "RMS with 95 % interval of measurement. Dot and line: share of the mean square with 95 "
        "% interval; dotted: 0 and 100 %. Below 0: without this cause the residual is larger."
    )
    shown = [
        (head, *(drawn(cell) if isinstance(cell, Share) else cell for cell in cells))
        for head, cells in rows
    ]
    table = Table(f"{name}: {title}", ("Cause", *axes), shown, "budget", legend)
    notes = (note.text for note in explanation.budget.notes)
    return Text(name, (*explanation.lines(), *notes)), table
