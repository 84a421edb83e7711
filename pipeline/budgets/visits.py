"""A check of explanations on themselves: sizes from one trial of a visit in the others."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed

from hbm.spatial import Array
from pipeline.budgets.study import processed, up_to_date
from pipeline.explain.other_trials import SHARED, mean_squares
from pipeline.run.job import Job
from pipeline.run.processes import in_processes
from pipeline.trial.residuals import AXES

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
        shares = ", ".join(
            f"{100 * share:z.0f} % of {axis}" for axis, share in zip(AXES, self.share, strict=True)
        )
        return (
            f"{self.subject}: delay, gain and place of the plates and the body's masses from "
            f"{self.condition} take away of the mean square in {' and '.join(self.others)} {shares}"
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
    known = {job: sizes for job in planned if (sizes := shared_sizes(job)) is not None}
    pairs = {
        job: [each for each in known if each.subject == job.subject and each is not job]
        for job in known
    }
    tasks = [
        delayed(_left)(job, [known[each] for each in others])
        for job, others in pairs.items()
        if others
    ]
    judged = [job for job, others in pairs.items() if others]
    results = list(in_processes(tasks, max(1, min(jobs, len(tasks))), ordered=True))
    left = dict(zip(judged, results, strict=True))
    for job in judged:
        others = [each for each in pairs[job] if left[each] is not None]
        before = np.zeros(len(AXES))
        after = np.zeros(len(AXES))
        for each in others:
            before += left[each][0]
            after += left[each][1 + pairs[each].index(job)]
        if others:
            names = tuple(each.condition for each in others)
            yield VisitCheck(job.subject, job.condition, names, 1 - after / before)


def shared_sizes(job: Job) -> dict[str, float] | None:
    """Give the sizes in a trial of causes that others share; None where it is not explained."""
    explanation = up_to_date(job.target, job.key)
    if explanation is None:
        return None
    causes = explanation.budget.causes
    return {cause.name: cause.size for cause in causes if cause.group in SHARED}


def _left(job: Job, sizes: Sequence[Sizes]) -> Array | None:
    """Give what is left of a trial's mean square with each of some sizes; None where it fails."""
    try:
        return mean_squares(*processed(job), sizes)
    except (OSError, ValueError):
        return None
