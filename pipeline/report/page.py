"""The page of a study's report: verdict first, then what it rests on."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import pandas as pd

from pipeline.config.study import Study
from pipeline.report.figures import drawn_conditions, raw_subject
from pipeline.report.markup import element, render
from pipeline.report.methods import cited, methods
from pipeline.report.references import bibtex
from pipeline.report.style import CSS
from pipeline.report.tables import means_table, table_3_table
from pipeline.report.trials import problems, sources, trial_tables
from pipeline.report.verdict import verdict_section
from pipeline.run.load import Results
from pipeline.run.provenance import Provenance, TrialState
from pipeline.statistics.design import CONDITIONS, in_order
from pipeline.statistics.verdict import BASELINE, Verdict
from pipeline.trial.residuals import AXES

NOTHING_OUTSIDE: Final = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
MIME: Final = {".svg": "image/svg+xml", ".png": "image/png"}


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that a page shows.

    Attributes
    ----------
    results, statistics, table_3, found
        The trials, the tests, Table III, the verdicts.
    states, source
        What became of the trials; what ``study.json`` says.
    figures
        Folder of the drawn figures.
    study
        The study, if its folder is at hand.
    """

    results: Results
    statistics: pd.DataFrame
    table_3: pd.DataFrame
    found: Sequence[Verdict]
    states: Sequence[TrialState]
    source: Provenance
    figures: Path
    study: Study | None


def write_page(report: Report) -> str:
    """Give the report as one HTML page that needs nothing else.

    Parameters
    ----------
    report
        What to show.

    Returns
    -------
    str
        HTML with its style and pictures inside; no script, no request to anywhere.
    """
    name = report.source.name or "Study report"
    found, residuals = report.found, report.results.residuals
    banner = problems(report.states, report.source)
    question = "Does compensation bring each residual back to baseline?"
    sections = {
        "verdict": (question, verdict_section(found, residuals, banner)),
        "residuals": ("Residuals", _residuals(report)),
        "figures": ("Figures", _figures(report)),
        "trials": ("Trials", trial_tables(report.results, report.states)),
        "methods": ("Methods and references", _methods(report)),
        "sources": ("Settings, versions, hashes", sources(report.source)),
    }
    links = [element("a", key.capitalize(), href=f"#{key}") for key in sections]
    body = [
        element(
            "header",
            element("h1", name),
            element("p", _scope(report), class_="soft"),
            element("nav", *links, aria_label="Sections"),
        ),
        element(
            "main",
            *(
                element("section", element("h2", title), *content, id=key)
                for key, (title, content) in sections.items()
            ),
        ),
    ]
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=NOTHING_OUTSIDE),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", f"{name}: pelvis residuals"),
        element("style", CSS),
    )
    return render(element("html", head, element("body", *body), lang="en"))


def _scope(report: Report) -> str:
    residuals = report.results.residuals
    conditions = ", ".join(in_order(residuals["condition"]))
    subjects, trials = residuals["subject"].nunique(), len(report.results.summaries)
    return (
        f"Pelvis residuals without and with inertia compensation (IC): {subjects} "
        f"subject{'s' * (subjects > 1)}, {trials} trial{'s' * (trials > 1)}; {conditions}"
    )


def _residuals(report: Report) -> list[Element]:
    residuals = report.results.residuals
    parts = []
    if report.table_3["n"].gt(0).any():
        parts.append(table_3_table(report.table_3))
    if not parts or set(residuals["condition"]) - set(CONDITIONS):
        parts.append(means_table(residuals))
    files = "residuals.csv, cycles.parquet, statistics.csv, table_3.csv and table_3.md"
    parts.append(element("p", f"In numbers beside this page: {files}.", class_="small soft"))
    return parts


def _figures(report: Report) -> list[Element]:
    residuals = report.results.residuals
    plates = "as measured (no IC)"
    if residuals["compensated"].any():
        plates = "without (no IC) and with compensation (IC)"
    parts = []
    for condition in drawn_conditions(residuals):
        beside = ""
        if condition != BASELINE and (residuals["condition"] == BASELINE).any():
            beside = ", and at baseline"
        text = (
            f"Residuals over the gait cycle in {condition} {plates}{beside}; mean ± SD. x forward, "
            "y right, z up; moments about the middle of the hip joints. Cycles of the left foot "
            "are mirrored (Fy, Mx and Mz change sign). Scales differ."
        )
        parts.append(_picture(report.figures / f"gait_cycle_{condition}.svg", text))
    text = (
        f"Mean RMS residual of every condition {plates}, with 95 % confidence intervals; thin "
        "lines are subjects. Lines that are not parallel show that compensation acts by condition "
        "(interaction)."
    )
    parts.append(_picture(report.figures / "marginal_means.svg", text))
    who = raw_subject(residuals)
    raw = [
        _picture(report.figures / f"raw_{axis}.png", f"Residual {axis} of {who}, nothing averaged.")
        for axis in AXES
    ]
    summary = element("summary", f"Raw residuals of one subject ({who}), six figures")
    return [*parts, element("details", summary, *raw)]


def _picture(path: Path, caption: str) -> Element:
    data = b64encode(path.read_bytes()).decode()
    source = f"data:{MIME[path.suffix]};base64,{data}"
    return element(
        "figure",
        element("img", src=source, alt=caption),
        element("figcaption", f"{caption} (figures/{path.stem}.svg and .png)"),
    )


def _methods(report: Report) -> list[Element]:
    paragraphs = methods(report.results, report.statistics, report.study)
    keys = cited(report.results)
    entries = bibtex(keys, report.source.report["hbm-residuals"])
    return [
        element("p", "True for the settings of these trials; ready to paste.", class_="small soft"),
        *(element("p", text) for text in paragraphs),
        element("details", element("summary", "BibTeX"), element("pre", entries)),
    ]
