"""What the page of a report says of single trials and of the sources."""

from collections.abc import Sequence
from typing import Any, Final
from xml.etree.ElementTree import Element

from hbm.notes import Note, warnings_first
from pipeline.report.markup import element, table
from pipeline.report.trial_quality import (
    DELAY_S,
    GAP_PERCENT,
    MARKER_PEAK_MM,
    MARKER_RMS_MM,
    Check,
    trial_checks,
)
from pipeline.run.load import Results
from pipeline.run.provenance import Provenance, TrialState
from pipeline.statistics.design import in_order
from pipeline.trial.residuals import HICKS_FORCE_SHARE, HICKS_MOMENT_SHARE

LIGHTS: Final = {"good": "✔", "look": "▲", "bad": "✖", "none": ""}


def problems(states: Sequence[TrialState], source: Provenance) -> list[Element]:
    """Name every trial that is not simply done, and settings or versions that differ.

    Parameters
    ----------
    states
        What became of the trials.
    source
        What ``study.json`` says.

    Returns
    -------
    list of Element
        One banner, or nothing.
    """
    lines = [
        element("li", element("strong", f"{s.subject} {s.condition} {s.state}"), f": {s.reason}")
        for s in states
        if s.state != "done"
    ]
    for what, found in (("settings", source.settings), ("versions", source.versions)):
        if len(found) > 1:
            text = f"Trials were processed with {len(found)} different {what}: run them again."
            lines.append(element("li", text))
    if not lines:
        return []
    missing = sum(not s.in_tables for s in states)
    lead = "Everything below should be read with this in mind."
    if missing:
        lead = f"{missing} of {len(states)} trials are not in the tables and figures."
    return [element("div", element("p", lead), element("ul", *lines), class_="banner", role="note")]


def trial_tables(results: Results, states: Sequence[TrialState]) -> list[Element]:
    """Show the quality of every trial, and what was said while it was processed.

    Parameters
    ----------
    results
        The trials.
    states
        What became of them.

    Returns
    -------
    list of Element
        Table, legend, notes.
    """
    rows: list[list[Element | str]] = []
    heads: list[str] = []
    order = {name: k for k, name in enumerate(in_order(c for _, c in results.summaries))}
    trials = sorted(results.summaries.items(), key=lambda item: (item[0][0], order[item[0][1]]))
    for (subject, condition), trial in trials:
        checks = trial_checks(trial)
        heads = list(checks)
        rows.append([f"{subject} {condition}", *(_lights(found) for found in checks.values())])
    caption = "Quality of every trial"
    notes = [
        part
        for (subject, condition), trial in trials
        for part in (
            element("h3", f"{subject} {condition}: {trial.source}"),
            element("ul", *(_noted(note) for note in warnings_first(trial.notes))),
        )
    ]
    summary = element("summary", "What was inferred, locked, filled or refused, trial by trial")
    absent = [
        element("li", f"{s.subject} {s.condition}: {s.state}, {s.reason}")
        for s in states
        if not s.in_tables
    ]
    return [
        table(["Trial", *heads], rows, caption=caption, class_="trials"),
        *([element("p", "Without a result:"), element("ul", *absent)] if absent else []),
        element(
            "p",
            "✔ within the limit, ▲ look at it, ✖ outside the limit. Peak residuals: Hicks et al. "
            f"(2015), force below {100 * HICKS_FORCE_SHARE:g} % of the peak external force, moment "
            f"below {100 * HICKS_MOMENT_SHARE:g} % of that times the height of the centre of mass; "
            "plates as measured (no IC) and compensated (IC). Marker error: OpenSim's guideline, "
            f"RMS below {MARKER_RMS_MM:g} mm, peak below {MARKER_PEAK_MM:g} mm. ▲ also: a marker "
            f"gone for more than {GAP_PERCENT:g} % of the trial, plates more than "
            f"{1000 * DELAY_S:g} ms off the markers, frames without a solution. Locked: "
            "coordinates that no marker shows, kept at neutral.",
            class_="small soft",
        ),
        element("details", summary, *notes, class_="small"),
    ]


def _noted(note: Note) -> Element:
    text = f"warning: {note}" if note.level == "warning" else str(note)
    return element("li", f"{text} ", element("span", note.code, class_="small soft"))


def _lights(found: Sequence[Check]) -> Element:
    lines = []
    for check in found:
        text = f"{LIGHTS[check.light]} {check.value}".strip()
        lines.append(element("span", text, class_=f"mark {check.light}"))
        if check.detail:
            lines.append(element("span", check.detail, class_="small"))
    return element("div", *lines)


def sources(source: Provenance) -> list[Element]:
    """Show settings, versions and hashes.

    Parameters
    ----------
    source
        What ``study.json`` says.

    Returns
    -------
    list of Element
        Tables.
    """
    parts = []
    rows: list[list[Element | str]]
    for settings in source.settings:
        rows = [[name, _said(value)] for name, value in settings]
        parts.append(table(("Setting", "Value"), rows, caption="Settings of the trials"))
    for versions in source.versions:
        rows = [[name, value] for name, value in versions.items()]
        parts.append(table(("Package", "Version"), rows, caption="The trials were processed with"))
    rows = [[name, value] for name, value in source.report.items()]
    parts.append(table(("Package", "Version"), rows, caption="The report was made with"))
    program = source.program
    commit = program.git_commit or "not in a repository"
    rows = [["Sources, SHA-256", _code(program.sha256)], ["Git commit", _code(commit)]]
    parts.append(table(("Program", "Identity"), rows, caption="The program"))
    inputs = source.inputs
    if inputs is None:
        text = "The study's folder was not given to the report, so its files are not listed."
        return [*parts, element("p", f"{text} Every trial's key is in study.json.")]
    rows = [[name, _code(digest)] for name, digest in inputs.items()]
    hashes = table(("Input", "SHA-256"), rows, caption="Files that the study is made of")
    summary = element("summary", f"{len(inputs)} input files and their hashes")
    return [*parts, element("details", summary, hashes)]


def _said(value: Any) -> str:
    return "as the files say" if value is None else str(value)


def _code(text: str) -> Element:
    return element("code", text)
