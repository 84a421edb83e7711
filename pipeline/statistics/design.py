"""What is compared with what: the factors of a study, their levels, and the planned pairs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    import pandas as pd

COMPENSATION: Final = "IC"
"""Name of the factor inertia compensation; its levels are "no IC" and "IC"."""
MIN_SUBJECTS: Final = 2
"""A single subject has no variance."""
CONFIDENCE: Final = 0.95
"""Of all intervals."""
TAIL: Final = (1 - CONFIDENCE) / 2
"""Probability beyond either bound of an interval."""
ALPHA: Final = 0.05
"""Level of significance."""
Correction = Literal["bonferroni", "holm"]
Weigh = Literal["cycle", "recording"]
"""What is equal in a subject's value of a condition: each gait cycle, or each recording."""


@dataclass(frozen=True, slots=True)
class Design:
    """A repeated-measures design: condition, and compensation where there is any.

    Attributes
    ----------
    conditions
        Levels of the within-subject factor, in order.
    reference
        The level that the others are compared with.
    pairs
        Planned comparisons, each of two cells, first minus second.
    compensated
        Whether compensation is a second within-subject factor.
    factor
        Name of the first factor.
    correction
        Which correction for the number of planned pairs Table III shows.
    covariates
        Columns of the table of subjects that enter one further model together.
    margin
        Non-inferiority margin, as a fraction of the reference residual.
    group
        Column of the table of subjects with a between-subject factor; None without.
    weigh
        What is equal in a subject's value where there are several recordings.

    Examples
    --------
    >>> shoes = design_of(["barefoot", "boots"], compensated=False)
    >>> shoes.cells, shoes.pairs, shoes.factors
    (('barefoot', 'boots'), (('boots', 'barefoot'),), ('condition',))
    >>> EXPERIMENT_3.pairs[-1]
    ('pitch IC', 'baseline no IC')
    """

    conditions: tuple[str, ...]
    reference: str
    pairs: tuple[tuple[str, str], ...]
    compensated: bool = True
    factor: str = "condition"
    correction: Correction = "bonferroni"
    covariates: tuple[str, ...] = ("sex", "height_m")
    margin: float = 0.2
    group: str | None = None
    weigh: Weigh = "cycle"

    @property
    def variants(self) -> tuple[bool, ...]:
        """Plates as measured and, where there is compensation, compensated."""
        return (False, True) if self.compensated else (False,)

    @property
    def cells(self) -> tuple[str, ...]:
        """Names of all cells; the condition varies fastest."""
        return tuple(self.cell(c, variant) for variant in self.variants for c in self.conditions)

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the within-subject factors that have more than one level."""
        return (COMPENSATION,) * self.compensated + (self.factor,) * (len(self.conditions) > 1)

    @property
    def reference_cell(self) -> str:
        """The reference with the plates as measured."""
        return self.cell(self.reference, False)

    def cell(self, condition: str, compensated: bool) -> str:
        """Give the name of a cell, such as "sway IC"."""
        if not self.compensated:
            return condition
        return f"{condition} {COMPENSATION if compensated else f'no {COMPENSATION}'}"

    def cells_of(self, rows: "pd.DataFrame") -> list[str]:
        """Give the cell of each row of a table with condition and compensated."""
        keys = rows[["condition", "compensated"]].itertuples(index=False, name=None)
        return [self.cell(*key) for key in keys]

    def judged(self, condition: str) -> str:
        """Give the cell of a condition that is compared with the reference: compensated if any."""
        return self.cell(condition, self.compensated)

    @property
    def others(self) -> tuple[str, ...]:
        """All conditions but the reference."""
        return tuple(name for name in self.conditions if name != self.reference)

    def in_order(self, conditions: Iterable[str]) -> list[str]:
        """Give conditions once each: those of the design in its order, then the others by name."""
        rank = {name: k for k, name in enumerate(self.conditions)}
        return sorted(set(conditions), key=lambda name: (rank.get(name, len(rank)), name))

    def comparable(self, residuals: "pd.DataFrame") -> "pd.DataFrame":
        """Leave out spans of recordings where other trials to compare with count gait cycles.

        Parameters
        ----------
        residuals
            Long table with the columns condition and window ("span" where no gait cycles count).

        Returns
        -------
        pandas.DataFrame
            The same without spans in conditions of which another trial counts gait cycles; the
            conditions of the design are one in this respect.
        """
        is_of_design = residuals["condition"].isin(self.conditions)
        compared = residuals["condition"].where(~is_of_design, "design")
        walking = set(compared[residuals["window"] != "span"])
        return residuals[~((residuals["window"] == "span") & compared.isin(walking))]


def in_words(design: Design) -> str:
    """Say what a design compares.

    Examples
    --------
    >>> in_words(EXPERIMENT_3)
    'sway and pitch are compared with baseline, each with and without inertia compensation'
    >>> in_words(design_of(["barefoot", "boots"], compensated=False))
    'boots is compared with barefoot'
    >>> in_words(design_of(["walking"], compensated=False))
    'there is one condition and no compensation, so there is nothing to compare'
    """
    if not design.factors:
        return "there is one condition and no compensation, so there is nothing to compare"
    how = "with and without inertia compensation"
    if not design.others:
        return f"{design.reference} is compared {how}"
    *first, last = design.others
    names, verb = (f"{', '.join(first)} and {last}", "are") if first else (last, "is")
    both = f", each {how}" * design.compensated
    return f"{names} {verb} compared with {design.reference}{both}"


def design_of(
    conditions: Sequence[str], *, compensated: bool, reference: str | None = None
) -> Design:
    """Give the design of a study that states none.

    Parameters
    ----------
    conditions
        Its conditions, in order.
    compensated
        Whether its residuals were computed with compensation too.
    reference
        The condition that the others are compared with; None for the first.

    Returns
    -------
    Design
        Planned are the pairs of experiment 3: with against without compensation in every
        condition, and every other condition with compensation against the reference without.
        Without compensation, every other condition against the reference.

    Raises
    ------
    ValueError
        If there is no condition.
    """
    if not conditions:
        raise ValueError("a design needs at least one condition")
    reference = reference or conditions[0]
    bare = Design(tuple(conditions), reference, (), compensated)
    of_compensation = [(bare.cell(c, True), bare.cell(c, False)) for c in bare.conditions]
    of_reference = [(bare.judged(c), bare.reference_cell) for c in bare.others]
    pairs = (*of_compensation * compensated, *of_reference)
    return Design(bare.conditions, reference, pairs, compensated)


EXPERIMENT_3: Final = design_of(("baseline", "sway", "pitch"), compensated=True)
"""The 2 x 3 design of the thesis."""


def unstated_design(conditions: Iterable[str], *, compensated: bool) -> Design:
    """Give the design of a study from its conditions: experiment 3's if they are its, or more.

    Parameters
    ----------
    conditions
        The study's conditions in its order; experiment 3's reference goes first.
    compensated
        Whether the residuals were computed with compensation too.
    """
    ordered = sorted(dict.fromkeys(conditions), key=lambda name: name != EXPERIMENT_3.reference)
    if set(EXPERIMENT_3.conditions) <= set(ordered):
        ordered = [*EXPERIMENT_3.conditions]
    return design_of(ordered, compensated=compensated)
