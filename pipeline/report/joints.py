"""Joints of a study: their curves, and what the compensation changes in their peaks."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import nan
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.figures.joints import LEG, UPPER_BODY, Curve, joint_figure
from pipeline.figures.style import condition_style
from pipeline.report.blocks import Table
from pipeline.report.figures import DIFFERENCE, VARIANTS, by_label, difference_title, file_names
from pipeline.report.tables import numbers
from pipeline.run.load import Curves
from pipeline.statistics.curves import ComparedCurves, CurveComparison, CurveDifference
from pipeline.statistics.design import MIN_SUBJECTS, Design, Weigh
from pipeline.statistics.paired import compare_paired
from pipeline.statistics.recordings import subject_means
from pipeline.statistics.table_3 import number
from pipeline.trial.joints import CURVE_COLUMNS, CURVES, JOINT_MOTIONS

LIMITS: Final = read_numbers("pipeline.report", "thresholds.toml", "joints")
PEAKS: Final = ("largest moment", "smallest moment")
Cell = tuple[str, bool]
"""A condition, and whether its plates are compensated."""


def subject_values(joints: pd.DataFrame, weigh: Weigh) -> pd.DataFrame:
    """Average the values of `joint_tables` over recordings, then over sides of each subject.

    Over recordings by gait cycles, or each equal. Rows: subject, condition, compensated, joint,
    direction, quantity, unit; value, n_cycles.
    """
    keys = ["subject", "condition", "compensated", "joint", "direction", "quantity", "unit"]
    weight = joints["n_cycles"] if weigh == "cycle" else 1.0
    weighted = joints.assign(weight=weight, weighted=joints["value"] * weight)
    columns = ["weighted", "weight", "n_cycles"]
    of_side = weighted.groupby([*keys, "side"], sort=False)[columns].sum().reset_index()
    of_side["value"] = of_side["weighted"] / of_side["weight"]
    # both sides count alike, however many cycles each has
    how = {"value": "mean", "n_cycles": "sum"}
    return of_side.groupby(keys, sort=False).agg(how).reset_index()


def compensation_tables(joints: pd.DataFrame, design: Design) -> list[Table]:
    """Say what the compensation changes in the peaks of leg moments, a table per condition."""
    values = subject_values(joints, design.weigh)
    leg = [(motion.joint, motion.direction) for motion in LEG]
    tables = []
    for condition in design.in_order(values["condition"].unique()):
        peaks = values[(values["condition"] == condition) & values["quantity"].isin(PEAKS)]
        peak = ["joint", "direction", "quantity"]
        cells = peaks.pivot_table("value", [*peak, "subject"], "compensated")
        if len(cells.columns) < 2:  # without and with compensation
            continue
        pairs = {key: pair.to_numpy(float) for key, pair in cells.dropna().groupby(peak)}
        rows = [
            (f"{' '.join(motion)}, {quantity}", *_change(pairs[*motion, quantity]))
            for motion in leg
            for quantity in PEAKS
            if np.abs(pairs.get((*motion, quantity), 0.0)).max() >= LIMITS.least_peak
        ]
        heads = ("Moment (N·m/kg)", "no IC", "IC", "IC − no IC [95 % CI]", "of the peak")
        count = peaks["subject"].nunique()
        caption = f"What compensation changes, {condition}: means over {count} subject"
        tables.append(Table(caption + "s" * (count > 1), heads, rows, "numbers"))
    return tables


def _change(pair: Array) -> tuple[str, str, str, str]:
    """Give the means of a peak without and with compensation, and its change with interval.

    Of subjects, (N, 2).
    """
    before, after = pair.T
    change = float((after - before).mean())
    text = number(change, "+z.3f")
    if len(pair) >= MIN_SUBJECTS:
        mean = compare_paired(after - before).mean
        text += f"\n[{number(mean.low, '+z.3f')} to {number(mean.high, '+z.3f')}]"
    means = before.mean(), after.mean()
    # of the peak's size, whichever its sign; of a peak that changes its sign, none
    percent = 100 * (means[1] / means[0] - 1) if means[0] * means[1] > 0 else nan
    first, second = (number(mean, "z.2f") for mean in means)
    return first, second, text, number(percent, "+z.1f", " %")


class JointMeans:
    """Means over the gait cycles of joint curves.

    Attributes
    ----------
    cells
        Conditions, each with whether its plates are compensated.
    subjects
        Condition -> number of subjects.
    of_recordings
        Cell -> means over gait cycles and sides: subject, recording and percent -> each of
        `CURVE_COLUMNS`. NaN where most of the cell's cycles are unknown: means of the few others
        are of other steps.
    mean_and_spread
        Cell -> mean and SD over subjects, or over cycles of a single one, (101, 13, 3) each; NaN
        alike.
    """

    def __init__(self, cycles: Curves, weigh: Weigh) -> None:
        keys = cycles.read(["subject", "condition", "compensated"])
        rows = keys.groupby(["condition", "compensated"], observed=True).size()
        self.cells: list[Cell] = [*rows.index]
        self.subjects = keys.groupby("condition", sort=False, observed=True)["subject"].nunique()
        self.of_recordings: dict[Cell, pd.DataFrame] = {}
        self.mean_and_spread: dict[Cell, list[Array]] = {}
        for cell, count in zip(self.cells, rows, strict=True):
            # some columns at a time: 100 million values are 400 MB of memory
            parts = np.array_split(CURVE_COLUMNS, -(-count * len(CURVE_COLUMNS) // 10**8))
            averages = [_averaged(cycles, cell, [*names], weigh) for names in parts]
            means, *curves = (pd.concat(tables, axis=1) for tables in zip(*averages, strict=True))
            self.of_recordings[cell] = means.droplevel(["condition", "compensated"])
            shape = -1, len(JOINT_MOTIONS), len(CURVES)
            self.mean_and_spread[cell] = [table.to_numpy(float).reshape(shape) for table in curves]


def _averaged(
    cycles: Curves, cell: Cell, names: Sequence[str], weigh: Weigh
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Give the means of recordings in some columns, and mean and SD over subjects."""
    keys = ["subject", "condition", "recording", "compensated", "side", "percent"]
    shown = cycles.read([*keys, *names], condition=cell[0], compensated=cell[1])
    of_recordings = subject_means(shown, names, "cycle", within=["recording"], of_sides=True)
    means = of_recordings.droplevel("recording")
    if not means.index.is_unique:
        means = subject_means(shown, names, weigh, of_sides=True)
    of_one = shown["subject"].nunique() == 1
    of_percent = (shown if of_one else means).groupby("percent", sort=True)[[*names]]
    # where most cycles are unknown, the mean would be of the few others alone
    fraction = shown[[*names]].notna().groupby(shown["percent"]).mean()
    is_known = fraction >= LIMITS.least_known
    at_percent = is_known.reindex(of_recordings.index.get_level_values("percent")).to_numpy()
    of_recordings = of_recordings.where(at_percent)
    return of_recordings, of_percent.mean().where(is_known), of_percent.std().where(is_known)


def joint_figures(
    means: JointMeans, design: Design, compared: ComparedCurves
) -> Iterator[tuple[str, Callable[..., Figure]]]:
    """Give the figures of joints, of each condition without and with compensation, and of all.

    Any process can draw them.

    ``compared`` is as `pipeline.report.curves.compared_curves` gives it.

    Yields
    ------
    name, draw
        ``joints_CONDITION``, ``joints`` and ``upper_body`` of all conditions, and
        ``joints_difference_COMPARED``.
    """
    people = means.subjects
    conditions = design.in_order(people.index)

    def over(counts: pd.Series) -> str:
        return numbers(counts, "subject") if counts.max() > 1 else "gait cycles"

    best = any(compensated for _, compensated in means.cells)
    by_name = by_label(compared, CURVE_COLUMNS)
    for condition in conditions if best else ():
        drawn: list[Curve] = []
        for compensated, variant in VARIANTS.items():
            if (condition, compensated) in means.mean_and_spread:
                look = variant.label, variant.colour, variant.line
                mean, spread = means.mean_and_spread[condition, compensated]
                drawn.append((*look, mean, spread))
        title = f"Joints of the legs, {condition}: mean ± SD over {over(people[[condition]])}"
        label = f"{design.cell(condition, True)} - {design.cell(condition, False)}"
        parts = _parts(by_name.get(label, {}))
        title += "; bars: IC differs from no IC" * any(parts.values())
        yield f"joints_{condition}", partial(joint_figure, drawn, title, differing=parts)
    together: list[Curve] = [
        (name, *condition_style(k), *means.mean_and_spread[name, best])
        for k, name in enumerate(conditions)
        if (name, best) in means.mean_and_spread
    ]
    for name, motions in (("joints", LEG), ("upper_body", UPPER_BODY)):
        what = "Joints of the legs" if motions == LEG else "Trunk and arms"
        what += ", with inertia compensation" * best
        title = f"{what}: mean ± SD over {over(people)}"
        yield name, partial(joint_figure, together, title, motions)
    for (label, of_curves), file in zip(by_name.items(), file_names(by_name), strict=True):
        nothing = np.full(101, np.nan)
        unknown = CurveComparison(nothing, nothing, nothing, nothing, (), 0)
        shown = [of_curves.get(name, unknown) for name in CURVE_COLUMNS]
        shape = -1, len(JOINT_MOTIONS), len(CURVES)
        difference = np.stack([of.difference for of in shown], axis=1).reshape(shape)
        half = np.stack([of.high for of in shown], axis=1).reshape(shape) - difference
        title = f"Joints of the legs, {difference_title(label, of_curves)}"
        drawn = [("", DIFFERENCE, "-", difference, half)]
        kinds = [kind for kind in CURVES if any(name.endswith(kind) for name in of_curves)]
        gaps = "; gaps: known of too few subjects or gait cycles"
        figure = partial(
            joint_figure, drawn, title, differing=_parts(of_curves), shown=kinds, gaps=gaps
        )
        yield f"joints_difference_{file}", figure


def _parts(
    of_curves: Mapping[str, CurveComparison],
) -> dict[tuple[str, str], Sequence[CurveDifference]]:
    """Give the parts that differ by joint motion and curve."""
    return {
        (motion.name, curve): of.parts
        for motion in LEG
        for curve in CURVES
        if (of := of_curves.get(f"{motion.name}_{curve}"))
    }
