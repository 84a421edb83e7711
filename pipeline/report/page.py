"""The page of a study's report: the verdict first, then everything that it is based on."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from pipeline.config.study import Study
from pipeline.report.effects import ResidualTests, residual_tests
from pipeline.report.figures import drawn_conditions, example_subject
from pipeline.report.methods import cited, methods
from pipeline.report.references import bibtex
from pipeline.report.sources import Sources, source_section
from pipeline.report.tables import Table, residual_tables
from pipeline.report.trials import Problems, TrialSection, find_problems, trial_section
from pipeline.report.verdict import VerdictSection, question, verdict_section
from pipeline.run.load import Results
from pipeline.run.provenance import Provenance, TrialState
from pipeline.statistics.design import Design
from pipeline.statistics.verdict import Verdict
from pipeline.trial.residuals import AXES

MEDIA_TYPES: Final = {".svg": "image/svg+xml", ".png": "image/png"}
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


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure inside the page.

    Attributes
    ----------
    name
        In ``figures/``.
    shows, judge, act
        What it shows, what good and bad look like, and what to do.
    data_uri
        Its file.
    """

    name: str
    shows: str
    judge: str
    act: str
    data_uri: str


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
    bibtex
        The works that the Methods cite.
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
    methods: tuple[str, ...]
    bibtex: str
    sources: Sources


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
        tables=residual_tables(residuals, report.table_3, design),
        tests=residual_tests(report.statistics, design),
        figures=_figures(report.results, report.figures, design),
        example_subject=subject,
        example_figures=tuple(
            _raw_picture(report.figures / f"raw_{axis}.png", axis, subject)
            for axis in AXES
            if subject is not None
        ),
        trials=trial_section(report.results, report.states, design),
        methods=tuple(methods(report.results, report.statistics, design, report.study)),
        bibtex=bibtex(cited(report.results), report.provenance.report["hbm-residuals"]),
        sources=source_section(report.provenance),
    )
    return TEMPLATES.get_template("page.html").render(page=page)


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


def _figures(results: Results, folder: Path, design: Design) -> tuple[Picture, ...]:
    residuals, cycles = results.residuals, results.cycles
    plates = "with the plates as measured"
    if residuals["compensated"].any():
        plates = "without (no IC) and with inertia compensation (IC)"
    pictures = []
    for condition in drawn_conditions(cycles, design):
        reference = ""
        if condition != design.reference and (cycles["condition"] == design.reference).any():
            reference = f", and in {design.reference}"
        shows = (
            f"Residuals over the gait cycle in {condition} {plates}{reference}; mean ± SD. x "
            "forward, y right, z up; moments about the midpoint of the hip joints. Cycles of the "
            "left foot are mirrored (Fy, Mx and Mz change sign). The panels differ in scale."
        )
        pictures.append(
            _picture(
                folder / f"gait_cycle_{condition}.svg",
                shows,
                judge=(
                    "Good: the line stays within the band of the reference, a few per cent of body "
                    "weight from zero. Bad: an offset, a peak that the reference has not, or a "
                    "band that widens at one instant of the cycle."
                ),
                act=(
                    "Where IC leaves a peak while the platform moves, check delay and calibration "
                    "of the accelerometers; where all lines have it, check markers, events and "
                    "plates in the viewer at this percent of the cycle."
                ),
            )
        )
    parallel = (
        "Good: the lines with compensation are level and near the reference, and the subjects' "
        "thin lines run alike. Bad: one condition rises, or a single subject does; lines that are "
        "not parallel are an interaction."
    )
    if not design.compensated:
        parallel = (
            "Good: the line is level, and the subjects' thin lines run alike. Bad: one condition "
            "rises, or a single subject does."
        )
    shows = (
        f"Mean RMS residual of every condition {plates}, with 95 % confidence intervals; thin "
        "lines are subjects."
    )
    act = (
        "Where all subjects rise, look at the condition's gait cycle above; where one does, look "
        "at the quality and the notes of this subject's trials below. Intervals of single means "
        "may overlap though the paired difference is clear: see the tests above."
    )
    means = _picture(folder / "marginal_means.svg", shows, judge=parallel, act=act)
    return (*pictures, means)


def _raw_picture(path: Path, axis: str, subject: str) -> Picture:
    return _picture(
        path,
        f"Residual {axis} of {subject}, every cycle.",
        judge=(
            "Good: every cycle is like the others of its condition. Bad: single cycles stand out, "
            "or the level drifts with time."
        ),
        act=(
            "Look at a cycle that stands out in the viewer: a foot on both plates, a wrong event "
            "or a lost marker. A drift is one of the plates: tare them."
        ),
    )


def _picture(path: Path, shows: str, *, judge: str, act: str) -> Picture:
    data = b64encode(path.read_bytes()).decode()
    return Picture(path.stem, shows, judge, act, f"data:{MEDIA_TYPES[path.suffix]};base64,{data}")
