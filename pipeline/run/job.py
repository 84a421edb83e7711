"""One trial's work: a digest of all that goes into it, a result written whole or not at all."""

import hashlib
import json
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Final

from pipeline.config.study import Study

PACKAGES: Final = ("hbm", "compensation", "pipeline")
SOURCES: Final = {".py", ".c", ".h", ".csv", ".toml"}
DIED: Final = "the process that worked on it died; too little memory?"


@dataclass(frozen=True, slots=True)
class Job:
    """One trial of a study, where its result goes, and the digest of all that goes into it."""

    study: Study
    subject: str
    condition: str
    target: Path
    key: str

    @property
    def size(self) -> int:
        """Size of the recording [bytes]; 0 where there is none."""
        name = self.study.subjects[self.subject].trials[self.condition].file
        try:
            return self.study.path(name).stat().st_size if name else 0
        except OSError:
            return 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a trial: ``state`` is "done", "kept" (was there already) or "failed"."""

    job: Job
    state: str
    reason: str = ""


def process_job(job: Job) -> Outcome:
    """Process one trial and write its result whole or not at all; failures become outcomes."""
    from pipeline.run.store import write_trial
    from pipeline.trial.process import process_trial

    try:
        if stored_key(job.target) == job.key:
            return Outcome(job, "kept")
        result = process_trial(job.study, job.subject, job.condition)
        if trial_key(job.study, job.subject, job.condition) != job.key:
            raise ValueError(
                "a file of it changed while it was being processed, or this process has another "
                "version of the program or its libraries; run it again"
            )
        write_trial(result, job.condition, job.key, job.target)
    except Exception as error:
        return Outcome(job, "failed", said(error))
    return Outcome(job, "done")


def said(error: BaseException) -> str:
    """Say an error in one line; one that nobody foresaw with its type and where it arose."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, ValueError) and text:
        return text
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    name = Path(trace.tb_frame.f_code.co_filename).name if trace is not None else ""
    where = f" ({name}, line {trace.tb_lineno})" if trace is not None else ""
    return f"{type(error).__name__}: {text}{where}"


def trial_key(study: Study, subject: str, condition: str) -> str:
    """Give a digest of all that a trial's result depends on: files, statements, program."""
    person = study.subject(subject)
    trial = person.trials[condition]
    treadmill = study.file.treadmill
    names = [trial.file, trial.forces, trial.record, treadmill.calibration]
    names += [person.static, person.hip_trial, person.segments]
    names += [treadmill.belt.calibration] if treadmill.belt is not None else []
    stated = {
        "files": [file_digest(study.path(name)) if name else None for name in names],
        "study": study.file.model_dump(exclude={"name", "conditions"}),
        "condition": study.condition(condition).model_dump(),
        "subject": person.person.model_dump(),
        "marker_set": str(study.marker_set),
        "program": program_digest(),
    }
    return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """Give a file's SHA-256; a file that is gone has none, and the trial will say so."""
    try:
        written = path.stat()
        return _digest(path, written.st_mtime_ns, written.st_size)
    except OSError as error:
        return f"unreadable: {error.strerror}"


@lru_cache(maxsize=4096)
def _digest(path: Path, mtime_ns: int, size: int) -> str:
    """Hash a file once, until it is written to again."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def program_digest() -> str:
    """Give a digest of this program's own sources and its numerical libraries' versions."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in SOURCES:
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    for name in ("numpy", "scipy", "casadi"):
        digest.update(f"{name} {version(name)}".encode())
    return digest.hexdigest()


def stored_key(path: Path) -> str | None:
    """Give the key a trial's result was written with; None where there is no sound result."""
    from pipeline.run.store import read_summary

    try:
        return read_summary(path).key
    except (OSError, ValueError):
        return None
