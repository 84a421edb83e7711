"""A check of explanations on themselves: sizes from one trial of a visit in the others."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from joblib import delayed

from hbm.spatial import Array
from pipeline.budgets.study import processed, up_to_date
from pipeline.budgets.words import shares_in_words
from pipeline.explain.other_trials import SHARED, mean_squares
from pipeline.run.job import Job
from pipeline.run.processes import in_processes

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
    share: Array

    def __str__(self) -> str:
        return (
            f"{self.subject}: delay, gain and place of the plates and the body's masses from "
            f"{self.condition} take away of the mean square in {' and '.join(self.others)} "
            f"{shares_in_words(self.share)}"
        )


def check_visits(planned: Sequence[Job], jobs: int = 1) -> Iterator[VisitCheck]:
    """Take what is the same in all trials of a visit from one trial and judge it by the others.

    Parameters
    ----------
    planned
        The trials of a study (`pipeline.budgets.study.plan_explanations`), as far as possible
        explained.
    jobs
        How many trials at a time.

    Yields
    ------
    VisitCheck
        Per explained trial of each subject that has several.
    """
    known = {job.target: sizes for job in planned if (sizes := shared_sizes(job)) is not None}
    explained = [job for job in planned if job.target in known]
    others = {
        job.target: [o for o in explained if o.subject == job.subject and o.target != job.target]
        for job in explained
    }
    judged = [job for job in explained if others[job.target]]
    tasks = [
        delayed(_left)(job, {other.target: known[other.target] for other in others[job.target]})
        for job in judged
    ]
    results = in_processes(tasks, max(1, min(jobs, len(tasks))), ordered=True)
    left = dict(zip([job.target for job in judged], results, strict=True))
    for job in judged:
        known_others = [other for other in others[job.target] if left[other.target]]
        squares = [left[other.target] for other in known_others]
        if squares:
            before = sum(own[None] for own in squares)
            after = sum(own[job.target] for own in squares)
            names = tuple(other.condition for other in known_others)
            yield VisitCheck(job.subject, job.condition, names, 1 - after / before)


def shared_sizes(job: Job) -> dict[str, float] | None:
    """Give the sizes in a trial of causes that others share; None where it is not explained."""
    explanation = up_to_date(job.target, job.key)
    if explanation is None:
        return None
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
