"""The report of a study: tables, statistics, figures and one page, from what `hbm run` left."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pipeline.config.study import Study, read_study
from pipeline.figures.style import save_figure
from pipeline.io.write import whole_file, write_csv, write_text
from pipeline.report.figures import study_figures
from pipeline.report.page import Report, write_page
from pipeline.report.windows import windows_sentence
from pipeline.run.failures import read_failures
from pipeline.run.load import collect, select_trials
from pipeline.run.provenance import provenance, trial_states
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import comparable
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.statistics.verdict import verdicts


def write_report(
    folder: Path,
    study_folder: Path | None = None,
    announce: Callable[[str], None] = lambda step: None,
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
    >>> pipeline.write_report(Path("results"))
    Traceback (most recent call last):
    ValueError: results: no results of trials here; run 'hbm run STUDY --out results'
    """
    study = read_study(study_folder) if study_folder is not None else None
    announce("collecting the trials")
    results = collect(folder)
    states = trial_states(results, read_failures(folder), study)
    results = select_trials(results, {(s.subject, s.condition) for s in states if s.in_tables})
    write_csv(results.residuals, folder / "residuals.csv")
    write_csv(results.by_cycle, folder / "cycles.csv")
    headline = results.residuals[results.residuals["headline"].astype(bool)]
    results = replace(results, residuals=headline.reset_index(drop=True))
    announce("computing statistics")
    results = replace(results, residuals=comparable(results.residuals))
    tests = statistics(results.residuals, _all_subjects(results.subjects, study))
    table = table_3(results.residuals, tests)

    write_csv(tests, folder / "statistics.csv")
    write_csv(table, folder / "table_3.csv")
    windows = windows_sentence(results.residuals)
    write_text(f"{table_3_markdown(table)}\n{windows}\n", folder / "table_3.md")
    with whole_file(folder / "cycles.parquet") as temporary:
        results.cycles.to_parquet(temporary, index=False, compression="zstd")
    if study is not None:
        announce("hashing the study's files")
    source = provenance(results, states, study)
    write_text(source.to_json(), folder / "study.json")

    figures = folder / "figures"
    for name, figure in study_figures(results, tests):
        announce(f"drawing {name}")
        save_figure(figure, figures / name)
    found = verdicts(results.residuals, tests)
    page = write_page(Report(results, tests, table, found, states, source, figures, study))
    write_text(page, folder / "report.html")
    return folder / "report.html"


def _all_subjects(subjects: pd.DataFrame, study: Study | None) -> pd.DataFrame:
    """Add the study's subjects without any result, so that the statistics name them too."""
    known = set(subjects["subject"])
    others = [
        person for name, person in (study.subjects if study else {}).items() if name not in known
    ]
    absent = [{"subject": p.id, "sex": p.sex, "height_m": p.height_m} for p in others]
    return pd.DataFrame([*subjects.to_dict("records"), *absent], columns=subjects.columns)
