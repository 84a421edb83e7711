"""Where curves over the gait cycle differ: residuals and joints of a study."""

from collections.abc import Iterator
from typing import Final

import pandas as pd

from pipeline.figures.joints import LEG
from pipeline.report.figures import rms_over_cycles
from pipeline.statistics.curves import curve_differences
from pipeline.statistics.design import Design
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
    own = rms_over_cycles(cycles, design.weigh)
    for axis, unit in zip(AXES, UNITS, strict=True):
        values = own[own["axis"] == axis].rename(columns={"value": axis})
        for cell in judged:
            rows += _rows(values, axis, unit, cell, reference, design)
    pairs = [((name, True), (name, False)) for name in design.conditions if design.compensated]
    pairs += [((name, best), (design.reference, best)) for name in design.others]
    means = joint_cycles.groupby(["subject", "condition", "compensated", "percent"], sort=False)
    every = means[[f"{m.name}_{curve}" for m in LEG for curve in CURVES]].mean().reset_index()
    for motion in LEG:
        for curve, unit in CURVES.items():
            for first, second in pairs:
                if curve != "angle" or first[0] != second[0]:
                    name = f"{motion.name}_{curve}"
                    rows += _rows(every, name, unit, first, second, design)
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(
    cycles: pd.DataFrame, column: str, unit: str, first: Cell, second: Cell, design: Design
) -> Iterator[tuple[object, ...]]:
    """Compare a curve of two cells over the subjects who have both."""
    mean = [
        cycles[(cycles["condition"] == condition) & (cycles["compensated"] == compensated)]
        .groupby(["subject", "percent"])[column]
        .mean()
        .unstack("percent")
        for condition, compensated in (first, second)
    ]
    differences = (mean[0] - mean[1]).dropna(how="all")
    compared = f"{design.cell(*first)} - {design.cell(*second)}"
    for part in curve_differences(differences.to_numpy(float)):
        place = part.start, part.stop, part.p
        yield column, unit, compared, len(differences), *place
