"""Where curves over the gait cycle differ: residuals and joints of a study."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from pipeline.figures.joints import LEG
from pipeline.report.figures import rms_over_cycles
from pipeline.statistics.curves import curve_differences
from pipeline.statistics.design import Design
from pipeline.statistics.recordings import subject_means
from pipeline.statistics.verdict import judged_conditions
from pipeline.trial.joints import CURVES
from pipeline.trial.residuals import AXES, UNITS

COLUMNS: Final = ("curve", "unit", "compared", "n", "start_percent", "stop_percent", "p")
Cell = tuple[str, bool]
"""A condition, and whether its plates are compensated."""


def differing_curves(
    cycles: pd.DataFrame, joint_cycles: pd.DataFrame, design: Design
) -> pd.DataFrame:
    """Find the parts of the gait cycle that differ, as `curves.csv` holds them.

    Parameters
    ----------
    cycles, joint_cycles
        As those of `pipeline.run.load.Results`.
    design
        What is compared: conditions with the reference and, of joints, compensation with none.

    Returns
    -------
    pandas.DataFrame
        curve, such as Fx or hip_flexion_moment; unit; compared, "first - second"; n, the subjects
        with both; start_percent, stop_percent and the smallest p of each part that differs.
    """
    reference: Cell = (design.reference, False)
    best, rows = design.compensated, list[tuple[object, ...]]()
    judged: list[Cell] = [(name, best) for name in judged_conditions(design)]
    keys = ["condition", "compensated", "subject", "percent"]
    rms = rms_over_cycles(cycles, design.weigh).set_index(keys)
    for axis, unit in zip(AXES, UNITS, strict=True):
        values = rms.loc[rms["axis"] == axis, "value"].rename(axis)
        for cell in judged:
            rows += _rows(values, unit, cell, reference, design)
    pairs = [((name, True), (name, False)) for name in design.conditions if design.compensated]
    pairs += [((name, best), (design.reference, best)) for name in design.others]
    names = [f"{motion.name}_{curve}" for motion in LEG for curve in CURVES]
    means = subject_means(joint_cycles, names, design.weigh, of_sides=True)
    for motion in LEG:
        for curve, unit in CURVES.items():
            for first, second in pairs:
                if curve != "angle" or first[0] != second[0]:
                    rows += _rows(means[f"{motion.name}_{curve}"], unit, first, second, design)
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(
    means: pd.Series, unit: str, first: Cell, second: Cell, design: Design
) -> Iterator[tuple[object, ...]]:
    """Compare a curve of two cells over the subjects who have both."""
    of_cells = means.unstack("percent")
    cells = {key[:2] for key in of_cells.index}
    if not {first, second} <= cells:
        return
    differences = (of_cells.xs(first) - of_cells.xs(second)).dropna(how="all")
    compared = f"{design.cell(*first)} - {design.cell(*second)}"
    for part in curve_differences(np.asarray(differences, float)):
        place = part.start, part.stop, part.p
        yield means.name, unit, compared, len(differences), *place
