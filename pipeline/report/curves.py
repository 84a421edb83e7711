"""Where curves over the gait cycle differ: residuals and joints of a study."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.figures.joints import LEG
from pipeline.report.figures import rms_over_cycles
from pipeline.report.joints import Cell, JointMeans
from pipeline.run.load import Curves
from pipeline.statistics.curves import (
    ComparedCurves,
    CurveComparison,
    compare_conditions,
    compare_groups,
)
from pipeline.statistics.design import Design
from pipeline.statistics.verdict import judged_conditions
from pipeline.trial.joints import CURVES
from pipeline.trial.residuals import AXES, UNITS

COLUMNS: Final = ("curve", "unit", "compared", "n", "start_percent", "stop_percent", "p")
BAND_COLUMNS: Final = ("curve", "unit", "compared", "percent", "difference", "low", "high", "p")


def compared_curves(
    cycles: Curves, joints: JointMeans, design: Design, people: pd.DataFrame
) -> ComparedCurves:
    """Compare the curves of conditions and of groups.

    Parameters
    ----------
    cycles
        Those of ``cycles.parquet``.
    joints
        The means of joint curves.
    design
        What is compared: conditions with the reference and, of joints, compensation with none.
    people
        Index subject: the design's group, and covariates that the study states.

    Returns
    -------
    Mapping
        "first - second" of conditions; "cell: group - group" and "first - second: group - group" of
        groups, each with the first in the alphabet.
    """
    reference, best = (design.reference, False), design.compensated
    judged: list[tuple[Cell, Cell]] = [((c, best), reference) for c in judged_conditions(design)]
    of_joints = [((name, True), (name, False)) for name in design.conditions if best]
    of_joints += [((name, best), (design.reference, best)) for name in design.others]
    over_cycles = rms_over_cycles(cycles, "cycle", within=("recording",))
    of_axes: dict[Any, pd.DataFrame] = {
        key: rows.set_index(["subject", "recording", "percent"])["value"].unstack("percent")
        for key, rows in over_cycles.groupby(["axis", "condition", "compensated"], observed=True)
    }
    compared = dict[tuple[str, str], CurveComparison]()
    for axis in AXES:
        of_axis = {(c, bool(ic)): of for (a, c, ic), of in of_axes.items() if a == axis}
        compared |= _of_one_curve(axis, of_axis, judged, design, people)
    for motion in LEG:
        for curve in CURVES:
            name = f"{motion.name}_{curve}"
            shown = {cell: of[name].unstack("percent") for cell, of in joints.of_recordings.items()}
            # plates do not change angles
            pairs = [(a, b) for a, b in of_joints if curve != "angle" or a[0] != b[0]]
            compared |= _of_one_curve(name, shown, pairs, design, people)
    return compared


def curve_tables(compared: ComparedCurves) -> dict[str, pd.DataFrame]:
    """Give the tables of comparisons: parts that differ, and bands with a row per percent."""
    units = dict(zip(AXES, UNITS, strict=True))
    units |= {f"{m.name}_{curve}": unit for m in LEG for curve, unit in CURVES.items()}
    parts, bands = list[tuple[object, ...]](), list[pd.DataFrame]()
    for (curve, cells), of in compared.items():
        key = curve, units[curve], cells
        parts += [(*key, of.subjects, part.start, part.stop, part.p) for part in of.parts]
        values = np.arange(len(of.p)), of.difference, of.low, of.high, of.p
        bands.append(pd.DataFrame(dict(zip(BAND_COLUMNS, (*key, *values), strict=True))))
    every_band = pd.concat(bands) if bands else pd.DataFrame(columns=BAND_COLUMNS)
    return {"curves": pd.DataFrame(parts, columns=COLUMNS), "curve_bands": every_band}


def _of_one_curve(
    curve: str,
    cells: Mapping[Cell, pd.DataFrame],
    pairs: list[tuple[Cell, Cell]],
    design: Design,
    people: pd.DataFrame,
) -> Iterator[tuple[tuple[str, str], CurveComparison]]:
    """Compare pairs of cells, and groups in each cell and pair."""
    between = people.drop(columns=design.group or [])
    groups = [] if design.group is None else sorted(people[design.group].dropna().unique())
    singles = {cell for pair in pairs for cell in pair}
    for compared in (*pairs, *((cell,) for cell in sorted(singles) if groups)):
        if not {*compared} <= {*cells}:
            continue
        label = " - ".join(design.cell(*cell) for cell in compared)
        curves, rows = _rows({cell: cells[cell] for cell in compared}, design)
        if len(compared) == 2:
            of_cells = compare_conditions(curves, rows, people)
            if of_cells is not None:
                yield (curve, label), of_cells
        for other in groups[1:]:
            two = people[design.group].where(people[design.group].isin((groups[0], other)))
            of_two = rows["subject"].map(two).notna().to_numpy()
            of_groups = compare_groups(curves[of_two], rows[of_two], two, between)
            if of_groups is not None:
                yield (curve, f"{label}: {other} - {groups[0]}"), of_groups


def _rows(cells: Mapping[Cell, pd.DataFrame], design: Design) -> tuple[Array, pd.DataFrame]:
    """Give the curves of recordings in some cells, and what they are of."""
    tables, rows = [], []
    for cell, table in cells.items():
        shown = table.dropna(how="all")
        tables.append(shown.to_numpy(float))
        recordings = shown.index.to_frame(index=False).astype(str)
        # one recording is in both cells where these differ by the compensation alone
        recordings["recording"] = f"{cell[0]} " + recordings["recording"]
        rows.append(recordings.assign(cell=design.cell(*cell)))
    return np.vstack(tables), pd.concat(rows, ignore_index=True)
