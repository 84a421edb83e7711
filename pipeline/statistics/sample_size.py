"""How many subjects a non-inferiority test of paired differences needs."""

from math import sqrt
from typing import Final

from scipy import stats

POWER: Final = 0.8
"""By convention (Cohen 1988)."""
MAX_SUBJECTS: Final = 1000
"""No gait study has more; beyond, the answer is that it cannot be shown."""

MAX_NONCENTRALITY: Final = 1e3
"""The power is 1 long before; SciPy's noncentral t distribution becomes NaN beyond."""


def noninferiority_power(n: int, sd: float, room: float, alpha: float) -> float:
    """Give the probability that n subjects show a mean difference to be within the margin.

    Parameters
    ----------
    n
        Subjects, at least 2.
    sd
        Standard deviation of the paired differences between subjects.
    room
        Margin minus true mean difference, in the unit of `sd`.
    alpha
        Level of the one-sided test.

    Returns
    -------
    float
        Power of the one-sided paired t-test, from the noncentral t distribution.

    Examples
    --------
    >>> print(f"{noninferiority_power(9, sd=1.0, room=1.0, alpha=0.025):.3f}")
    0.748
    """
    noncentrality = min(room / sd * sqrt(n), MAX_NONCENTRALITY)
    return float(stats.nct.sf(stats.t.isf(alpha, n - 1), n - 1, noncentrality))


def subjects_needed(sd: float, room: float, alpha: float, power: float = POWER) -> int | None:
    """Give the smallest number of subjects that has the power wanted.

    Parameters
    ----------
    sd, room, alpha
        As for `noninferiority_power`.
    power
        The power wanted.

    Returns
    -------
    int or None
        None if even 1000 subjects have less, as where the true difference is beyond the margin.

    Notes
    -----
    Iterates on n, of which the critical value and the noncentrality both are functions (Julious
    2010, section 5.3). The margin is taken as known, though it is a share of an estimated
    reference.

    Examples
    --------
    >>> subjects_needed(sd=1.0, room=1.0, alpha=0.025)
    10
    """
    if room <= 0:
        return None
    if sd == 0:
        return 2
    few, many = 1, 2
    while noninferiority_power(many, sd, room, alpha) < power:
        if many >= MAX_SUBJECTS:
            return None
        few, many = many, min(2 * many, MAX_SUBJECTS)
    while many - few > 1:
        middle = (few + many) // 2
        enough = noninferiority_power(middle, sd, room, alpha) >= power
        few, many = (few, middle) if enough else (middle, many)
    return many
