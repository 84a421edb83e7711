"""What the residuals of single trials are made of, on the page of a report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.budgets.explanation import Explanation, explanation_lines
from pipeline.budgets.study import stale_sentence, unexplained
from pipeline.budgets.table import CAPTION, budget_table
from pipeline.budgets.visits import stored_checks
from pipeline.report.tables import Table
from pipeline.run.load import Results
from pipeline.statistics.design import Design


@dataclass(frozen=True, slots=True)
class TrialBudget:
    """What the residuals of a trial are made of.

    Attributes
    ----------
    name
        The trial, as "subject condition".
    table
        Shares of groups of causes.
    lines
        Sizes, what to mend, what cannot be told.
    """

    name: str
    table: Table
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BudgetSection:
    """What `hbm explain` found.

    Attributes
    ----------
    trials
        The trials that were explained.
    unexplained
        Those that could not be, with the reasons.
    visits
        What the causes from one trial make of the subject's others.
    stale
        Which explanations are not those of these results, if any.
    """

    trials: tuple[TrialBudget, ...]
    unexplained: tuple[str, ...]
    visits: tuple[str, ...]
    stale: str


def budget_section(
    results: Results, found: Mapping[tuple[str, str], Explanation], design: Design
) -> BudgetSection | None:
    """Show what the residuals of every trial are made of.

    Parameters
    ----------
    results
        The trials.
    found
        Their explanations, by subject and condition.
    design
        The order of the conditions.

    Returns
    -------
    BudgetSection or None
        In order of subject and condition; None where no trial was explained.
    """
    reasons = unexplained(results.folder)
    keys = _in_order(results.summaries, design)
    trials = tuple(_trial(" ".join(key), found[key]) for key in keys if key in found)
    failed = tuple(f"{name}: {reasons[name]}" for name in map(" ".join, keys) if name in reasons)
    visits = tuple(map(str, stored_checks(results.folder, found.values())))
    stale = stale_sentence(results.folder)
    return BudgetSection(trials, failed, visits, stale) if trials or failed or stale else None


def _in_order(
    trials: Mapping[tuple[str, str], object], design: Design
) -> Sequence[tuple[str, str]]:
    order = {name: k for k, name in enumerate(design.in_order(c for _, c in trials))}
    return sorted(trials, key=lambda key: (key[0], order[key[1]]))


def _trial(name: str, explanation: Explanation) -> TrialBudget:
    shown = budget_table(explanation.budget)
    heads, columns = zip(*shown.columns, strict=True)
    table = Table(
        caption=f"{name}: {shown.title}",
        heads=("Residual", *heads),
        rows=tuple(zip(shown.axes, *columns, strict=True)),
        css_class="budget",
        legend=CAPTION,
    )
    notes = (note.text for note in explanation.budget.notes)
    return TrialBudget(name, table, (*explanation_lines(explanation), *notes))
