"""The report of a study: tables, statistics, figures and one page, from what `hbm run` left."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from hbm.spelling import did_you_mean, listed, short
from pipeline.budgets.measurement import study_covariances, what_is_missing
from pipeline.budgets.study import explanations
from pipeline.config.comparison import groups, study_design
from pipeline.config.schema import COVARIATES
from pipeline.config.study import Study, read_study
from pipeline.figures.style import save_figure
from pipeline.io.write import whole_file, write_csv, write_text
from pipeline.report.figures import study_figures
from pipeline.report.page import Report, write_page
from pipeline.report.plan import plan_markdown, plan_table
from pipeline.report.windows import windows_sentence
from pipeline.run.failures import read_failures
from pipeline.run.load import collect, select_trials
from pipeline.run.provenance import provenance, trial_states
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import Design, unstated_design
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.statistics.verdict import verdicts


def write_report(
    folder: Path,
    study_folder: Path | None = None,
    announce: Callable[[str], None] = lambda step: None,
    *,
    covariates: Sequence[str] = (),
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
        Called with every step as it begins, such as "drawing marginal_means".
    covariates
        Of the further analysis of variance, in place of the study's: height_m, mass_kg, sex,
        age_years.

    Returns
    -------
    Path
        ``report.html``.

    Raises
    ------
    ValueError
        If there is no trial, a file of the results is damaged, or a covariate is unknown.
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
    >>> pipeline.write_report(Path("results"))
    Traceback (most recent call last):
    ValueError: results: no results of trials here; run 'hbm run STUDY --out results'
    """
    study = read_study(study_folder, recordings=False) if study_folder is not None else None
    announce("collecting the trials")
    results = collect(folder)
    states = trial_states(results, read_failures(folder), study)
    results = select_trials(results, {(s.subject, s.condition) for s in states if s.in_tables})
    write_csv(results.residuals, folder / "residuals.csv")
    write_csv(results.by_cycle, folder / "cycles.csv")
    headline = results.residuals[results.residuals["headline"].astype(bool)]
    results = replace(results, residuals=headline.reset_index(drop=True))
    announce("computing statistics")
    design = _design(results.residuals, study, covariates)
    results = replace(results, residuals=design.comparable(results.residuals))
    tests = statistics(results.residuals, _all_subjects(results.subjects, study), design)
    explained = explanations(folder, results.summaries)
    compared = results.residuals[results.residuals["condition"].isin(design.conditions)]
    measurement = study_covariances(explained, compared)
    missing = what_is_missing(explained, compared)
    table = table_3(results.residuals, tests, design, measurement)

    write_csv(tests, folder / "statistics.csv")
    write_csv(table, folder / "table_3.csv")
    below = "\n".join(filter(None, (windows_sentence(results.residuals), missing)))
    write_text(f"{table_3_markdown(table, design)}\n{below}\n", folder / "table_3.md")
    found = verdicts(results.residuals, design, measurement)
    write_csv(plan_table(found, design), folder / "plan.csv")
    write_text(plan_markdown(found, design), folder / "plan.md")
    with whole_file(folder / "cycles.parquet") as temporary:
        results.cycles.to_parquet(temporary, index=False, compression="zstd")
    if study is not None:
        announce("hashing the study's files")
    source = provenance(results, states, study)
    write_text(source.to_json(), folder / "study.json")

    figures = folder / "figures"
    for name, figure in study_figures(results, tests, design):
        announce(f"drawing {name}")
        save_figure(figure, figures / name)
    about = results, design, tests, table, found, states, source, figures, study
    page = write_page(Report(*about, explained=explained, measurement=missing))
    write_text(page, folder / "report.html")
    return folder / "report.html"


def _design(residuals: pd.DataFrame, study: Study | None, covariates: Sequence[str]) -> Design:
    """Give the study's design; without its folder, the one that its conditions suggest."""
    if study is None:
        conditions = sorted(set(residuals["condition"]))
        design = unstated_design(conditions, compensated=bool(residuals["compensated"].any()))
    else:
        design = study_design(study.file)
    for name in covariates:
        if name not in COVARIATES:
            hint = did_you_mean(name, COVARIATES) or f"; there are {listed(COVARIATES)}"
            raise ValueError(f"--covariate {short(name)}: no such covariate{hint}")
    if design.group is not None and design.group in covariates:
        raise ValueError(f"--covariate {design.group} tells the groups apart already; leave it out")
    return replace(design, covariates=tuple(dict.fromkeys(covariates)) or design.covariates)


def _all_subjects(subjects: pd.DataFrame, study: Study | None) -> pd.DataFrame:
    """Add the study's subjects without any result, so that statistics name them, and groups."""
    if study is None:
        return subjects
    known = set(subjects["subject"])
    absent = [
        {"subject": name, **person.person.model_dump()}
        for name, person in study.subjects.items()
        if name not in known
    ]
    people = pd.DataFrame([*subjects.to_dict("records"), *absent], columns=subjects.columns)
    of_study = groups(study.file, study.subjects)
    return people.assign(group=people["subject"].map(of_study)) if of_study else people
