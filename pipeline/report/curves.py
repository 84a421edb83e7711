"""Where curves over the gait cycle differ: residuals and joints of a study."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from pipeline.figures.joints import LEG
from pipeline.report.joints import Cell, JointMeans
from pipeline.statistics.curves import curve_differences
from pipeline.statistics.design import Design
from pipeline.statistics.verdict import judged_conditions
from pipeline.trial.joints import CURVES
from pipeline.trial.residuals import AXES, UNITS

COLUMNS: Final = ("curve", "unit", "compared", "n", "start_percent", "stop_percent", "p")


def differing_curves(over_cycles: pd.DataFrame, joints: JointMeans, design: Design) -> pd.DataFrame:
    """Find the parts of the gait cycle that differ, as `curves.csv` holds them.

    Parameters
    ----------
    over_cycles
        As `rms_over_cycles` gives them.
    joints
        The means of joint curves.
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
    for axis, unit in zip(AXES, UNITS, strict=True):
        of_axis = over_cycles[over_cycles["axis"] == axis].groupby(
            ["condition", "compensated"], observed=True
        )
        of_cells = {key: own.set_index(["subject", "percent"])["value"] for key, own in of_axis}
        for cell in judged:
            rows += _rows(axis, unit, of_cells, (cell, reference), design)
    pairs = [((name, True), (name, False)) for name in design.conditions if design.compensated]
    pairs += [((name, best), (design.reference, best)) for name in design.others]
    compared = [cell for cell in joints.cells if any(cell in pair for pair in pairs)]
    for motion in LEG:
        for curve, unit in CURVES.items():
            name = f"{motion.name}_{curve}"
            of_cells = {cell: joints.of_subjects[cell][name] for cell in compared}
            for pair in pairs:
                if curve != "angle" or pair[0][0] != pair[1][0]:
                    rows += _rows(name, unit, of_cells, pair, design)
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(
    name: str,
    unit: str,
    of_cells: Mapping[Any, pd.Series],
    pair: tuple[Cell, Cell],
    design: Design,
) -> Iterator[tuple[object, ...]]:
    """Compare a curve of two cells over the subjects who have both."""
    if not {*pair} <= {*of_cells}:
        return
    first, second = (of_cells[cell].unstack("percent") for cell in pair)
    differences = (first - second).dropna(how="all")
    compared = " - ".join(design.cell(*cell) for cell in pair)
    for part in curve_differences(np.asarray(differences, float)):
        place = part.start, part.stop, part.p
        yield name, unit, compared, len(differences), *place
