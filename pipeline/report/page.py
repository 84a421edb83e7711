"""The page of a study's report: the verdict first, then everything that it is based on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from pipeline.budgets.explanation import Explanation
from pipeline.config.comparison import groups
from pipeline.config.study import Study
from pipeline.report.budgets import BudgetSection, budget_section
from pipeline.report.effects import ResidualTests, residual_tests
from pipeline.report.figures import example_subject
from pipeline.report.methods import cited, methods
from pipeline.report.pictures import Picture, example_pictures, study_pictures
from pipeline.report.references import bibtex
from pipeline.report.sources import Sources, source_section
from pipeline.report.tables import Table, residual_tables
from pipeline.report.trials import Problems, TrialSection, find_problems, trial_section
from pipeline.report.verdict import VerdictSection, question, verdict_section
from pipeline.report.windows import windows_sentence
from pipeline.run.load import Results
from pipeline.run.provenance import Provenance, TrialState
from pipeline.statistics.design import Design
from pipeline.statistics.verdict import Verdict

TEMPLATES: Final = Environment(
    loader=PackageLoader("pipeline.report"),
    autoescape=True,  # what users typed is text, never markup
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True, slots=True)
class Report:
    """What a report is made from.

    Attributes
    ----------
    results, design, statistics, table_3, verdicts
        The trials, what is compared, the tests, Table III, the verdicts.
    states, provenance
        What became of the trials, and what the results were made from.
    figures
        Folder of the drawn figures.
    study
        The study, if its folder is available.
    explained
        What the residuals of single trials are made of, by subject and condition.
    measurement
        What adds intervals of measurement to the tables; empty where they have them.
    """

    results: Results
    design: Design
    statistics: pd.DataFrame
    table_3: pd.DataFrame
    verdicts: Sequence[Verdict]
    states: Sequence[TrialState]
    provenance: Provenance
    figures: Path
    study: Study | None
    explained: Mapping[tuple[str, str], Explanation]
    measurement: str


@dataclass(frozen=True, slots=True)
class Page:
    """Everything that the templates show.

    Attributes
    ----------
    name, scope, question
        Name of the study; its subjects, trials and conditions; what it answers.
    problems
        What a reader has to know before the results, if anything.
    verdict, tables, tests, figures, trials, methods, sources
        The sections.
    example_subject, example_figures
        The subject whose gait cycles are drawn one by one, and the figures; None without cycles.
    budgets
        What the residuals of single trials are made of; None where none was explained.
    bibtex
        The works that the Methods cite.
    windows
        What of the trials the residuals are of.
    measurement
        What adds intervals of measurement, if anything.
    """

    name: str
    scope: str
    question: str
    problems: Problems | None
    verdict: VerdictSection
    tables: tuple[Table, ...]
    tests: tuple[ResidualTests, ...]
    figures: tuple[Picture, ...]
    example_subject: str | None
    example_figures: tuple[Picture, ...]
    trials: TrialSection
    budgets: BudgetSection | None
    methods: tuple[str, ...]
    bibtex: str
    sources: Sources
    windows: str
    measurement: str


def write_page(report: Report) -> str:
    """Give the report as one self-contained HTML page.

    Parameters
    ----------
    report
        What to show.

    Returns
    -------
    str
        HTML with its style and figures inside; no script, no request to anywhere.
    """
    residuals, design = report.results.residuals, report.design
    subject = example_subject(report.results.cycles)
    page = Page(
        name=report.provenance.name or "Study report",
        question=question(design),
        scope=_scope(report.results, design),
        problems=find_problems(report.states, report.provenance, report.results),
        verdict=verdict_section(report.verdicts, residuals, design, stated=_stated(report.study)),
        tables=residual_tables(residuals, report.table_3, design, _groups(report.study)),
        tests=residual_tests(report.statistics, design),
        figures=study_pictures(report.results, report.figures, design),
        example_subject=subject,
        example_figures=example_pictures(report.figures, subject),
        trials=trial_section(report.results, report.states, design),
        budgets=budget_section(report.results, report.explained, design),
        methods=tuple(methods(report.results, report.statistics, design, report.study)),
        bibtex=bibtex(cited(report.results), report.provenance.report["hbm-residuals"]),
        sources=source_section(report.provenance),
        windows=windows_sentence(residuals),
        measurement=report.measurement,
    )
    return TEMPLATES.get_template("page.html").render(page=page)


def _groups(study: Study | None) -> dict[str, str]:
    """Give the group of every subject that has one."""
    found = {} if study is None else groups(study.file, study.subjects)
    return {subject: group for subject, group in found.items() if group is not None}


def _stated(study: Study | None) -> bool:
    return study is not None and study.file.comparison is not None


def _scope(results: Results, design: Design) -> str:
    conditions = ", ".join(design.in_order(results.residuals["condition"]))
    subjects, trials = results.residuals["subject"].nunique(), len(results.summaries)
    variants = " without and with inertia compensation (IC)" * design.compensated
    return (
        f"Pelvis residuals{variants}: {subjects} "
        f"subject{'s' * (subjects > 1)}, {trials} trial{'s' * (trials > 1)}; {conditions}"
    )
