"""Single trials on the page of a report: their quality, their notes, and those without a result."""

from collections.abc import Sequence
from dataclasses import dataclass

from hbm.notes import Level, Note
from pipeline.report.trial_quality import (
    MAX_DELAY_S,
    MAX_GAP_PERCENT,
    MAX_MARKER_PEAK_MM,
    MAX_MARKER_RMS_MM,
    Criterion,
    trial_quality,
)
from pipeline.run.load import Results
from pipeline.run.provenance import Provenance, TrialState
from pipeline.statistics.design import Design
from pipeline.trial.residuals import MAX_FORCE_SHARE, MAX_MOMENT_SHARE
from pipeline.trial.summary import TrialSummary


@dataclass(frozen=True, slots=True)
class Problem:
    """A trial that is not simply done, or settings that differ (then without a trial)."""

    trial: str
    text: str


@dataclass(frozen=True, slots=True)
class Problems:
    """What a reader has to know before the results."""

    lead: str
    lines: tuple[Problem, ...]


@dataclass(frozen=True, slots=True)
class QualityRow:
    """The quality of one trial."""

    name: str
    criteria: tuple[Criterion, ...]


@dataclass(frozen=True, slots=True)
class TrialNotes:
    """The notes of one trial that have the same level."""

    name: str
    source: str
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """The limits of the trials' quality, as text."""

    hicks_force_percent: str = f"{100 * MAX_FORCE_SHARE:g}"
    hicks_moment_percent: str = f"{100 * MAX_MOMENT_SHARE:g}"
    marker_rms_mm: str = f"{MAX_MARKER_RMS_MM:g}"
    marker_peak_mm: str = f"{MAX_MARKER_PEAK_MM:g}"
    gap_percent: str = f"{MAX_GAP_PERCENT:g}"
    delay_ms: str = f"{1000 * MAX_DELAY_S:g}"


@dataclass(frozen=True, slots=True)
class TrialSection:
    """Everything that the page shows of single trials.

    Attributes
    ----------
    rows
        Quality of every trial.
    absent
        Trials without a result and the reasons.
    warnings, information
        Notes by level, trial by trial; trials without such a note are left out.
    limits
        The limits of the quality.
    """

    rows: tuple[QualityRow, ...]
    absent: tuple[str, ...]
    warnings: tuple[TrialNotes, ...]
    information: tuple[TrialNotes, ...]
    limits: QualityLimits = QualityLimits()


def find_problems(
    states: Sequence[TrialState], provenance: Provenance, results: Results
) -> Problems | None:
    """Name trials that are not simply done or not compared, and settings or versions that differ.

    Parameters
    ----------
    states
        What became of the trials.
    provenance
        What the results were made from.
    results
        The trials; those whose residuals are not compared lack them here.

    Returns
    -------
    Problems or None
        None if there are none.
    """
    lines = [
        Problem(f"{s.subject} {s.condition} {s.state}", s.reason)
        for s in states
        if s.state != "done"
    ]
    compared = set(results.residuals["subject"] + " " + results.residuals["condition"])
    for key, trial in results.summaries.items():
        if trial.span is not None and " ".join(key) not in compared:
            text = (
                f"counts {trial.span[0]:.2f} to {trial.span[1]:.2f} s of the recording and no gait "
                "cycles, so it is left out of tables and tests; its residuals are in residuals.csv"
            )
            lines.append(Problem(" ".join(key), text))
    for quantity, different in (
        ("settings", provenance.settings),
        ("versions", provenance.versions),
        ("engines", provenance.engines),
    ):
        if len(different) > 1:
            text = (
                f"Trials were processed with {len(different)} different {quantity}: run them again."
            )
            lines.append(Problem("", text))
    if not lines:
        return None
    missing = sum(not s.in_tables for s in states)
    lead = "The following affects all results below."
    if missing:
        lead = f"{missing} of {len(states)} trials are not in the tables and figures."
    return Problems(lead, tuple(lines))


def trial_section(results: Results, states: Sequence[TrialState], design: Design) -> TrialSection:
    """Show the quality and the notes of every trial.

    Parameters
    ----------
    results
        The trials.
    states
        What became of them.
    design
        The order of the conditions.

    Returns
    -------
    TrialSection
        In order of subject and condition.
    """
    order = {name: k for k, name in enumerate(design.in_order(c for _, c in results.summaries))}
    keys = sorted(results.summaries, key=lambda key: (key[0], order[key[1]]))
    trials = [(" ".join(key), results.summaries[key]) for key in keys]
    return TrialSection(
        rows=tuple(QualityRow(name, trial_quality(trial)) for name, trial in trials),
        absent=tuple(
            f"{s.subject} {s.condition}: {s.state}, {s.reason}" for s in states if not s.in_tables
        ),
        warnings=_notes(trials, "warning"),
        information=_notes(trials, "info"),
    )


def _notes(trials: Sequence[tuple[str, TrialSummary]], level: Level) -> tuple[TrialNotes, ...]:
    noted = [
        TrialNotes(name, trial.source, tuple(n for n in trial.notes if n.level == level))
        for name, trial in trials
    ]
    return tuple(trial for trial in noted if trial.notes)
