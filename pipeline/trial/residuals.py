"""Residuals of a trial: per gait cycle, as a long table, and against published thresholds."""

from typing import Final

import numpy as np
import pandas as pd

from hbm.center_of_mass import center_of_mass
from hbm.dynamics import Dynamics
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.result import TrialResult

AXES: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
UNITS: Final = ("N", "N", "N", "N·m", "N·m", "N·m")
DIRECTIONS: Final = ("forward", "right", "up", "forward", "right", "up")
REPORTED_SIGN: Final = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
HICKS_FORCE_SHARE: Final = 0.05
HICKS_MOMENT_SHARE: Final = 0.01


def reported(residual: Array) -> Array:
    """Give residuals in the axes in which people read them.

    Parameters
    ----------
    residual
        In lab axes (X forward, Y left, Z up), (..., 6) [N, N·m].

    Returns
    -------
    Array
        x forward, y to the right, z up, each moment right-handed about its own axis, (..., 6):
        Fy and My change sign.
    """
    return np.asarray(residual * REPORTED_SIGN)


def variants(result: TrialResult) -> dict[str, Dynamics]:
    """Give the dynamics with the plates as measured and, where there is one, compensated."""
    both = {"measured": result.measured, "compensated": result.compensated}
    return {name: dynamics for name, dynamics in both.items() if dynamics is not None}


def cycle_residuals(result: TrialResult, variant: str) -> dict[str, Array]:
    """Give the residuals of every gait cycle over 0–100 %.

    Parameters
    ----------
    result
        The trial.
    variant
        "measured" or "compensated".

    Returns
    -------
    dict[str, Array]
        Side -> (C, 101, 6) in the reported axes [N, N·m].
    """
    dynamics = variants(result)[variant]
    values = reported(dynamics.residual)
    return {side: normalise(dynamics.time, values, spans) for side, spans in result.cycles.items()}


def in_cycles(result: TrialResult) -> Mask:
    """Tell which frames lie in an accepted gait cycle of either side, (T,)."""
    inside = np.zeros(len(result.motion.time), bool)
    for spans in result.cycles.values():
        for start, stop in spans:
            inside |= (result.motion.time >= start) & (result.motion.time < stop)
    return inside


def residual_table(result: TrialResult, condition: str) -> pd.DataFrame:
    """Summarise a trial's residuals, one row per variant and axis.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the table.

    Returns
    -------
    pandas.DataFrame
        subject, condition, compensated, axis, unit, rms (over all samples of the gait cycles),
        rms_of_cycles (RMS over cycles of each cycle's RMS over 0–100 %), mean, sd, peak (largest
        magnitude), rms_percent (of body weight, or of body weight × stature), n_cycles. Axes as
        reported: x forward, y right, z up; moments about the pelvis origin.

    Raises
    ------
    ValueError
        If the trial has no gait cycle.
    """
    inside = in_cycles(result)
    if not inside.any():
        raise ValueError(
            f"{result.source.name}: no gait cycle was found; residuals are reported per cycle"
        )
    weight = result.body.mass * GRAVITY_MPS2
    scale = np.array([weight] * 3 + [weight * result.body.height_m] * 3) / 100
    rows = []
    for name, dynamics in variants(result).items():
        value = reported(dynamics.residual[inside])
        per_cycle = np.concatenate(list(cycle_residuals(result, name).values()))
        per_cycle = per_cycle[np.isfinite(per_cycle).all(axis=(1, 2))]
        rms = np.sqrt(np.mean(value**2, axis=0))
        for k, axis in enumerate(AXES):
            rows.append(
                {
                    "subject": result.subject.id,
                    "condition": condition,
                    "compensated": name == "compensated",
                    "axis": axis,
                    "unit": UNITS[k],
                    "rms": rms[k],
                    "rms_of_cycles": np.sqrt(np.mean(per_cycle[..., k] ** 2)),
                    "mean": value[:, k].mean(),
                    "sd": value[:, k].std(),
                    "peak": np.abs(value[:, k]).max(),
                    "rms_percent": rms[k] / scale[k],
                    "n_cycles": sum(len(spans) for spans in result.cycles.values()),
                }
            )
    return pd.DataFrame(rows)


def hicks_table(result: TrialResult) -> pd.DataFrame:
    """Hold a trial's peak residuals against published limits.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pandas.DataFrame
        compensated, quantity ("force" or "moment"), unit, peak, limit, passed.

    Notes
    -----
    Hicks et al. 2015 (J Biomech Eng 137:020905): the peak residual force should stay below 5 % of
    the peak net external force, the peak residual moment below 1 % of the height of the centre of
    mass times that force. Peaks are of the vectors' magnitudes, within gait cycles; the height is
    the mean one above the lowest foot.
    """
    inside = in_cycles(result)
    rows = []
    for name, dynamics in variants(result).items():
        ground = np.sum(list(result.ground[name].values()), axis=0)[inside, :3]
        external = float(np.linalg.norm(ground, axis=1).max())
        height = float(np.mean(center_of_mass(result.body, result.motion.q[inside])[:, 2]))
        residual = dynamics.residual[inside]
        for quantity, unit, part, limit in (
            ("force", "N", residual[:, :3], HICKS_FORCE_SHARE * external),
            ("moment", "N·m", residual[:, 3:], HICKS_MOMENT_SHARE * height * external),
        ):
            peak = float(np.linalg.norm(part, axis=1).max())
            rows.append(
                {
                    "compensated": name == "compensated",
                    "quantity": quantity,
                    "unit": unit,
                    "peak": peak,
                    "limit": limit,
                    "passed": peak < limit,
                }
            )
    return pd.DataFrame(rows)


def marker_table(result: TrialResult) -> pd.DataFrame:
    """Give each marker's RMS and largest distance from the model, and its gaps.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pandas.DataFrame
        marker, rms_mm, peak_mm, missing_percent; the last row, "all", over all markers. A marker
        that was never seen has no error (NaN).
    """
    error = result.motion.marker_error * 1000
    seen = np.isfinite(error)
    singles = [_spread(error[seen[:, k], k]) for k in range(error.shape[1])]
    table = pd.DataFrame([*singles, _spread(error[seen])], columns=["rms_mm", "peak_mm"])
    table.insert(0, "marker", [*result.motion.markers, "all"])
    table["missing_percent"] = 100 * (1 - np.append(seen.mean(axis=0), seen.mean()))
    return table


def _spread(distance: Array) -> tuple[float, float]:
    """Give RMS and largest of distances; NaN where there are none."""
    if not len(distance):
        return np.nan, np.nan
    return float(np.sqrt(np.mean(distance**2))), float(distance.max())
