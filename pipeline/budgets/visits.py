"""A check of explanations on themselves: sizes from one trial of a visit in the others."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from joblib import delayed
from pydantic import TypeAdapter, ValidationError

from hbm.spatial import Array
from pipeline.budgets.explanation import Explanation
from pipeline.budgets.study import FOLDER, processed, up_to_date
from pipeline.budgets.words import shares_in_words
from pipeline.explain.budget import ByAxis
from pipeline.explain.other_trials import SHARED, mean_squares
from pipeline.io.write import write_text
from pipeline.run.job import Job
from pipeline.run.processes import in_processes

FILE: Final = "visits.json"
Sizes = Mapping[str, float]
"""Cause -> its size."""


@dataclass(frozen=True, slots=True)
class VisitCheck:
    """What causes that were found in one trial make of the other trials of the subject.

    Attributes
    ----------
    subject, condition
        The trial in which they were found.
    others
        Conditions of the other trials.
    share
        Share of the others' mean square that they take away, (6,); below zero they add to it.
    """

    subject: str
    condition: str
    others: tuple[str, ...]
    share: ByAxis

    def __str__(self) -> str:
        others = " and ".join(self.others)
        return (
            f"{self.subject}: causes of the laboratory and of the subject, as found in "
            f"{self.condition}, take away of the mean square in {others} "
            f"{shares_in_words(self.share)}"
        )


@dataclass(frozen=True, slots=True)
class _Stored:
    """The content of ``visits.json``."""

    key: str
    checks: tuple[VisitCheck, ...]


_JSON: Final = TypeAdapter(_Stored)


def check_visits(planned: Sequence[Job], folder: Path, jobs: int = 1) -> tuple[VisitCheck, ...]:
    """Take what is the same in all trials of a visit from one trial and judge it by the others.

    Parameters
    ----------
    planned
        The trials of a study (`pipeline.budgets.study.plan_explanations`), as far as possible
        explained.
    folder
        Results folder; ``explained/visits.json`` in it keeps what is found.
    jobs
        How many trials at a time.

    Returns
    -------
    tuple of VisitCheck
        Per explained trial of each subject that has several.
    """
    known = [(job, found) for job in planned if (found := up_to_date(job.target, job.key))]
    key = _key(found for _, found in known)
    stored = _stored(folder)
    if stored is None or stored.key != key:
        stored = _Stored(key, tuple(_checks(known, jobs)))
        write_text(_JSON.dump_json(stored, indent=1).decode(), folder / FOLDER / FILE)
    return stored.checks


def stored_checks(folder: Path, known: Iterable[Explanation]) -> tuple[VisitCheck, ...]:
    """Give what `check_visits` left in a results folder; nothing if it was of other trials."""
    stored = _stored(folder)
    return stored.checks if stored is not None and stored.key == _key(known) else ()


def _key(known: Iterable[Explanation]) -> str:
    return hashlib.sha256(" ".join(sorted(each.key for each in known)).encode()).hexdigest()


def _stored(folder: Path) -> _Stored | None:
    try:
        return _JSON.validate_json((folder / FOLDER / FILE).read_bytes())
    except (OSError, ValidationError):
        return None


def _checks(known: Sequence[tuple[Job, Explanation]], jobs: int) -> Iterator[VisitCheck]:
    """Compute what sizes from each trial take away of the subject's other trials."""
    sizes = {job.target: _shared_sizes(found) for job, found in known}
    visits: dict[str, list[Job]] = {}
    for job, _ in known:
        visits.setdefault(job.subject, []).append(job)
    several = [job for visit in visits.values() if len(visit) > 1 for job in visit]
    tasks = [
        delayed(_left)(job, {o.target: sizes[o.target] for o in visits[job.subject]})
        for job in several
    ]
    results = in_processes(tasks, max(1, min(jobs, len(tasks))), ordered=True)
    left = dict(zip([job.target for job in several], results, strict=True))
    for job in several:
        others = [o for o in visits[job.subject] if o.target != job.target and left[o.target]]
        if others:
            before = sum(left[other.target][None] for other in others)
            after = sum(left[other.target][job.target] for other in others)
            names = tuple(other.condition for other in others)
            yield VisitCheck(job.subject, job.condition, names, 1 - after / before)


def _shared_sizes(explanation: Explanation) -> dict[str, float]:
    causes = explanation.budget.causes
    return {cause.name: cause.size for cause in causes if cause.group in SHARED}


def _left(job: Job, sizes: Mapping[Path, Sizes]) -> dict[Path | None, Array]:
    """Give the mean square of a trial as it is (None) and by the trial that sizes are from.

    Empty where that fails.
    """
    try:
        squares = mean_squares(*processed(job), [*sizes.values()])
    except (OSError, ValueError):
        return {}
    return dict(zip([None, *sizes], squares, strict=True))
