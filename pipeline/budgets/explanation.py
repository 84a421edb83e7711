"""Explanations of trials: files, a study's trials in parallel and resumable, errors of a study."""

import gzip
import hashlib
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ConfigDict, TypeAdapter, ValidationError

from hbm.kernels.native import kernels
from hbm.spelling import listed
from pipeline.budgets.words import Fix, budget_lines, study_lines, what_to_fix_first
from pipeline.config.schema import TrialName
from pipeline.config.study import Study, read_study
from pipeline.explain.budget import Bands, Budget, SharedCause, TrialEvidence
from pipeline.explain.explain import explain_trial
from pipeline.explain.joint import explain_together
from pipeline.io.input_file import MAX_BYTES, describe_error, open_file, read_text
from pipeline.io.recording import Recording
from pipeline.io.write import read_parquet, require_writable, whole_file, write_text
from pipeline.run.job import Job, Outcome, record_failure, recorded_failures, trial_key
from pipeline.run.processes import one_thread
from pipeline.run.program import explanation_digest
from pipeline.run.run import Announce, plan, work_on
from pipeline.run.store import number_column, read_trial, recorded_study_folder
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.residuals import AXES
from pipeline.trial.result import TrialResult
from pipeline.trial.study_files import read_study_file, read_study_laboratory

SUFFIX: Final = "_explained.json"
BANDS: Final = "_bands.parquet"
EVIDENCE: Final = "_evidence.json.gz"
STUDY: Final = "study.json"
FOLDER: Final = "explained"
"""In a results folder, beside ``trials``."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """What a trial's residuals are made of, and what follows from it.

    Attributes
    ----------
    key
        Digest of everything that it depends on; empty for a trial of no study.
    budget
        What they are made of.
    mending
        What is most worth mending.
    version
        Of the file; raised with every change of what it holds.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    key: str
    budget: Budget
    mending: tuple[Fix, ...]
    version: Literal[6] = 6

    def lines(self) -> Iterator[str]:
        """Say what a table of shares does not: sizes, what to mend, what is merged, the check."""
        return budget_lines(self.budget, self.mending)


@dataclass(frozen=True, slots=True)
class StudyExplanation:
    """The faults that the trials of a study show together.

    Attributes
    ----------
    key
        As that of an `Explanation`.
    trials
        Names of the trials.
    causes
        Delay and faults of the laboratory, of subjects and of trials.
    lines
        Those that are certain, and what to do.
    version
        As that of an `Explanation`.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    key: str
    trials: tuple[str, ...]
    causes: tuple[SharedCause, ...]
    lines: tuple[str, ...]
    version: Literal[6] = 6


ADAPTERS: Final[Mapping[type, TypeAdapter[Any]]] = {
    kind: TypeAdapter(kind) for kind in (Explanation, StudyExplanation)
}


def explain(
    recording: Recording, laboratory: Laboratory, result: TrialResult, key: str = ""
) -> Explanation:
    """Explain the residuals of a processed trial; parameters as for `explain_trial`."""
    budget = explain_trial(recording, laboratory, result)
    return Explanation(key, budget, what_to_fix_first(budget, result))


Explained = TypeVar("Explained", Explanation, StudyExplanation)


def write_explanation(explanation: Explained, path: Path) -> None:
    """Write an explanation as JSON, whole or not at all; numbers come back exactly."""
    write_text(ADAPTERS[type(explanation)].dump_json(explanation, indent=1).decode(), path)


def read_explanation(path: Path, kind: type[Explained]) -> Explained:
    """Read an explanation of a trial or of a study back.

    Raises
    ------
    ValueError
        If the file is damaged, or written by another version.
    OSError
        If it cannot be opened.
    """
    try:
        explained: Explained = ADAPTERS[kind].validate_json(read_text(path))
        return explained
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        why = f"{place}: {first['msg'].lower()}"
        raise ValueError(f"{path.name} is damaged or of another version of hbm: {why}") from error


def up_to_date(path: Path, key: str, kind: type[Explained]) -> Explained | None:
    """Read the explanation with a key; None where there is none, or it is damaged or older."""
    with suppress(OSError, ValueError):
        stored = read_explanation(path, kind)
        return stored if stored.key == key else None
    return None


def write_evidence(evidence: TrialEvidence, path: Path) -> None:
    """Write what a trial says of causes that others share, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_bytes(gzip.compress(TypeAdapter(TrialEvidence).dump_json(evidence), 6))


def read_evidence(path: Path) -> TrialEvidence:
    """Read what a trial says back; a ValueError if the file is damaged."""
    try:
        with open_file(path) as file, gzip.open(file) as content:
            return TypeAdapter(TrialEvidence).validate_json(content.read(MAX_BYTES))
    except (EOFError, zlib.error, gzip.BadGzipFile, ValidationError) as error:
        raise ValueError(
            f"{path.name} is damaged; delete it and run 'hbm explain' again"
        ) from error


def write_bands(bands: Bands, path: Path) -> None:
    """Write residuals over time: a row per frame, whole or not at all.

    Parameters
    ----------
    bands
        Of a trial.
    path
        The file. Its columns are ``time_s``; ``cycle``, the number of the gait cycle; and per axis,
        as reported, ``residual.Fx`` and ``deviation.Fx``, one standard deviation [N, N·m].
    """
    columns = {"time_s": bands.time, "cycle": bands.cycle}
    for name, values in (("residual", bands.residual), ("deviation", bands.deviation)):
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
    table = pa.table({name: number_column(values) for name, values in columns.items()})
    with whole_file(path) as temporary:
        pq.write_table(table, temporary)


def read_bands(path: Path) -> Bands:
    """Read residuals over time back; a ValueError or KeyError if the file is damaged."""
    table = read_parquet(path)
    residual, deviation = (
        table[[f"{name}.{axis}" for axis in AXES]].to_numpy() for name in ("residual", "deviation")
    )
    return Bands(table["time_s"].to_numpy(), table["cycle"].to_numpy(), residual, deviation)


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
    planned: list[Job], folder: Path, *, jobs: int | None = 1, announce: Announce = lambda _: None
) -> Iterator[Outcome]:
    """Explain the trials whose explanation is not there yet.

    Parameters
    ----------
    planned
        From `plan_explanations`.
    folder
        Results folder; explanations go to ``explained`` in it.
    jobs
        How many trials at a time; None: all processors, with 5 trials or more for each.
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
        if up_to_date(job.target, job.key, Explanation) and beside(job.target, EVIDENCE).is_file()
    }
    kept = (Outcome(job, "kept") for job in planned if job.target in ready)
    todo, laboratory = [job for job in planned if job.target not in ready], None
    if todo:
        with suppress(Exception), one_thread():  # what fails here fails again with each trial
            laboratory = read_study_laboratory(todo[0].study)
    explain_one = partial(explain_job, laboratory=laboratory)
    for outcome in chain(kept, work_on(todo, explain_one, jobs)):
        record_failure(outcome.job.target, outcome.job.name, outcome.failure)
        yield outcome


def beside(explanation: Path, suffix: str) -> Path:
    """Give the file of `BANDS` or `EVIDENCE` that belongs to an explanation's."""
    return explanation.with_name(f"{explanation.stem}{suffix}")


def explain_job(job: Job, laboratory: Laboratory | None = None) -> Outcome:
    """Explain one trial and write what was found; failures become outcomes.

    Without a ``laboratory``, that of the study is read.
    """
    try:
        recording, result = processed(job)
        explanation = explain(
            recording, laboratory or read_study_laboratory(job.study), result, job.key
        )
        if explanation.budget.bands and explanation.budget.evidence:
            write_bands(explanation.budget.bands, beside(job.target, BANDS))
            write_evidence(explanation.budget.evidence, beside(job.target, EVIDENCE))
        write_explanation(explanation, job.target)
    except Exception as error:
        return Outcome(job, "failed", describe_error(error))
    return Outcome(job, "done")


def processed(job: Job) -> tuple[Recording, TrialResult]:
    """Read the recording and the result of a trial.

    A ValueError where the result is missing or not up to date, or the recording is gone.
    """
    results = job.target.parent.parent
    path = results / "trials" / f"{job.target.stem}.parquet"
    again = f"hbm run {job.study.folder} --out {results}"
    try:
        result = read_trial(path)
    except FileNotFoundError:
        raise ValueError(f"it has no result; next: {again}") from None
    person, trial = job.study.subject(job.name.subject), job.study.trial(job.name)
    assert trial.file is not None  # it would not be planned
    if not job.study.path(trial.file).is_file():
        raise ValueError(
            f"the recording {trial.file} is missing, and only it shows the causes of residuals"
        )
    if result.key != trial_key(job.study, job.name):
        raise ValueError(f"its result is not up to date; next: {again} --overwrite")
    return read_study_file(job.study, trial.file, trial, person.static), result


def explain_study(folder: Path, planned: Sequence[Job]) -> StudyExplanation:
    """Explain all explained trials together and write ``explained/study.json``.

    Nothing is computed again where no trial has changed.
    """
    jobs = [job for job in planned if up_to_date(job.target, job.key, Explanation)]
    key, path = key_of_all(job.key for job in jobs), folder / FOLDER / STUDY
    if (there := up_to_date(path, key, StudyExplanation)) is not None:
        return there
    evidence, results = dict[str, TrialEvidence](), dict[str, TrialResult]()
    for job in jobs:
        stored = folder / "trials" / f"{job.target.stem}.parquet"
        results[str(job.name)] = read_trial(stored, frames=False)
        evidence[str(job.name)] = read_evidence(beside(job.target, EVIDENCE))
    with one_thread():
        causes = explain_together(evidence)
    explanation = StudyExplanation(key, (*results,), (*causes,), study_lines(causes, results))
    write_explanation(explanation, path)
    return explanation


def key_of_all(keys: Iterable[str]) -> str:
    """Give a digest of what an explanation of several trials depends on."""
    return explanation_key(" ".join(sorted(keys)))


def bands_of(result: Path, trial: TrialResult) -> Bands | None:
    """Give the residuals over time of a stored result; None where it is not explained as it is."""
    path = result.parent.parent / FOLDER / f"{result.stem}.json"
    if up_to_date(path, explanation_key(trial.key), Explanation) is not None:
        with suppress(OSError, ValueError, KeyError):
            return read_bands(beside(path, BANDS))
    return None


def explanation_of(folder: Path, trial: TrialResult) -> Explanation | None:
    """Give the explanation of a result of a folder by this program; None where there is none."""
    path = folder / FOLDER / f"{trial.name.stem}.json"
    return up_to_date(path, explanation_key(trial.key), Explanation)


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
    explained, others, reasons = dict[TrialName, Explanation](), list[str](), dict[str, str]()
    for _, failures in recorded_failures(folder / FOLDER):
        reasons |= failures
    for name, trial in trials.items():
        if explanation := explanation_of(folder, trial):
            explained[name] = explanation
        elif (folder / FOLDER / f"{name.stem}.json").is_file() and str(name) not in reasons:
            others.append(str(name))
    stale = (
        f"Not shown are the explanations of {listed(others)}: they are of other results or made by "
        "another version of hbm, or damaged; run 'hbm explain RESULTS'."
    )
    of_all = key_of_all(explanation.key for explanation in explained.values())
    together = up_to_date(folder / FOLDER / STUDY, of_all, StudyExplanation)
    return explained, reasons, together.lines if together else (), stale * bool(others)
