"""Where curves over the gait cycle differ: residuals and joints of a study."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.figures.joints import LEG
from pipeline.report.joints import Cell, JointMeans
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


def compared_curves(
    over_cycles: pd.DataFrame, joints: JointMeans, design: Design, people: pd.DataFrame
) -> ComparedCurves:
    """Compare the curves of conditions and of groups.

    Parameters
    ----------
    over_cycles
        Of each recording, as `rms_over_cycles` gives them.
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
    people = people.where(people != "unspecified")
    reference, best = (design.reference, False), design.compensated
    judged: list[tuple[Cell, Cell]] = [((c, best), reference) for c in judged_conditions(design)]
    of_joints = [((name, True), (name, False)) for name in design.conditions if best]
    of_joints += [((name, best), (design.reference, best)) for name in design.others]
    keys = ["subject", "recording", "percent", "axis"]
    of_axes = dict[Cell, pd.DataFrame]()
    for (condition, ic), rows in over_cycles.groupby(["condition", "compensated"], observed=True):
        curves = rows.set_index(keys)["value"].unstack("axis").reindex(columns=[*AXES])
        of_axes[str(condition), bool(ic)] = _by_percent(curves, str(condition))
    of_cells = {cell: _by_percent(of, cell[0]) for cell, of in joints.of_recordings.items()}
    order = [*AXES, *(f"{motion.name}_{curve}" for motion in LEG for curve in CURVES)]
    angles = [name for name in order if name.endswith("_angle")]
    loads = [name for name in order if name not in (*AXES, *angles)]
    # plates do not change angles
    of_angles = [(first, second) for first, second in of_joints if first[0] != second[0]]
    every = {
        **dict(_of_cells(AXES, of_axes, judged, design, people)),
        **dict(_of_cells(angles, of_cells, of_angles, design, people)),
        **dict(_of_cells(loads, of_cells, of_joints, design, people)),
    }
    return {key: every[key] for key in sorted(every, key=lambda key: order.index(key[0]))}


def curve_tables(compared: ComparedCurves) -> dict[str, pd.DataFrame]:
    """Give the tables of comparisons: parts that differ, and bands with a row per percent."""
    units = dict(zip(AXES, UNITS, strict=True))
    units |= {f"{m.name}_{curve}": unit for m in LEG for curve, unit in CURVES.items()}
    columns = ("curve", "unit", "compared", "n", "start_percent", "stop_percent", "p")
    of_bands = ("curve", "unit", "compared", "percent", "difference", "low", "high", "p")
    parts, bands = list[tuple[object, ...]](), list[pd.DataFrame]()
    for (curve, cells), of in compared.items():
        key = curve, units[curve], cells
        parts += [(*key, of.subjects, part.start, part.stop, part.p) for part in of.parts]
        values = np.arange(len(of.p)), of.difference, of.low, of.high, of.p
        bands.append(pd.DataFrame(dict(zip(of_bands, (*key, *values), strict=True))))
    all_bands = pd.concat(bands) if bands else pd.DataFrame(columns=of_bands)
    return {"curves": pd.DataFrame(parts, columns=columns), "curve_bands": all_bands}


def _of_cells(
    names: Sequence[str],
    cells: Mapping[Cell, pd.DataFrame],
    pairs: list[tuple[Cell, Cell]],
    design: Design,
    people: pd.DataFrame,
) -> Iterator[tuple[tuple[str, str], CurveComparison]]:
    """Compare some curves of pairs of cells, and of groups in each cell and pair."""
    between = people.drop(columns=design.group or [])
    groups = [] if design.group is None else sorted(people[design.group].dropna().unique())
    singles = {cell for pair in pairs for cell in pair}
    singles = singles or {(design.reference, design.compensated)}
    for compared in (*pairs, *((cell,) for cell in sorted(singles) if groups)):
        if not {*compared} <= {*cells}:
            continue
        label = " - ".join(design.cell(*cell) for cell in compared)
        table = pd.concat({design.cell(*cell): cells[cell] for cell in compared}, names=["cell"])
        every = table.index.to_frame(index=False)
        for name in names:
            curves = table[name].to_numpy(float)
            is_known = ~np.isnan(curves).all(axis=1)
            curves, rows = curves[is_known], every[is_known].reset_index(drop=True)
            if rows["cell"].nunique() < len(compared):
                continue
            if len(compared) == 2:
                of_cells = compare_conditions(curves, rows, people)
                if of_cells is not None:
                    yield (name, label), of_cells
            for other in groups[1:]:
                two = people[design.group].where(people[design.group].isin((groups[0], other)))
                of_groups = compare_groups(curves, rows, two, between)
                if of_groups is not None:
                    yield (name, f"{label}: {other} - {groups[0]}"), of_groups


def _by_percent(curves: pd.DataFrame, condition: str) -> pd.DataFrame:
    """Give a row per recording, and a column per curve and percent.

    Recordings are named with their condition: one recording is in both cells where these differ by
    the compensation alone.
    """
    names = [(str(s), f"{condition} {r}", p) for s, r, p in curves.index]
    index = pd.MultiIndex.from_tuples(names, names=["subject", "recording", "percent"])
    return pd.DataFrame(curves.set_index(index).unstack("percent"))
