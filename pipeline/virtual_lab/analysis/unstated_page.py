"""The part of the page on Table III that is about what the thesis does not state."""

from typing import Final

import numpy as np
import pandas as pd

from pipeline.trial.residuals import AXES, UNITS
from pipeline.virtual_lab.analysis.page_table import markdown
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells
from pipeline.virtual_lab.analysis.processed_study import CELLS, KEYS, headline_cells
from pipeline.virtual_lab.analysis.reproduction import DOCUMENTED, ESTIMATED, Reproduction
from pipeline.virtual_lab.analysis.unstated import FITTED, POSES
from pipeline.virtual_lab.analysis.unstated_response import PROTOCOL

QUANTITIES: Final = {
    "sway_hz": ("bandwidth of the sway actuators [Hz]", ".1f", "7, assumed"),
    "flexibility": ("flexibility of the structure", ".1f", "1, of a real treadmill"),
    "place_forward_m": ("people ahead of the middle of the belts [m]", ".2f", "0, assumed"),
    "assembly_kg": ("mass of each belt assembly [kg]", ".0f", "150, stated"),
    "window_s": ("part of a perturbation that counts [s]", ".2f", "the motion, 0.27"),
}
"""Estimated number -> what it is, how it is written, and its value in the documented laboratory."""
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
    estimate = found.unstated
    pose, other = estimate.value.pose, next(p for p in POSES if p != estimate.value.pose)
    predicted = {p: pd.Series(cells, CELLS) for p, cells in estimate.predicted.items()}
    printed = printed_cells().set_index(KEYS)["mean"]
    without = predicted["none"]
    judged = found.judged.set_index("laboratory")
    unexplained = judged[(judged.index == ESTIMATED) & ~judged["explained"]]
    own = found.residuals[found.residuals["laboratory"] == ESTIMATED]
    simulated = headline_cells(own).mean(axis=0)
    off = np.abs(simulated / estimate.predicted[pose] - 1)[FITTED]
    return {
        "estimates": _estimates(found),
        "few": PROTOCOL.subjects,
        "pose_fits": {"channels": "with", "none": "without"}[pose],
        "misfit": estimate.misfit[pose],
        "misfit_other": estimate.misfit[other],
        "freedom": estimate.freedom,
        "widened": max(1.0, np.sqrt(estimate.misfit[pose] / estimate.freedom)),
        "interpolated": 100 * float(np.median(off)),
        "interpolated_most": 100 * float(off.max()),
        "no_pose_pitch_fx": without["pitch", False, "Fx"],
        "no_pose_pitch_fx_ic": without["pitch", True, "Fx"],
        "no_pose_pitch_my_ic": without["pitch", True, "My"],
        "met_removed": _judgement(judged, removed=True),
        "met_others": _judgement(judged, removed=False),
        "explained_removed": _count(judged.loc[[ESTIMATED]], removed=True),
        "explained_others": _count(judged.loc[[ESTIMATED]], removed=False),
        "documented_removed": _count(judged.loc[[DOCUMENTED]], removed=True),
        "documented_others": _count(judged.loc[[DOCUMENTED]], removed=False),
        "unexplained": _named(unexplained),
        "missing": _missing(pd.Series(simulated, CELLS), printed),
    }


def _estimates(found: Reproduction) -> str:
    estimate = found.unstated
    rows = [["Value", "Documented", "Estimated", "95 % interval"]]
    for name, (title, form, before) in QUANTITIES.items():
        value, low, high = (
            format(getattr(end, name), form)
            for end in (estimate.value, estimate.low, estimate.high)
        )
        edge = ", at the edge" if name in estimate.at_edge else ""
        rows.append([title, before, f"{value}{edge}", f"{low} to {high}"])
    pose = {"channels": "yes", "none": "no"}[estimate.value.pose]
    rows.append(["the pose turned the forces into the lab", "yes", pose, ""])
    return markdown(rows)


def _judgement(judged: pd.DataFrame, *, removed: bool) -> str:
    """Lay out the cells with compensation, documented and estimated; bold where explained."""
    cells = judged[judged["removed"] == removed]
    documented, estimated = (cells.loc[[name]] for name in (DOCUMENTED, ESTIMATED))
    rows = [["Residual", "Condition", "Thesis", "Documented", "Estimated", "By chance"]]
    for before, after in zip(documented.itertuples(), estimated.itertuples(), strict=True):
        rows.append(
            [
                f"{after.axis} ({UNIT[str(after.axis)]})",
                str(after.condition),
                f"{after.thesis:.1f}",
                *(
                    f"**{cell.simulated:.1f}**" if cell.explained else f"{cell.simulated:.1f}"
                    for cell in (before, after)
                ),
                f"{after.tolerance:.1f}",
            ]
        )
    return markdown(rows)


def _count(judged: pd.DataFrame, *, removed: bool) -> str:
    """Say how many of the cells are explained.

    Examples
    --------
    >>> cells = pd.DataFrame({"removed": [True, True, False], "explained": [True, False, True]})
    >>> _count(cells, removed=True)
    '1 of 2'
    """
    own = judged.loc[judged["removed"] == removed, "explained"]
    return f"{int(own.sum())} of {len(own)}"


def _named(cells: pd.DataFrame) -> str:
    """Name cells by condition."""
    by_condition = cells.groupby("condition", sort=False)["axis"].agg(", ".join)
    return "; ".join(f"{condition} {axes}" for condition, axes in by_condition.items()) or "none"


def _missing(simulated: "pd.Series[float]", printed: "pd.Series[float]") -> str:
    """Say what an independent residual would have to add at baseline with compensation."""
    texts = []
    for axis in AXES:
        cell = "baseline", True, axis
        lacking = np.sqrt(max(0.0, printed[cell] ** 2 - simulated[cell] ** 2))
        texts.append(f"{axis} {lacking:.0f} {UNIT[axis]}")
    return ", ".join(texts)
