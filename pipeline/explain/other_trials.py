"""Whether sizes of causes that were found in one trial hold in another."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.explain.cause import SHARED_WITHIN, CauseGroup
from pipeline.explain.explain import explained_part
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.result import TrialResult

SHARED: Final[frozenset[CauseGroup]] = frozenset(
    group
    for group, level in SHARED_WITHIN.items()
    if level in ("laboratory", "subject") and group != "compensation"
)
"""Groups of causes that are the same in all trials of a visit, by name: of what compensation
leaves, each trial has directions of its own."""


def mean_squares(
    recording: Recording,
    laboratory: Laboratory,
    result: TrialResult,
    sizes: Sequence[Mapping[str, float]],
) -> Array:
    """Compute what is left of a trial's residual once causes of some sizes are taken away.

    Parameters
    ----------
    recording, laboratory, result
        The trial, as for `pipeline.explain.explain.explain_trial`.
    sizes
        Per other trial: cause -> its size there. Causes that this trial does not have are left out.

    Returns
    -------
    Array
        Mean square of each residual over the explained frames, (1 + N, 6) [N², N²·m²]: as it is,
        and with the sizes of each of the N other trials taken away.

    Raises
    ------
    ValueError
        If no frame of the trial counts.
    """
    part = explained_part(recording, laboratory, result)
    chains = [part.chain]
    for known in sizes:
        chain = part.chain
        for cause in part.causes:
            if cause.group in SHARED and cause.name in known:
                chain = cause.change(chain, -known[cause.name])
        chains.append(chain)
    return np.stack([(chain.residual[part.counts] ** 2).mean(axis=0) for chain in chains])
