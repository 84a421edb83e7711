"""The part of the page on Table III that is about what the thesis does not state."""

from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import chi2

from hbm.spatial import Array, Mask
from pipeline.trial.residuals import UNIT_OF
from pipeline.virtual_lab.analysis.empty_plate import FORCES, THESIS_RUNNING_N
from pipeline.virtual_lab.analysis.page_table import markdown
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells
from pipeline.virtual_lab.analysis.processed_study import CELLS, KEYS, PERTURBED, headline_cells
from pipeline.virtual_lab.analysis.reproduction import (
    ADDED,
    DOCUMENTED,
    ESTIMATED,
    Reproduction,
)
from pipeline.virtual_lab.analysis.unstated import POSES, Pose
from pipeline.virtual_lab.analysis.unstated_estimate import (
    CONFIDENCE,
    FITTED,
    Estimate,
    simulated_range,
)
from pipeline.virtual_lab.analysis.unstated_response import PROTOCOL
from pipeline.virtual_lab.person.bystander import MASS_KG

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
    off = np.abs(simulated / estimate.predicted[pose] - 1)
    printed = printed_cells().set_index(KEYS).loc[CELLS, "mean"].to_numpy()
    return {
        "estimates": _estimates(found),
        "few": PROTOCOL.subjects,
        "pose_fits": POSE_FITS[pose],
        "other_pose": POSE_FITS[other],
        "misfit": estimate.misfit[pose],
        "misfit_other": estimate.misfit[other],
        "freedom": estimate.freedom,
        "chance": _chance(estimate),
        "widened": _widening(estimate),
        "interpolated": 100 * float(np.median(off[FITTED])),
        "interpolated_most": 100 * float(off[FITTED].max()),
        "interpolated_other": 100 * float(np.median(off[~FITTED])),
        "interpolated_other_most": 100 * float(off[~FITTED].max()),
        "adding_misfit": adding.misfit[adding.value.pose],
        "adding_freedom": adding.freedom,
        "adding_chance": _chance(adding),
        "adding_widened": _widening(adding),
        "added": _by_axis(adding.added),
        "shaken": _baseline(simulated, FITTED),
        "calmed": _baseline(simulated, ~FITTED),
        "printed_shaken": _baseline(printed, FITTED),
        "printed_calmed": _baseline(printed, ~FITTED),
        "left": _left_at_baseline(simulated),
        "printed_left": _left_at_baseline(printed),
        "running": _running(found.running),
        "runner_kg": MASS_KG,
        "flexibility": estimate.value.flexibility,
        "times": _times(found.running, estimate.value.flexibility),
        "low_flexibility": estimate.low.flexibility,
        "low_times": _times(found.running, estimate.low.flexibility),
        "ringing_n": pd.Series(simulated, CELLS)[PERTURBED, False, "Fy"],
        "sway_hz": estimate.value.sway_hz,
        **_pitched(adding.predicted["none"], "no_pose"),
        **_pitched(adding.predicted["channels"], "pose"),
        "met_removed": _judgement(judged, removed=True),
        "met_others": _judgement(judged, removed=False),
        "removed_counts": _counts(judged, "explained", removed=True),
        "removed_undecided": _counts(judged, "undecided", removed=True),
        "others_counts": _counts(judged, "explained", removed=False),
        "others_undecided": _counts(judged, "undecided", removed=False),
        "unexplained": _unexplained(judged.loc[[ESTIMATED]]),
        "unexplained_adding": _unexplained(judged.loc[[ADDED]]),
    }


def _widening(estimate: Estimate) -> float:
    """Give by how much intervals are widened because the fit is worse than its errors."""
    return max(1.0, float(np.sqrt(estimate.misfit[estimate.value.pose] / estimate.freedom)))


def _chance(estimate: Estimate) -> float:
    """Give what the misfit of a true model stays below in 95 % of cases."""
    return float(chi2.ppf(CONFIDENCE, estimate.freedom))


def _estimates(found: Reproduction) -> str:
    heads = ["Value", "Documented", "Simulated", "Estimated", "95 % interval"]
    rows = [[*heads, ADDED.capitalize(), "95 % interval"]]
    ends = simulated_range()
    for name, (title, form, before) in QUANTITIES.items():
        limits = [format(getattr(end, name), form) for end in ends]
        row = [title, before, " to ".join(limits)]
        for estimate in (found.unstated, found.unstated_adding):
            value, low, high = (
                format(getattr(end, name), form)
                for end in (estimate.value, estimate.low, estimate.high)
            )
            edge = ", at the edge" if name in estimate.at_edge else ""
            row += [f"{value}{edge}", _interval(low, high, *limits)]
        rows.append(row)
    poses = [YES_OR_NO[own.value.pose] for own in (found.unstated, found.unstated_adding)]
    rows.append(
        ["the pose turned the forces into the lab", "yes", "yes, no", poses[0], "", poses[1], ""]
    )
    return markdown(rows)


def _interval(low: str, high: str, lowest: str, highest: str) -> str:
    """Write an interval; an end where the simulated studies end is none.

    Examples
    --------
    >>> _interval("7.7", "16.0", "1.0", "16.0"), _interval("1.0", "6.4", "1.0", "16.0")
    ('≥ 7.7', '≤ 6.4')
    >>> _interval("1.0", "16.0", "1.0", "16.0"), _interval("2.0", "6.4", "1.0", "16.0")
    ('not determined', '2.0 to 6.4')
    """
    if (low, high) == (lowest, highest):
        return "not determined"
    if high == highest:
        return f"≥ {low}"
    return f"≤ {high}" if low == lowest else f"{low} to {high}"


def _judgement(judged: pd.DataFrame, *, removed: bool) -> str:
    """Lay out the cells with compensation and whether they are explained."""
    cells = judged[judged["removed"] == removed]
    rows = [["Residual", "Condition", "Thesis", *(name.capitalize() for name in JUDGED)]]
    for row in zip(*(cells.loc[[name]].itertuples() for name in JUDGED), strict=True):
        first = row[0]
        texts = [
            f"{cell.simulated:.1f} (± {cell.tolerance:.1f})"
            + (", explained" if cell.explained else ", undecided" if cell.undecided else "")
            for cell in row
        ]
        name = f"{first.axis} ({UNIT_OF[str(first.axis)]})"
        rows.append([name, str(first.condition), f"{first.thesis:.1f}", *texts])
    return markdown(rows)


def _counts(judged: pd.DataFrame, verdict: str, *, removed: bool) -> str:
    """Say how many of the cells have a verdict in each laboratory.

    Examples
    --------
    >>> cells = pd.DataFrame(
    ...     {"removed": [True] * 3, "explained": [True, False, True]}, index=pd.Index(JUDGED)
    ... )
    >>> _counts(cells, "explained", removed=True)
    '1 of 1 documented, 0 of 1 estimated and 1 of 1 with a constant residual per axis'
    """
    own = judged.loc[judged["removed"] == removed, verdict]
    texts = [f"{int(own[[name]].sum())} of {len(own[[name]])} {name}" for name in JUDGED]
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def _unexplained(judged: pd.DataFrame) -> str:
    """Name the cells that are neither explained nor undecided, by condition."""
    cells = judged[~(judged["explained"] | judged["undecided"])]
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


def _left_at_baseline(cells: Array) -> str:
    """Write which shares of the residuals at baseline compensation leaves, by axis."""
    baseline = CELLS.get_level_values("condition") == "baseline"
    left = 100 * cells[baseline & ~FITTED] / cells[baseline & FITTED]
    return f"{left.min():.0f} to {left.max():.0f} %"


def _running(running: pd.DataFrame) -> str:
    """Lay out what the empty plate measures beside a runner."""
    rows = [["Flexibility", "Lowest modes (Hz)", "Unfiltered (N)", "Below 6 Hz (N)"]]
    for flexibility, own in running.groupby("flexibility"):
        modes = own[["sway_hz", "pitch_hz"]].iloc[0]
        forces = own.sort_values("filtered")[list(FORCES)].to_numpy()
        rows.append([f"{flexibility:.1f}", _listed(modes.to_numpy()), *map(_listed, forces)])
    rows.append(["thesis", "", _listed(np.array(THESIS_RUNNING_N)), ""])
    return markdown(rows)


def _times(running: pd.DataFrame, flexibility: float) -> float:
    """Give how many times the thesis' values those below 6 Hz are at least."""
    own = running[running["filtered"] & (running["flexibility"] == flexibility)]
    return float((own[list(FORCES)].to_numpy() / THESIS_RUNNING_N).min())


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.1f}" for value in values)


def _by_axis(values: Array) -> str:
    """Write a number per axis: forces [N], then moments [N·m]."""
    return f"{_listed(values[:3])} N and {_listed(values[3:])} N·m"
