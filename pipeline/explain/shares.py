"""How much of the mean square of a residual each group of causes makes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.spatial import Array, read_only

DRAWS: Final = 1000
SEED: Final = 18
INDISTINCT: Final = -0.5
"""Correlation of the shares of two groups below which they are named together: what one has too
much the other has too little."""
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
    low, high
        Ends of the 95 % interval of each, (G, 6).
    unexplained
        What no group describes, (6,).
    draws
        Possible shares, (D, G, 6).
    """

    share: Array
    low: Array
    high: Array
    unexplained: Array
    draws: Array

    def __post_init__(self) -> None:
        for name in ("share", "low", "high", "unexplained", "draws"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


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
        ``⟨r_g, r + r_u⟩ / ⟨r, r⟩``; and ``⟨r_u, r_u⟩ / ⟨r, r⟩`` is not explained.

    Notes
    -----
    Taking group g away where the groups of S are gone lowers the mean square by
    ``2⟨r_g, r − r_S⟩ − ⟨r_g, r_g⟩``. Over all orders the mean of ``r_S`` is half of the sum of the
    other groups, which gives the above (Shapley 1953, Ann Math Stud 28:307).
    """
    rng = np.random.default_rng(SEED)
    drawn = rng.multivariate_normal(size, covariance, DRAWS, method="eigh")
    each = np.empty((1 + DRAWS, len(groups), 6))
    unexplained = np.empty(6)
    sizes = np.vstack([size, drawn])
    for axis in range(6):
        own, of_causes = residual[:, axis], effects[:, :, axis]
        square = own @ own
        gram, with_residual = of_causes @ of_causes.T, of_causes @ own
        sums = sizes @ gram
        for g, causes in enumerate(groups):
            inside = sizes[:, causes]
            each[:, g, axis] = inside @ (2 * with_residual[causes])
            each[:, g, axis] -= (inside * sums[:, causes]).sum(axis=1)
        each[:, :, axis] /= square
        unexplained[axis] = 1 - each[0, :, axis].sum()
    low, high = np.quantile(each[1:], [0.025, 0.975], axis=0)
    return Shares(each[0], low, high, unexplained, each[1:])


def indistinct(draws: Array) -> list[list[int]]:
    """Join groups that a trial cannot tell apart.

    Parameters
    ----------
    draws
        Possible shares of the groups, (D, G, 6).

    Returns
    -------
    list of list of int
        The groups that are named together, in their order; most alone.
    """
    found = [[g] for g in range(draws.shape[1])]
    while len(found) > 1:
        shares = np.stack([draws[:, own].sum(axis=1) for own in found])
        away = shares - shares.mean(axis=1, keepdims=True)
        products = np.einsum("adx,bdx->abx", away, away) / len(draws)
        spread = np.sqrt(np.einsum("aax->ax", products))
        doubted = np.minimum(spread[:, None], spread[None]) > MIN_DOUBT
        bound = np.maximum(spread[:, None] * spread[None], MIN_DOUBT**2)
        correlation = np.where(doubted, products / bound, 0.0).min(axis=2)
        first, second = sorted(np.unravel_index(correlation.argmin(), correlation.shape))
        if correlation[first, second] > INDISTINCT:
            break
        found[first] = sorted(found[first] + found.pop(second))
    return found
