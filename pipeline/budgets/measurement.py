"""How errors of measurement vary together in a study's residuals."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.budgets.explanation import Explanation
from pipeline.config.schema import NOUNS, TrialName
from pipeline.statistics.design import Weigh
from pipeline.statistics.measurement import CELL, Covariances
from pipeline.statistics.recordings import recording_weights, root_mean_square
from pipeline.trial.residuals import AXES


def study_covariances(
    explained: Mapping[TrialName, Explanation], residuals: pd.DataFrame, weigh: Weigh = "cycle"
) -> tuple[Covariances | None, str]:
    """Give how errors of measurement vary together in a study's residuals.

    Parameters
    ----------
    explained
        Explanations of its trials.
    residuals
        Long table of RMS residuals, one row per recording and axis, each of the window that its
        condition asks for.

    Returns
    -------
    covariances
        Over draws of causes' sizes, which are the same in all trials that share them; None unless
        every trial of the table is explained, over the window that its residuals are of.
    missing
        Why there are none, and what adds them; empty where there are.
    """
    once = residuals.drop_duplicates([*TrialName._fields])
    names = [TrialName(*key) for key in once[[*TrialName._fields]].itertuples(index=False)]
    cells: dict[tuple[str, str, bool], list[tuple[Array, float]]] = {}
    count = 0
    for name, window, weight in zip(
        names, once["window"], recording_weights(once, weigh), strict=True
    ):
        budget = explained[name].budget if name in explained else None
        if budget is None or (window not in (*NOUNS, "span") and not budget.of_window):
            continue
        count += 1
        for uncertain in budget.of_window or budget.uncertainty:
            cell = name.subject, name.condition, uncertain.compensated
            cells.setdefault(cell, []).append((uncertain.draws, weight))
    if count < len(once) or not cells:
        some = f"; {count} of {len(once)} trials are explained" * (count > 0)
        return None, f"'hbm explain RESULTS' adds intervals of measurement{some}." * bool(len(once))
    draws = {}
    for cell, recordings in sorted(cells.items()):
        of_each, weights = zip(*recordings, strict=True)
        draws[cell] = root_mean_square(np.stack(of_each), np.array(weights))
    index = pd.MultiIndex.from_tuples(draws, names=CELL)
    of_axes = np.stack(list(draws.values()), axis=2).swapaxes(0, 1)
    covariances = {
        axis: pd.DataFrame(np.atleast_2d(np.cov(of_axis, rowvar=False)), index, index)
        for axis, of_axis in zip(AXES, of_axes, strict=True)
    }
    return covariances, ""
