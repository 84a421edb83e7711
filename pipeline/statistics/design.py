"""The 2 x 3 design of experiment 3, and one row of its table of statistics."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import nan

import pandas as pd

CONDITIONS = ("baseline", "sway", "pitch")
CELLS = tuple(f"{condition} {ic}" for ic in ("no IC", "IC") for condition in CONDITIONS)
"""Without and with inertia compensation (IC); the condition varies fastest."""
FACTORS = ("IC", "condition")
MIN_SUBJECTS = 2
"""A single subject has no variance."""
PLANNED_PAIRS = (
    ("baseline IC", "baseline no IC"),
    ("sway IC", "sway no IC"),
    ("pitch IC", "pitch no IC"),
    ("sway IC", "baseline no IC"),
    ("pitch IC", "baseline no IC"),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the table: a test, or an estimate, of one effect on one residual.

    Attributes
    ----------
    test, effect
        Name of the test and its effect: factors joined by colons, pairs as "first - second".
    statistic_name, statistic, df1, df2
        The test statistic and its degrees of freedom, with sphericity assumed.
    p_uncorrected, p_corrected, correction
        The p-value of the test alone, the one to report, and how it was corrected: "none",
        "Greenhouse-Geisser" where sphericity is rejected or cannot be tested, "Bonferroni x5" or
        "Holm x5" for the five planned pairs.
    epsilon
        Greenhouse–Geisser epsilon, whether applied or not.
    effect_size_name, effect_size, ci_low, ci_high
        Effect size, and its 95 % confidence interval where it has one.
    power
        Observed power, corrected as `p_corrected` is.
    n
        Subjects in this test.
    note
        Subjects left out, what could not be computed, and limitations of the test.
    """

    test: str
    effect: str
    statistic_name: str = ""
    statistic: float = nan
    df1: float = nan
    df2: float = nan
    p_uncorrected: float = nan
    p_corrected: float = nan
    correction: str = ""
    epsilon: float = nan
    effect_size_name: str = ""
    effect_size: float = nan
    ci_low: float = nan
    ci_high: float = nan
    power: float = nan
    n: int = 0
    note: str = ""


def in_order(conditions: Iterable[str]) -> list[str]:
    """Give conditions once each: those of the design in its order, then the others by name."""
    rank = {name: k for k, name in enumerate(CONDITIONS)}
    return sorted(set(conditions), key=lambda name: (rank.get(name, len(rank)), name))


def comparable(residuals: pd.DataFrame) -> pd.DataFrame:
    """Leave out spans of recordings where other trials to compare with count gait cycles.

    Parameters
    ----------
    residuals
        Long table with the columns condition and window ("cycle" or "span").

    Returns
    -------
    pandas.DataFrame
        The same without spans in conditions of which another trial counts gait cycles; the
        conditions of the design are one in this respect.
    """
    compared = residuals["condition"].where(~residuals["condition"].isin(CONDITIONS), "design")
    walking = set(compared[residuals["window"] == "cycle"])
    return residuals[~((residuals["window"] == "span") & compared.isin(walking))]


def complete_subjects(cells: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """Give the subjects (rows) who have all cells, and a note that names the others."""
    gaps = [
        f"{subject} (no {', '.join(cells.columns[gap])})"
        for subject, gap in zip(cells.index, cells.isna().to_numpy(), strict=True)
        if gap.any()
    ]
    return cells.dropna(), f"without {', '.join(gaps)}" if gaps else ""


def join_notes(*notes: str) -> str:
    """Join the notes that are not empty."""
    return "; ".join(note for note in notes if note)


def not_computed(test: str, effect: str, n: int, needed: int, missing: str) -> Row:
    """Give the row of a test that has too few complete subjects."""
    reason = f"not computed: needs at least {needed} complete subjects, got {n}"
    return Row(test, effect, n=n, note=join_notes(reason, missing))


def smallest_p_note(n: int, comparisons: int, alpha: float) -> str:
    """Give a note where an exact test of n subjects cannot become significant, else none."""
    smallest = min(1.0, comparisons * 2.0 ** (1 - n))
    return f"smallest possible p with {n} subjects: {smallest:.3g}" if smallest > alpha else ""
