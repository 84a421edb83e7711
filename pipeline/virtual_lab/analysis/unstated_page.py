"""The part of the page on Table III that is about what the thesis does not state."""

from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array, Mask
from pipeline.trial.residuals import AXES, UNITS
from pipeline.virtual_lab.analysis.page_table import markdown
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells
from pipeline.virtual_lab.analysis.processed_study import CELLS, KEYS, headline_cells
from pipeline.virtual_lab.analysis.reproduction import (
    ADDED,
    DOCUMENTED,
    ESTIMATED,
    Reproduction,
)
from pipeline.virtual_lab.analysis.unstated import POSES, Pose
from pipeline.virtual_lab.analysis.unstated_estimate import FITTED, Estimate
from pipeline.virtual_lab.analysis.unstated_response import PROTOCOL

QUANTITIES: Final = {
    "sway_hz": ("bandwidth of the sway actuators [Hz]", ".1f", "7, assumed"),
    "flexibility": ("flexibility of the structure", ".1f", "1, of a real treadmill"),
    "place_forward_m": ("people ahead of the middle of the belts [m]", "z.2f", "0, assumed"),
    "assembly_kg": ("mass of each belt assembly [kg]", ".0f", "150, stated"),
    "window_s": ("part of a perturbation that counts [s]", ".2f", "the motion, 0.27"),
}
"""Estimated number -> what it is, how it is written, and its value in the documented laboratory."""
JUDGED: Final = (DOCUMENTED, ESTIMATED, ADDED)
POSE_FITS: Final[dict[Pose, str]] = {"channels": "with", "none": "without"}
YES_OR_NO: Final[dict[Pose, str]] = {"channels": "yes", "none": "no"}
UNIT: Final = dict(zip(AXES, UNITS, strict=True))


def unstated_parts(found: Reproduction) -> dict[str, object]:
    """Give what the page's template has in braces about the estimates.

    Parameters
    ----------
    found
        What `pipeline.virtual_lab.analysis.reproduction.reproduce` gave.

    Returns
    -------
    dict
        Name -> text or number.
    """
    estimate, adding = found.unstated, found.unstated_adding
    pose, other = estimate.value.pose, next(p for p in POSES if p != estimate.value.pose)
    judged = found.judged.set_index("laboratory")
    own = found.residuals[found.residuals["laboratory"] == ESTIMATED]
    simulated = headline_cells(own).mean(axis=0)
    off = np.abs(simulated / estimate.predicted[pose] - 1)[FITTED]
    printed = printed_cells().set_index(KEYS).loc[CELLS, "mean"].to_numpy()
    return {
        "estimates": _estimates(found),
        "few": PROTOCOL.subjects,
        "pose_fits": POSE_FITS[pose],
        "misfit": estimate.misfit[pose],
        "misfit_other": estimate.misfit[other],
        "freedom": estimate.freedom,
        "widened": _widening(estimate),
        "interpolated": 100 * float(np.median(off)),
        "interpolated_most": 100 * float(off.max()),
        "adding_misfit": adding.misfit[adding.value.pose],
        "adding_freedom": adding.freedom,
        "adding_widened": _widening(adding),
        "added": _by_axis(adding.added),
        "shaken": _baseline(simulated, FITTED),
        "calmed": _baseline(simulated, ~FITTED),
        "printed_shaken": _baseline(printed, FITTED),
        "printed_calmed": _baseline(printed, ~FITTED),
        **_pitched(adding.predicted["none"], "no_pose"),
        **_pitched(adding.predicted["channels"], "pose"),
        "met_removed": _judgement(judged, removed=True),
        "met_others": _judgement(judged, removed=False),
        "removed_counts": _counts(judged, removed=True),
        "others_counts": _counts(judged, removed=False),
        "unexplained": _unexplained(judged.loc[[ESTIMATED]]),
        "unexplained_adding": _unexplained(judged.loc[[ADDED]]),
    }


def _widening(estimate: Estimate) -> float:
    """Give by how much intervals are widened because the fit is worse than its errors."""
    return max(1.0, float(np.sqrt(estimate.misfit[estimate.value.pose] / estimate.freedom)))


def _estimates(found: Reproduction) -> str:
    heads = ["Value", "Documented", "Estimated", "95 % interval"]
    rows = [[*heads, "With an added residual", "95 % interval"]]
    for name, (title, form, before) in QUANTITIES.items():
        row = [title, before]
        for estimate in (found.unstated, found.unstated_adding):
            value, low, high = (
                format(getattr(end, name), form)
                for end in (estimate.value, estimate.low, estimate.high)
            )
            edge = ", at the edge" if name in estimate.at_edge else ""
            row += [f"{value}{edge}", f"{low} to {high}"]
        rows.append(row)
    poses = [YES_OR_NO[own.value.pose] for own in (found.unstated, found.unstated_adding)]
    rows.append(["the pose turned the forces into the lab", "yes", poses[0], "", poses[1], ""])
    return markdown(rows)


def _judgement(judged: pd.DataFrame, *, removed: bool) -> str:
    """Lay out the cells with compensation; bold where explained."""
    cells = judged[judged["removed"] == removed]
    rows = [["Residual", "Condition", "Thesis", *(name.capitalize() for name in JUDGED)]]
    for row in zip(*(cells.loc[[name]].itertuples() for name in JUDGED), strict=True):
        first = row[0]
        texts = [f"{cell.simulated:.1f} (± {cell.tolerance:.1f})" for cell in row]
        marked = [
            f"**{text}**" if cell.explained else text for text, cell in zip(texts, row, strict=True)
        ]
        name = f"{first.axis} ({UNIT[str(first.axis)]})"
        rows.append([name, str(first.condition), f"{first.thesis:.1f}", *marked])
    return markdown(rows)


def _counts(judged: pd.DataFrame, *, removed: bool) -> str:
    """Say how many of the cells are explained in each laboratory.

    Examples
    --------
    >>> cells = pd.DataFrame(
    ...     {"removed": [True] * 3, "explained": [True, False, True]}, index=pd.Index(JUDGED)
    ... )
    >>> _counts(cells, removed=True)
    '1 of 1 documented, 0 of 1 estimated and 1 of 1 with an added residual'
    """
    own = judged.loc[judged["removed"] == removed, "explained"]
    texts = [f"{int(own[[name]].sum())} of {len(own[[name]])} {name}" for name in JUDGED]
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def _unexplained(judged: pd.DataFrame) -> str:
    """Name the cells that are not explained, by condition."""
    cells = judged[~judged["explained"]]
    by_condition = cells.groupby("condition", sort=False)["axis"].agg(", ".join)
    return "; ".join(f"{condition} {axes}" for condition, axes in by_condition.items()) or "none"


def _pitched(predicted: Array, name: str) -> dict[str, object]:
    """Give the cells of pitch that depend on the pose."""
    cells = pd.Series(predicted, CELLS)
    return {
        f"{name}_fx": cells["pitch", False, "Fx"],
        f"{name}_fx_ic": cells["pitch", True, "Fx"],
        f"{name}_my_ic": cells["pitch", True, "My"],
    }


def _baseline(cells: Array, variant: Mask) -> str:
    """Write the cells of one variant at baseline, by axis."""
    return _by_axis(cells[variant & (CELLS.get_level_values("condition") == "baseline")])


def _by_axis(values: Array) -> str:
    """Write a number per axis: forces [N], then moments [N·m]."""
    texts = [f"{value:.1f}" for value in values]
    return f"{', '.join(texts[:3])} N and {', '.join(texts[3:])} N·m"
