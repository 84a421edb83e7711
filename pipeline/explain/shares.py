"""How much of the mean square of a residual each group of causes makes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array

INDISTINCT: Final = -0.5
"""Correlation of the shares of two groups, over all six residuals, below which they are named
together: what one has too much the other has too little."""
NORMAL_95: Final = 1.96
"""Half of a 95 % interval, in standard deviations."""
MIN_DOUBT: Final = 0.05
"""Standard deviation of a share below which it is not in doubt, and its group stands alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Shares:
    """Shares of the mean square of each axis.

    Attributes
    ----------
    share
        Of each of G groups, (G, 6); with `unexplained` they sum to 1. A group that works against
        the others has a negative share.
    covariance
        Between the shares of each axis, (6, G, G).
    unexplained
        What no group describes, (6,).
    """

    share: Array
    covariance: Array
    unexplained: Array

    @property
    def deviation(self) -> Array:
        """One standard deviation of each share, (G, 6)."""
        return np.asarray(np.sqrt(np.einsum("xgg->gx", self.covariance)))

    def joined(self, sets: Sequence[Sequence[int]]) -> "Shares":
        """Give the shares of sets of groups."""
        sums = np.zeros((len(sets), len(self.share)))
        for row, own in zip(sums, sets, strict=True):
            row[list(own)] = 1.0
        return Shares(sums @ self.share, sums @ self.covariance @ sums.T, self.unexplained)


def shares_of_groups(
    residual: Array,
    effects: Array,
    size: Array,
    covariance: Array,
    groups: Sequence[Sequence[int]],
) -> Shares:
    """Split the mean square of a residual among groups of causes.

    Parameters
    ----------
    residual
        At the frames that count, (T, 6) [N, N·m].
    effects
        What each cause adds per unit, (K, T, 6).
    size, covariance
        Sizes of the causes, (K,), and their covariance, (K, K).
    groups
        The causes of each group.

    Returns
    -------
    Shares
        Shapley values of the fall of the mean square when groups are taken away one after the
        other, over all orders: with ``r_g`` of group g, ``r_u`` of no group and ``r`` their sum,
        ``⟨r_g, r + r_u⟩ / ⟨r, r⟩``; and ``⟨r_u, r_u⟩ / ⟨r, r⟩`` is not explained. Their covariance
        is that of the sizes, to first order.

    Notes
    -----
    Taking group g away where the groups of S are gone lowers the mean square by
    ``2⟨r_g, r − r_S⟩ − ⟨r_g, r_g⟩``. Over all orders the mean of ``r_S`` is half of the sum of the
    other groups, which gives the above (Shapley 1953, Ann Math Stud 28:307).
    """
    member = np.zeros((len(groups), len(size)))
    for row, causes in zip(member, groups, strict=True):
        row[list(causes)] = size[list(causes)]
    inside = np.array([np.isin(np.arange(len(size)), causes) for causes in groups], float)
    share = np.empty((len(groups), 6))
    between = np.empty((6, len(groups), len(groups)))
    for axis in range(6):
        own, of_causes = residual[:, axis], effects[:, :, axis]
        square, gram = own @ own, of_causes @ of_causes.T
        with_rest = 2 * (of_causes @ own) - gram @ size
        share[:, axis] = member @ with_rest / square
        slope = (inside * with_rest - member @ gram) / square
        between[axis] = slope @ covariance @ slope.T
    return Shares(share, between, 1 - share.sum(axis=0))


def indistinct(shares: Shares, together: Sequence[Sequence[int]]) -> list[list[int]]:
    """Join groups that a trial cannot tell apart.

    Two are joined where what one has too much the other has too little, unless one of them is sure:
    its share's 95 % interval leaves out zero.

    Parameters
    ----------
    shares
        Of the groups.
    together
        Sets of groups that are named together anyway.

    Returns
    -------
    list of list of int
        The groups that are named together, in their order.
    """
    found = [list(own) for own in together]
    while len(found) > 1:
        own = shares.joined(found)
        covariance = own.covariance.mean(axis=0)
        spread = np.sqrt(np.diag(covariance))
        size = np.sqrt((own.share**2).mean(axis=1))
        unsure = np.where(size < NORMAL_95 * spread, spread, 0.0)
        doubted = np.minimum.outer(unsure, unsure) > MIN_DOUBT
        product = np.maximum(np.outer(spread, spread), MIN_DOUBT**2)
        correlation = np.where(doubted, covariance / product, 0.0)
        first, second = sorted(np.unravel_index(correlation.argmin(), correlation.shape))
        if correlation[first, second] > INDISTINCT:
            break
        found[first] = sorted(found[first] + found.pop(second))
    return found
