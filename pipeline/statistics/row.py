"""One row of the table of statistics, and what its notes say."""

from dataclasses import dataclass
from math import nan

import pandas as pd


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
        "Holm x5" for five planned pairs.
    epsilon, epsilon_hf
        Greenhouse–Geisser and Huynh–Feldt epsilon, whether applied or not.
    effect_size_name, effect_size, ci_low, ci_high
        Effect size, and its 95 % confidence interval where it has one.
    power
        Observed power; it and the interval of an F test are corrected as `p_corrected` is.
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
    epsilon_hf: float = nan
    effect_size_name: str = ""
    effect_size: float = nan
    ci_low: float = nan
    ci_high: float = nan
    power: float = nan
    n: int = 0
    note: str = ""


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
