"""The report of a study: tables, statistics, figures and one page, from what `hbm run` left."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import pandas as pd
from joblib import delayed
from matplotlib.figure import Figure

from pipeline.budgets.explanation import explanations
from pipeline.budgets.measurement import study_covariances
from pipeline.config.comparison import groups, study_design
from pipeline.config.schema import MAIN, Figures, Settings, TrialName
from pipeline.config.study import Study, read_study
from pipeline.figures.style import PAGE, save_figure
from pipeline.io.write import write_csv, write_text
from pipeline.report.blocks import Drawn, Section, markup, write_page
from pipeline.report.curves import compared_curves, curve_tables
from pipeline.report.effects import tests_table
from pipeline.report.figures import rms_over_cycles, study_figures
from pipeline.report.joints import JointMeans, compensation_tables, joint_figures
from pipeline.report.laboratory import page_of_study
from pipeline.report.methods import bibtex, methods
from pipeline.report.paper import write_paper
from pipeline.report.tables import (
    plan_markdown,
    plan_table,
    recordings_sentence,
    reliability_tables,
    repeated_values,
    residual_tables,
    windows_sentence,
)
from pipeline.report.trial_page import write_changed_page
from pipeline.report.trials import (
    LIMITS,
    causes,
    corrections_table,
    problems,
    quality_table,
    trial_quality,
)
from pipeline.report.variants import choices, variant_residuals, variant_results
from pipeline.report.verdict import question, verdict_values
from pipeline.report.workbook import write_columns, write_wide_tables
from pipeline.run.job import read_failures
from pipeline.run.load import Curves, Results, collect, select_trials
from pipeline.run.processes import MIN_TASKS, in_processes
from pipeline.run.provenance import left_out, provenance, trial_states
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import Design, unstated_design
from pipeline.statistics.recordings import pool_recordings
from pipeline.statistics.reliability import reliability
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.statistics.verdict import verdicts

SECTIONS: Final = {
    "residuals": "Residuals",
    "joints": "Joints",
    "choices": "Does the conclusion depend on the choices?",
    "tests": "Tests",
    "figures": "Figures",
    "trials": "Trials",
    "causes": "Causes of the residuals",
    "methods": "Methods and references",
    "sources": "Settings, versions and input files",
}
"""Folded sections of the page, below the verdict: template -> heading."""
MAX_PAGES: Final = 60
"""Trials of a study whose pages are written unasked; drawing them takes longer than its report."""
NO_PAGES: Final = "No pages of single trials were written: hbm report RESULTS --pages writes them."
Announce = Callable[..., None]


def write_report(
    folder: str | Path,
    study_folder: str | Path | None = None,
    announce: Announce = lambda step, done=0, steps=0: None,
    *,
    pages: bool | None = False,
    formats: tuple[str, ...] = (),
) -> Path:
    """Write tables, statistics, figures and ``report.html`` into a results folder.

    Parameters
    ----------
    folder
        Results folder: ``trials/`` and, where trials failed, ``failures.json`` ("subject
        condition" -> reason).
    study_folder
        The study, for its conditions and treadmill, its excluded trials and its input files.
    announce
        Called with what is done, such as "collecting the trials", and, where it has parts, how many
        of them are done and how many there are.
    pages
        Whether a page is written for each trial, ``trials/NAME.html``, and linked; None for studies
        of at most `MAX_PAGES` trials.
    formats
        Of the figures; empty for those that the study states.

    Returns
    -------
    Path
        ``report.html``.

    Raises
    ------
    ValueError
        If there is no trial, or a file of the results is damaged.
    StudyFaults
        If the study's files are at fault.
    OSError
        If the folder cannot be written to.

    Notes
    -----
    Every file is written completely or not at all. Equal results give equal files: none holds a
    date.

    Examples
    --------
    >>> import pipeline
    >>> pipeline.write_report("results")
    Traceback (most recent call last):
    ValueError: results: no results of trials here; run 'hbm run STUDY --out results'
    """
    folder = Path(folder)
    study = read_study(study_folder, recordings=False) if study_folder is not None else None
    announce("collecting the trials")
    failures, with_pages = read_failures(folder), writes_pages(folder, pages)
    results = collect(
        folder,
        trial_quality,
        lambda trial: not left_out(trial.name, trial, failures, study),
        partial(announce, "collecting the trials"),
    )
    states = trial_states(results, failures, study)
    results = select_trials(results, {state.name for state in states if state.in_tables})
    of_variants = {MAIN: results}
    if study is not None and study.variants:
        announce("collecting the variants")
        of_variants |= variant_results(folder, study)
    tables = {"residuals": results.residuals, "cycles": results.by_cycle, "joints": results.joints}
    explained, failed, together, stale = explanations(folder, results.trials)
    of_pages = (
        delayed(write_changed_page)(trial, folder, explained.get(name), study)
        for name, trial in results.trials.items()
        if with_pages
    )
    written: Any = in_processes(of_pages)
    with closing(written):
        next(written, None)  # the others are drawn while this process goes on
        announce("computing statistics")
        headline = results.residuals[results.residuals["headline"].astype(bool)]
        design = _design(headline, study)
        compared = design.comparable(headline)
        sensitivity = None
        if len(of_variants) > 1:
            tables["variants"] = variant_residuals(of_variants, design)
            sensitivity = choices(of_variants, design)
        names = {TrialName(*key) for key in compared[[*TrialName._fields]].itertuples(index=False)}
        results = replace(results, residuals=pool_recordings(compared, design.weigh))
        people = _all_subjects(results.subjects, study)
        tests = statistics(results.residuals, people, design, compared)
        write_wide_tables(folder, results.residuals, results.joints, people, design)
        repeated = reliability(repeated_values(compared, results.joints))
        if len(repeated):
            tables["reliability"] = repeated
        announce("comparing curves")
        cycles = Curves(folder / "cycles.parquet")
        of_recordings = rms_over_cycles(cycles, "cycle", within=("recording",))
        over_cycles = of_recordings.drop(columns="recording")
        if over_cycles.duplicated(["subject", "condition", "compensated", "axis", "percent"]).any():
            over_cycles = rms_over_cycles(cycles, design.weigh)
        joints = JointMeans(Curves(folder / "joint_cycles.parquet"), design.weigh)
        between = people.set_index("subject")[_between(design, study)]
        curves = compared_curves(of_recordings, joints, design, between)
        compared = compared[compared["condition"].isin(design.conditions)]
        measurement, missing = study_covariances(explained, compared, design.weigh)
        table = table_3(results.residuals, tests, design, measurement)
        windows = windows_sentence(results.residuals)
        windows = f"{windows} {recordings_sentence(results.residuals, design)}".strip()
        below = "\n".join(filter(None, (windows, missing)))
        write_text(f"{table_3_markdown(table, design)}\n{below}\n", folder / "table_3.md")
        judged = verdicts(results.residuals, design, measurement, compared)
        tables |= {**curve_tables(curves), "statistics": tests, "table_3": table}
        for file, shown in {**tables, "plan": plan_table(judged, design)}.items():
            write_csv(shown, folder / f"{file}.csv")
        write_text(plan_markdown(judged, design), folder / "plan.md")
        write_columns(folder)
        if study is not None:
            announce("hashing the study's files")
        source = provenance(results, states, study)
        write_text(source.to_json(), folder / "study.json")

        for done, _ in enumerate(written, start=2):
            announce("drawing pages of trials", done, len(results.trials))
    order = design.in_order(name.condition for name in results.trials)
    keys = sorted(results.trials, key=lambda n: (n.subject, order.index(n.condition), n.recording))
    of_joints = dict(joint_figures(joints, design, curves))
    of_study_figures = dict(study_figures(results, over_cycles, tests, design, curves))
    look = PAGE if study is None else study.file.figures
    if formats:
        # two columns of a journal, if the study states no width
        look = look.model_copy(update={"formats": formats, "width_mm": look.width_mm or 180.0})
    tasks = [
        delayed(_draw)(folder / "figures" / name, draw, look)
        for name, draw in {**of_joints, **of_study_figures}.items()
    ]
    least = 1 if len(results.ratings) >= 2 * MIN_TASKS else MIN_TASKS  # processes have started
    drawn = dict[str, Drawn]()
    for name, figure in in_processes(tasks, least=least):
        drawn[name] = figure
        announce(f"drawing: {name}", len(drawn), len(tasks))
    paragraphs = methods(results, tests, design, study, curves=bool(curves))
    of_study = {} if study is None else groups(study.file, study.subjects)
    planned = study is not None and study.file.comparison is not None
    verdict = verdict_values(judged, results.residuals, tests, states, design, planned=planned)
    of_residuals = residual_tables(
        results.residuals, table, design, {s: g for s, g in of_study.items() if g is not None}
    )
    write_paper(folder, question(design), verdict["paragraph"], of_residuals)
    values = dict(
        design=design,
        windows=windows,
        measurement=missing,
        problems=problems(states, source, results, names),
        verdict=verdict,
        tables=of_residuals,
        repeatability=reliability_tables(repeated, design),
        choices=sensitivity,
        tests=tests_table(tests),
        joints={name: drawn[name] for name in of_joints},
        joint_tables=compensation_tables(results.joints, design),
        pictures=drawn,
        laboratory=None if study is None else page_of_study(study, folder),
        calibration=None if study is None else study.file.treadmill.calibration,
        any_compensated=bool(results.residuals["compensated"].any()),
        trials={str(name): results.trials[name] for name in keys},
        states=states,
        quality=quality_table(
            {str(name): results.ratings[name] for name in results.trials},
            {str(name): f"trials/{name.stem}.html" for name in keys} if with_pages else {},
        ),
        no_pages="" if with_pages else NO_PAGES,
        limits=LIMITS,
        explained=bool(explained or failed or stale),
        causes=[causes(str(name), explained[name]) for name in keys if name in explained],
        unexplained=[f"{name}: {failed[name]}" for name in map(str, keys) if name in failed],
        stale=stale,
        together=together,
        corrections=corrections_table(study, headline),
        methods=paragraphs,
        bibtex=bibtex(paragraphs, source.report["hbm-residuals"]),
        source=source,
        unstated={
            name: str(field.description).partition("default: ")[2].rstrip(".")
            for name, field in Settings.model_fields.items()
        },
    )
    sections = [Section("verdict", question(design), [markup("verdict.html", **values)])]
    for part, title in SECTIONS.items():
        sections.append(Section(part, title, [markup(f"{part}.html", **values)], folded=True))
    name = source.name or "Study report"
    return write_page(folder / "report.html", name, _scope(results, design), sections)


def writes_pages(folder: Path, wanted: bool | None) -> bool:
    """Whether a page is written for each trial of a results folder, where that may be open."""
    count = sum(1 for _ in (folder / "trials").glob("*.parquet"))
    return count <= MAX_PAGES if wanted is None else wanted


def _draw(path: Path, draw: Callable[..., Figure], look: Figures) -> tuple[str, Drawn]:
    """Draw a figure into its files, without suffix; give its name, its title and its source."""
    figure = draw(look=look)
    return path.name, Drawn(str(figure.get_label()), save_figure(figure, path, look))


def _design(residuals: pd.DataFrame, study: Study | None) -> Design:
    """Give the study's design; without its folder, the one that its conditions suggest."""
    if study is not None:
        design = study_design(study.file)
        if residuals["compensated"].any() and not design.compensated:
            raise ValueError(
                f"{study.folder}: study.toml states no calibration, with which its results were "
                f"made; state it again, or 'hbm run {study.folder} --overwrite'"
            )
        return design
    conditions = sorted(set(residuals["condition"]))
    return unstated_design(conditions, compensated=bool(residuals["compensated"].any()))


def _between(design: Design, study: Study | None) -> list[str]:
    """Give the design's group, and the covariates that a study states."""
    comparison = None if study is None else study.file.comparison
    covariates = () if comparison is None else comparison.covariates or ()
    return [*filter(None, (design.group, *covariates))]


def _all_subjects(subjects: pd.DataFrame, study: Study | None) -> pd.DataFrame:
    """Add the study's subjects without any result, so that statistics name them, and groups."""
    if study is None:
        return subjects
    with_results = set(subjects["subject"])
    absent = [
        {"subject": name, **person.person.model_dump()}
        for name, person in study.subjects.items()
        if name not in with_results
    ]
    people = pd.DataFrame([*subjects.to_dict("records"), *absent], columns=subjects.columns)
    of_study = groups(study.file, study.subjects)
    return people.assign(group=people["subject"].map(of_study)) if of_study else people


def _scope(results: Results, design: Design) -> str:
    """Say of how many subjects, trials and conditions the report is."""
    conditions = ", ".join(design.in_order(results.residuals["condition"]))
    subjects, trials = results.residuals["subject"].nunique(), len(results.trials)
    variants = " without and with inertia compensation (IC)" * design.compensated
    return (
        f"Pelvis residuals{variants}: {subjects} "
        f"subject{'s' * (subjects > 1)}, {trials} trial{'s' * (trials > 1)}; {conditions}"
    )
