"""Covariances of values of a study by an error that they share."""

import numpy as np
import pandas as pd

from pipeline.statistics.measurement import CELL

WITHIN = {
    "laboratory": (),
    "subject": ("subject",),
    "trial": ("subject", "condition"),
    "sample": CELL,
}
"""Level -> what tells apart the values that have an error of their own."""


def covariances(table, level, change):
    """Give the covariance of each axis by an error that changes each value, the same in a level."""
    found = {}
    for axis, own in table.assign(change=change).groupby("axis", sort=False):
        changes = own["change"].to_numpy()
        keys = own[[*WITHIN[level]]].astype(str).agg("/".join, axis=1).to_numpy()
        shared = keys[:, None] == keys if WITHIN[level] else np.ones((len(own),) * 2, bool)
        cells = pd.MultiIndex.from_frame(own[[*CELL]])
        found[axis] = pd.DataFrame(np.outer(changes, changes) * shared, cells, cells)
    return found
