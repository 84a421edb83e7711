"""The shares of causes in a trial's residuals, as a table of text."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from hbm.spatial import Array
from pipeline.budgets.words import group_name, size_in_words
from pipeline.explain.budget import Budget, GroupShare
from pipeline.explain.shares import NORMAL_95
from pipeline.trial.residuals import AXES, UNITS

CAPTION: Final = (
    "RMS with its 95 % interval of measurement; shares of the mean square in % ± 95 % interval. A "
    "negative share: without this cause the residual would be larger."
)


@dataclass(frozen=True, slots=True)
class BudgetTable:
    """A table of text.

    Attributes
    ----------
    title
        Which trial, and what of it.
    axes
        Heads of the rows: the residuals.
    columns
        Heads and cells of the others: the RMS, one for each group of causes, the rest.
    """

    title: str
    axes: tuple[str, ...]
    columns: tuple[tuple[str, tuple[str, ...]], ...]


def budget_table(budget: Budget) -> BudgetTable:
    """Lay out what a trial's residuals are made of.

    Parameters
    ----------
    budget
        Of a trial.

    Returns
    -------
    BudgetTable
        A row per residual; the measured RMS stands first.
    """
    plates = "compensated plates" if budget.compensated else "plates as measured"
    return BudgetTable(
        title=f"Pelvis residuals of {budget.source.name} and what they are made of, {plates}, "
        f"{_counts(budget)}",
        axes=tuple(f"{axis}, {unit}" for axis, unit in zip(AXES, UNITS, strict=True)),
        columns=(
            ("RMS", tuple(f"{value:.1f}" for value in budget.rms)),
            ("95 %", tuple(map(_interval, budget.low, budget.high))),
            *((_head(budget, group), tuple(_shares(group))) for group in budget.groups),
            ("not explained", tuple(f"{100 * share:z.0f}" for share in budget.unexplained)),
        ),
    )


def drawn_table(budget: Budget) -> BudgetTable:
    """Lay out how sure the RMS is by the delta method and by Monte Carlo, side by side.

    Raises
    ------
    ValueError
        If nothing was drawn.
    """
    drawn, delta = budget.drawn, budget.uncertainty[-1]
    if drawn is None:
        raise ValueError("nothing was drawn")

    def ones(values: Array) -> tuple[str, ...]:
        return tuple(f"{value:.1f}" for value in values)

    return BudgetTable(
        title=f"RMS if errors of usual size are added to those of the trial, {drawn.draws} draws",
        axes=tuple(f"{axis}, {unit}" for axis, unit in zip(AXES, UNITS, strict=True)),
        columns=(
            ("as measured", ones(delta.rms)),
            ("mean, delta method", ones(delta.mean)),
            ("mean, Monte Carlo", ones(drawn.mean)),
            ("SD, delta method", ones(delta.deviation)),
            ("SD, Monte Carlo", ones(drawn.deviation)),
            ("95 % of the draws", tuple(map(_interval, drawn.low, drawn.high))),
        ),
    )


def _counts(budget: Budget) -> str:
    if not budget.cycles:
        return "no gait cycles"
    return f"{budget.cycles} of {budget.found_cycles} gait cycles of one side"


def _interval(low: float, high: float) -> str:
    return f"{low:.1f}–{high:.1f}"


def _head(budget: Budget, group: GroupShare) -> str:
    """Name a group, with the size of its cause where it is only one."""
    name = group_name(group.groups)
    own = [cause for cause in budget.causes if cause.group in group.groups]
    return f"{name}: {size_in_words(own[0])}" if len(own) == 1 else name


def _shares(group: GroupShare) -> Iterator[str]:
    for share, deviation in zip(group.share, group.deviation, strict=True):
        half = 100 * NORMAL_95 * deviation
        text = f"{100 * share:z.0f}"
        yield f"{text} ± {half:.0f}" if half >= 0.5 else text
