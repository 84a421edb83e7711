"""One trial of a study as a job: its key, its processing, its outcome, why it failed."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from pydantic import TypeAdapter

from hbm.notes import Note
from pipeline.config.schema import Settings, Subject, TrialName
from pipeline.config.study import Study
from pipeline.io.input_file import describe_error, file_digest, last_written, read_text
from pipeline.io.qualisys import plate_files
from pipeline.io.write import write_text
from pipeline.run.program import computation_digest
from pipeline.run.store import FORMAT_VERSION, read_trial, write_trial
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.result import TrialResult

if TYPE_CHECKING:
    from pipeline.trial.chain import Chain

WORKER_DIED: Final = "the process that worked on it died; too little memory?"


@dataclass(frozen=True, slots=True)
class Job:
    """One trial of a study.

    Attributes
    ----------
    study, name
        The trial.
    target
        File of its result.
    key
        Digest of everything the result depends on (`trial_key`).
    variants
        The same trial with the settings of each variant: name -> job.
    """

    study: Study
    name: TrialName
    target: Path
    key: str
    variants: Mapping[str, "Job"] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Size of the recording [bytes]; 0 where there is none."""
        name = self.study.trial(self.name).file
        try:
            return self.study.path(name).stat().st_size if name else 0
        except OSError:
            return 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a job: processed, kept because its result was there already, or failed.

    With a result, also what to know of the calibration that it used, and variants that failed:
    name -> why.
    """

    job: Job
    state: Literal["done", "kept", "failed"]
    reason: str = ""
    of_calibration: tuple[Note, ...] = ()
    failed_variants: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        if self.failure is not None:
            return f"FAILED {self.job.name}: {self.reason}"
        failed = (f"; FAILED variant {name}: {why}" for name, why in self.failed_variants.items())
        return f"{self.state} {self.job.name}{''.join(failed)}"

    @property
    def trial(self) -> TrialName:
        """Subject, condition and recording."""
        return self.job.name

    @property
    def path(self) -> Path:
        """File of the result."""
        return self.job.target

    @property
    def failure(self) -> str | None:
        """Why the trial failed; None if it did not, though variants of it may have."""
        return self.reason if self.state == "failed" else None


def process_job(job: Job, laboratory: Laboratory | None = None) -> Outcome:
    """Process one trial and its variants and write results; failures become outcomes.

    Each result is written whole or not at all. Without a ``laboratory``, that of the study is read.
    What a variant has in common with the others is read and computed once.
    """
    outcome, chain = _process(job, laboratory, None)
    if outcome.failure is not None:
        return outcome
    failed = {}
    for name, variant in job.variants.items():
        alike = variant.study.file.treadmill == job.study.file.treadmill
        alike &= variant.study.file.plates == job.study.file.plates
        prepared = laboratory if chain is None else chain.inputs.laboratory
        of_variant, chain = _process(variant, prepared if alike else None, chain)
        with suppress(OSError):
            record_failure(variant.target, variant.name, of_variant.failure)
        if of_variant.failure is not None:
            failed[name] = of_variant.failure
        elif of_variant.state == "done":
            outcome = replace(outcome, state="done")
    return replace(outcome, failed_variants=failed)


def _process(
    job: Job, laboratory: Laboratory | None, like: "Chain | None"
) -> "tuple[Outcome, Chain | None]":
    """Process one trial as one study states it, like another chain of it; give its own."""
    from pipeline.trial.process import process_chain, trial_chain

    try:
        if (there := _stored(job)) is not None:
            return there, like
        chain = trial_chain(job.study, job.name, laboratory, like=like)
        result = process_chain(chain, job.study, job.name)
        if trial_key(job.study, job.name) != job.key:
            raise ValueError(
                "one of its files changed while it was processed, or this process has another "
                "version of the program or its libraries; run it again"
            )
        result = replace(result, key=job.key)
        write_trial(result, job.target)
    except Exception as error:
        return Outcome(job, "failed", describe_error(error)), like
    return _outcome(job, "done", result), chain


def stored_outcome(job: Job) -> Outcome | None:
    """Give what became of a job that was done before; None where a result is not up to date."""
    if any(_stored(variant) is None for variant in job.variants.values()):
        return None
    return _stored(job)


def _stored(job: Job) -> Outcome | None:
    """Give what became of a trial as one study states it."""
    stored = _stored_result(job)
    return None if stored is None or stored.key != job.key else _outcome(job, "kept", stored)


class _Stored(NamedTuple):
    """What of a stored result says whether it is up to date, and what became of it."""

    key: str
    shortage: str
    of_calibration: tuple[Note, ...]
    settings: Settings
    subject: Subject


def _stored_result(job: Job) -> _Stored | None:
    """Read the stored result of a job, once; None where there is none that can be read."""
    try:
        return _read_stored(job.target, last_written(job.target))
    except (OSError, ValueError):
        return None


@cache
def _read_stored(path: Path, version: tuple[int, int]) -> _Stored:
    """Read a result; the version changes when it is written anew."""
    result = read_trial(path, frames=False)
    return _Stored(*(getattr(result, name) for name in _Stored._fields))


def _outcome(job: Job, state: Literal["done", "kept"], result: _Stored | TrialResult) -> Outcome:
    """Give the outcome of a trial that is stored: failed where it has frames but no residuals."""
    if result.shortage:
        return Outcome(job, "failed", result.shortage)
    return Outcome(job, state, of_calibration=result.of_calibration)


def trial_key(study: Study, name: TrialName) -> str:
    """Give a digest of everything a trial's result depends on.

    Parameters
    ----------
    study
        The study.
    name
        Which trial.

    Returns
    -------
    str
        Digests of the contents of its files, of what the study states about it, and of the program:
        sources, libraries and engine that compute it, and the format in which it is stored.
    """
    person, trial = study.subject(name.subject), study.trial(name)
    treadmill = study.file.treadmill
    names = [trial.file, trial.forces, trial.record, *treadmill.files]
    names += [person.static, person.hip_trial, person.segments, study.file.plates.calibration]
    not_of_trials = {"name", "conditions", "comparison", "variants", "figures"}
    inputs = {
        "study": study.file.model_dump(exclude=not_of_trials),
        "trial": (name.recording, trial.session, trial.mend_plates, trial.rename),
        "condition": study.rule(name).model_dump(),
        "subject": person.person.model_dump(),
        "contacts": [contact.model_dump() for contact in trial.contacts],
        "marker_set": str(study.marker_set),
        "files": names,
    }
    program = computation_digest(), FORMAT_VERSION
    contents = [file_digest(study.path(name)) if name else None for name in names]
    unnamed = [plate_files(study.path(name)) for name in names if name]
    contents += [file_digest(file) for files in unnamed for file in files]
    parts = {"files": contents, "stated": inputs, "program": program}
    return " ".join(f"{name}:{_digest(part)}" for name, part in parts.items())


def _digest(value: object) -> str:
    text = json.dumps(value, sort_keys=True).encode()
    # of 16 digits two differ but for a chance of 1 in 10¹⁹
    return hashlib.sha256(text).hexdigest()[:16]


OTHER_PROGRAM: Final = "another version of the program or its libraries"
"""Results that it made are replaced without being asked for."""


def outdated(job: Job) -> str | None:
    """Say why a stored result is not up to date; None where it is, or there is none.

    An empty reason is that of a result without residuals, which is made again.
    """
    stored = _stored_result(job)
    if stored is None or stored.key == job.key:
        return None
    if not job.size or stored.shortage:
        return ""  # without its recording nothing will replace it
    before, now = (
        dict(part.split(":", 1) for part in key.split()) for key in (stored.key, job.key)
    )
    if all(before[part] == now[part] for part in ("files", "stated")):
        return OTHER_PROGRAM
    if before["stated"] == now["stated"]:
        return "its files have changed"
    person = job.study.subject(job.name.subject).person
    both = (stored.settings, job.study.file.settings), (stored.subject, person)
    changed = [
        f"{name} {value} → {getattr(new, name)}"
        for old, new in both
        for name, value in old
        if name != "id" and getattr(new, name) != value
    ]
    return ", ".join(changed) or "its settings in the study have changed"


FAILURES: Final = "failures.json"
"""Collected from one file per trial, for several runs may work on one folder at the same time."""
SUFFIX: Final = ".failed.json"
_REASONS: Final = TypeAdapter(dict[str, str])
"""Why trials failed, by their names."""


def record_failure(target: Path, name: TrialName, reason: str | None) -> None:
    """Store beside a result why the trial failed, or, without a reason, remove what is stored."""
    path = target.with_suffix(SUFFIX)
    if reason is None:
        path.unlink(missing_ok=True)
    else:
        write_text(json.dumps({str(name): reason}, ensure_ascii=False), path)


def collect_failures(out: Path, trials: Iterable[str]) -> dict[str, str]:
    """Write ``failures.json`` from what is stored next to the results: trial -> reason.

    Trials are "subject condition recording"; failures of others than the study's are removed.
    """
    names, failures = set(trials), dict[str, str]()
    for path, stored in recorded_failures(out / "trials"):
        if names.isdisjoint(stored):
            path.unlink(missing_ok=True)
        else:
            failures |= stored
    write_text(json.dumps(failures, indent=1, ensure_ascii=False), out / FAILURES)
    return failures


def recorded_failures(folder: Path) -> Iterator[tuple[Path, dict[str, str]]]:
    """Give the files of `record_failure` in a folder and what they say; damaged ones left out."""
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        with suppress(OSError, ValueError):
            yield path, _REASONS.validate_json(read_text(path))


def read_failures(folder: Path) -> dict[str, str]:
    """Read ``failures.json``; empty where there is none, a ValueError says that it is damaged."""
    path = folder / FAILURES
    try:
        return _REASONS.validate_json(read_text(path))
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise ValueError(f"{path} is damaged; run 'hbm run' again") from error
