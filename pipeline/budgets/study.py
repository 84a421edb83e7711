"""What the residuals of a study's trials are made of: every trial once, in parallel, resumable."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Final

from hbm.kernels.native import kernels
from hbm.spelling import listed
from pipeline.budgets.explanation import (
    BANDS_SUFFIX,
    EVIDENCE_SUFFIX,
    FORMAT_VERSION,
    Explanation,
    StudyExplanation,
    explain,
    read_bands,
    read_evidence,
    read_explanation,
    write_bands,
    write_evidence,
    write_explanation,
)
from pipeline.budgets.words import StatedNow, study_lines
from pipeline.config.schema import TrialName
from pipeline.config.study import Study, read_study
from pipeline.explain.budget import Bands
from pipeline.explain.joint import explain_together
from pipeline.io.input_file import describe_error
from pipeline.io.recording import Recording
from pipeline.io.write import require_writable
from pipeline.run.job import (
    Job,
    Outcome,
    record_failure,
    recorded_failures,
    trial_key,
)
from pipeline.run.processes import one_thread
from pipeline.run.program import explanation_digest
from pipeline.run.run import Announce, plan, work_on
from pipeline.run.store import read_trial, recorded_study_folder
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.result import TrialResult
from pipeline.trial.study_files import read_study_file, read_study_laboratory

STUDY: Final = "study.json"
FOLDER: Final = "explained"
"""In a results folder, beside ``trials``."""


def study_of(folder: Path) -> Study:
    """Read the study that a results folder is of, recordings or not.

    Raises
    ------
    ValueError
        If it is no results folder, or its study is unknown or gone.
    StudyFaults
        If the study's files are at fault.
    """
    if not (folder / "trials").is_dir():
        if (folder / "study.toml").is_file():
            raise ValueError(
                f"{folder}: is a study; run it first, 'hbm run {folder}', and explain its results"
            )
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    where = recorded_study_folder(folder)
    if where is None:
        raise ValueError(
            f"{folder}: the study that these results are of is not known or gone, and only its "
            f"recordings show the causes of residuals; run 'hbm run STUDY --out {folder}' again"
        )
    return read_study(where, recordings=False)


def plan_explanations(study: Study, folder: Path) -> list[Job]:
    """List the trials of a study to explain, each with the file of its explanation and its key.

    The key is that of the trial's result as it is stored: an explanation stays right when a
    recording is gone.
    """
    jobs = []
    for job in plan(study, folder):
        try:
            key = read_trial(job.target, frames=False).key
        except (OSError, ValueError):
            key = job.key
        target = folder.resolve() / FOLDER / f"{job.target.stem}.json"
        jobs.append(replace(job, target=target, key=explanation_key(key)))
    return jobs


def explanation_key(trial: str) -> str:
    """Give a digest of what an explanation depends on, from the key of the trial's result."""
    return hashlib.sha256(f"{trial} {explanation_digest()}".encode()).hexdigest()


def explain_planned(
    planned: list[Job], folder: Path, *, jobs: int = 1, announce: Announce = lambda sentence: None
) -> Iterator[Outcome]:
    """Explain the trials whose explanation is not there yet.

    Parameters
    ----------
    planned
        From `plan_explanations`.
    folder
        Results folder; explanations go to ``explained`` in it.
    jobs
        How many trials at a time.
    announce
        Called with a sentence when something takes long.

    Yields
    ------
    Outcome
        As trials finish; first those that are explained already. A trial that cannot be explained
        stops no other; why is stored in place of its explanation.
    """
    require_writable(folder / FOLDER)
    kernels(announce)
    ready = {
        job.target
        for job in planned
        if up_to_date(job.target, job.key) and evidence_path(job.target).is_file()
    }
    kept = (Outcome(job, "kept") for job in planned if job.target in ready)
    todo = [job for job in planned if job.target not in ready]
    for outcome in chain(kept, work_on(todo, explain_job, jobs)):
        record_failure(outcome.job.target, outcome.job.name, outcome.failure)
        yield outcome


def up_to_date(path: Path, key: str) -> Explanation | None:
    """Read the explanation with a key; None where there is none, or it is damaged or older."""
    try:
        found = read_explanation(path, Explanation)
    except (OSError, ValueError):
        return None
    return found if found.key == key else None


def explain_study(study: Study, folder: Path, planned: Sequence[Job]) -> StudyExplanation:
    """Explain all explained trials together and write ``explained/study.json``.

    Nothing is computed again where no trial has changed.
    """
    jobs = {str(job.name): job for job in planned if up_to_date(job.target, job.key)}
    key = explanation_key(" ".join(sorted(job.key for job in jobs.values())))
    if (there := explained_study(folder, key)) is not None:
        return there
    calibrated = study.file.plates.calibration is not None
    trials = folder.resolve() / "trials"
    stated = {
        name: StatedNow.of(
            read_trial(trials / f"{job.name.stem}.parquet", frames=False), calibrated=calibrated
        )
        for name, job in jobs.items()
    }
    with one_thread():
        causes = explain_together(
            {name: read_evidence(evidence_path(job.target)) for name, job in jobs.items()}
        )
    lines = study_lines(causes, stated)
    found = StudyExplanation(FORMAT_VERSION, key, tuple(jobs), tuple(causes), lines)
    write_explanation(found, folder / FOLDER / STUDY)
    return found


def explained_study(folder: Path, key: str) -> StudyExplanation | None:
    """Read the explanation of all trials together with a key; None where there is none."""
    try:
        found = read_explanation(folder / FOLDER / STUDY, StudyExplanation)
    except (OSError, ValueError):
        return None
    return found if found.key == key else None


def explain_job(job: Job) -> Outcome:
    """Explain one trial and write what was found; failures become outcomes."""
    try:
        explanation = explain(*processed(job), job.key)
        if explanation.budget.bands:
            write_bands(explanation.budget.bands, bands_path(job.target))
        if explanation.budget.evidence:
            write_evidence(explanation.budget.evidence, evidence_path(job.target))
        write_explanation(explanation, job.target)
    except Exception as error:
        return Outcome(job, "failed", describe_error(error))
    return Outcome(job, "done")


def processed(job: Job) -> tuple[Recording, Laboratory, TrialResult]:
    """Read the recording, the laboratory and the result of a trial.

    A ValueError where the result is missing or not up to date, or the recording is gone.
    """
    path = job.target.parent.parent / "trials" / f"{job.target.stem}.parquet"
    try:
        result = read_trial(path)
    except FileNotFoundError:
        raise ValueError("it has no result; run 'hbm run' first") from None
    person, trial = job.study.subject(job.name.subject), job.study.trial(job.name)
    assert trial.file is not None  # it would not be planned
    if not job.study.path(trial.file).is_file():
        raise ValueError(
            f"the recording {trial.file} is missing, and only it shows the causes of residuals"
        )
    if result.key != trial_key(job.study, job.name):
        raise ValueError("its result is not up to date; run 'hbm run' first")
    recording = read_study_file(job.study, trial.file, trial, person.static)
    return recording, read_study_laboratory(job.study), result


def bands_path(explanation: Path) -> Path:
    """Give the file of residuals over time that belongs to an explanation's."""
    return explanation.with_name(f"{explanation.stem}{BANDS_SUFFIX}")


def evidence_path(explanation: Path) -> Path:
    """Give the file of what a trial says of causes that others share."""
    return explanation.with_name(f"{explanation.stem}{EVIDENCE_SUFFIX}")


def bands_of(result: Path, trial: TrialResult) -> Bands | None:
    """Give the residuals over time of a stored result; None where it is not explained as it is."""
    path = result.parent.parent / FOLDER / f"{result.stem}.json"
    if up_to_date(path, explanation_key(trial.key)) is not None:
        with suppress(OSError, ValueError):
            return read_bands(bands_path(path))
    return None


def explanations(
    folder: Path, trials: Mapping[TrialName, TrialResult]
) -> tuple[dict[TrialName, Explanation], dict[str, str], tuple[str, ...], str]:
    """Give what is known of the trials of a results folder, by their names.

    Returns
    -------
    explained
        The explanations of these results by this program.
    reasons
        "subject condition recording" -> why it could not be explained.
    lines
        What all of them show together, and what to do; empty where that is of other trials.
    stale
        Which explanations are of other results or programs, or damaged, and what makes them anew;
        empty where there are none.
    """
    explained, reasons, others = {}, dict[str, str](), []
    for _, own in recorded_failures(folder / FOLDER):
        reasons |= own
    for key, trial in trials.items():
        path, name = folder / FOLDER / f"{key.stem}.json", str(key)
        found = up_to_date(path, explanation_key(trial.key))
        if found is not None:
            explained[key] = found
        elif path.is_file() and name not in reasons:
            others.append(name)
    stale = (
        f"Not shown are the explanations of {listed(others)}: they are of other results or made by "
        "another version of hbm, or damaged; run 'hbm explain RESULTS'."
    )
    of_all = explanation_key(" ".join(sorted(own.key for own in explained.values())))
    together = explained_study(folder, of_all)
    lines = together.lines if together is not None else ()
    return explained, reasons, lines, stale * bool(others)
