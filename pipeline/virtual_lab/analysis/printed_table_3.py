"""Table III as the thesis prints it, and in which cells its compensation removed something."""

from importlib.resources import files
from typing import Final

import pandas as pd

from pipeline.virtual_lab.protocol.walking_protocol import ANALYSED_CONDITIONS

PRINTED: Final = "printed_table_3.csv"
"""The 36 cells as the thesis prints them: mean and standard deviation of nine subjects."""
THESIS_SUBJECTS: Final = 9
MAX_LEFT: Final = 0.5
"""Share of a residual that compensation leaves where it is said to have removed something: in the
thesis 4 to 22 % are left where the treadmill's inertia acts, 82 % or more elsewhere."""


def printed_cells() -> pd.DataFrame:
    """Give the 36 cells as the thesis prints them: axis, unit, condition, compensated, mean, sd."""
    with (files(__package__) / PRINTED).open(encoding="utf-8") as file:
        return pd.read_csv(file)


def removed(printed: pd.DataFrame) -> list[tuple[str, str]]:
    """Say in which residuals compensation removed something in the thesis.

    Parameters
    ----------
    printed
        As `printed_cells` gives it.

    Returns
    -------
    list
        Condition and axis where the mean with compensation is below `MAX_LEFT` of that without.
        Elsewhere the two rows of the table hardly differ.

    Examples
    --------
    >>> removed(printed_cells())
    [('sway', 'Fy'), ('sway', 'Mx'), ('sway', 'Mz'), ('pitch', 'Fx'), ('pitch', 'My')]
    """
    means = printed.pivot(index=["condition", "axis"], columns="compensated", values="mean")
    found = means.index[means[True] < MAX_LEFT * means[False]]
    return sorted(found, key=lambda cell: (ANALYSED_CONDITIONS.index(cell[0]), cell[1]))
