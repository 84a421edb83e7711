"""Residuals of a trial: over gait cycles, as a long table, and beside published thresholds."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hbm.model import Body
from hbm.poses import center_of_mass, joint_positions
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.trial.gait.cycle_table import cycle_table
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.result import TrialResult
from pipeline.trial.window import frames_within

AXES: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
UNITS: Final = ("N", "N", "N", "N·m", "N·m", "N·m")
UNIT_OF: Final = dict(zip(AXES, UNITS, strict=True))
DIRECTIONS: Final = ("forward", "right", "up", "forward", "right", "up")
REPORTED_SIGN: Final = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
"""From lab axes, with Y to the left, to the reported ones, with y to the right."""
MAX_FORCE_SHARE: Final = 0.05
"""Peak residual force over peak net external force (Hicks et al. 2015)."""
MAX_MOMENT_SHARE: Final = 0.01
"""Peak residual moment over that force times the height of the centre of mass (ibid.)."""
FOOT_SEGMENTS: Final = ("left_foot", "left_toes", "right_foot", "right_toes")
"""Begin at the ankle and at the ball of the foot."""
EVERY_MARKER: Final = "all"
"""Name of the row over all markers."""


@dataclass(frozen=True, slots=True)
class ResidualRow:
    """One residual of a trial, summarised over its gait cycles.

    Attributes
    ----------
    subject, condition
        The trial.
    compensated
        Whether the plates' wrenches were compensated.
    axis, unit
        "Fx" … "Mz" as reported: x forward, y right, z up; moments about the pelvis origin.
    rms, mean, sd, peak
        Over all samples of the window; the peak is the largest magnitude.
    rms_of_cycles
        RMS over cycles of each cycle's RMS over what of 0–100 % is in the window.
    rms_percent
        The RMS in percent of body weight, or of body weight × stature.
    n_cycles
        Number of gait cycles of which any frame in the window counts; 0 where a span of the
        recording counts instead.
    window
        What counts: "cycle", "span" of the recording, or a part of the perturbed gait cycles:
        "motion", or what was stated, such as "0.2 to 0.5 s" or "10 to 40 %".
    headline
        Whether this is the window that the condition asks for; where that is a part of the gait
        cycles, there are rows of "cycle" too.
    valid_share
        Share of the frames in it that count: the pose is known and the plates carry the subject.
    compensation_sd
        RMS of one standard deviation of the residual due to the compensation;
        None for the plates as measured, and where no platform was compensated.
    """

    subject: str
    condition: str
    compensated: bool
    window: str
    headline: bool
    axis: str
    unit: str
    rms: float
    rms_of_cycles: float
    mean: float
    sd: float
    peak: float
    rms_percent: float
    n_cycles: int
    valid_share: float
    compensation_sd: float | None


@dataclass(frozen=True, slots=True)
class Window:
    """What of a trial residuals are summarised over.

    Attributes
    ----------
    name, headline
        As in `ResidualRow`.
    spans
        Start and stop of each of its stretches, (N, 2) [s]: one per gait cycle, NaN where a cycle
        has none; or one of the recording.
    """

    name: str
    headline: bool
    spans: Array


@dataclass(frozen=True, slots=True)
class ThresholdRow:
    """A trial's peak residual force or moment beside its published limit (Hicks et al. 2015)."""

    compensated: bool
    quantity: str
    unit: str
    peak: float
    limit: float
    passed: bool


@dataclass(frozen=True, slots=True)
class MarkerRow:
    """A marker's distance from the model: NaN for one that was never seen."""

    marker: str
    rms_mm: float
    peak_mm: float
    missing_percent: float

    @property
    def seen(self) -> bool:
        """Whether it was visible in any frame that was solved."""
        return bool(np.isfinite(self.rms_mm))


def reported(residual: Array) -> Array:
    """Give residuals in the axes in which they are reported.

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
        Side -> (C, 101, 6) in the reported axes [N, N·m]; NaN where frames do not count.
    """
    dynamics = result.variants[variant]
    values = np.where(result.counts[:, None], reported(dynamics.residual), np.nan)
    return {side: normalise(dynamics.time, values, spans) for side, spans in result.cycles.items()}


def windows(result: TrialResult) -> tuple[Window, ...]:
    """Give what a trial's residuals are summarised over, the headline first."""
    if result.span:
        return (Window("span", True, np.array([result.span])),)
    cycles = Window("cycle", result.part is None, _joined(result.cycles))
    if result.part is None:
        return (cycles,)
    spans = {side: result.part.spans[side] for side in result.cycles}
    return Window(result.part.name, True, _joined(spans)), cycles


def _joined(spans: Mapping[str, ArrayLike]) -> Array:
    """Give the spans of both sides one after another, (C, 2)."""
    return np.concatenate([np.empty((0, 2)), *(np.reshape(own, (-1, 2)) for own in spans.values())])


def counted(result: TrialResult) -> Mask:
    """Give whether each frame counts: it is in the headline window and valid, (T,)."""
    return _counted(result, windows(result)[0])


def _counted(result: TrialResult, window: Window) -> Mask:
    inside = frames_within(result.motion.time, {"": window.spans}, None)
    return np.asarray(inside & result.counts)


def headline_rows(rows: Iterable[ResidualRow]) -> tuple[ResidualRow, ...]:
    """Give the rows of the window that the condition asks for."""
    return tuple(row for row in rows if row.headline)


def cycles_of(result: TrialResult, condition: str) -> pd.DataFrame:
    """Lay out the residuals of every gait cycle that counts, as `cycles.csv` holds them.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the table.

    Returns
    -------
    pandas.DataFrame
        subject, condition, and the columns of `pipeline.trial.gait.cycle_table.cycle_table`; empty
        where a span of the recording counts.
    """
    residuals = {
        name == "compensated": reported(dynamics.residual)
        for name, dynamics in result.variants.items()
    }
    cycles = {} if result.span else result.cycles
    table = cycle_table(result.motion.time, result.counts, residuals, cycles, UNIT_OF)
    table.insert(0, "condition", condition)
    table.insert(0, "subject", result.subject.id)
    return table


def residual_table(result: TrialResult, condition: str) -> pd.DataFrame:
    """Lay `residual_rows` out as a table.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> subject = pipeline.Subject(sex="male", mass_kg=74.6)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, subject, pipeline.Settings())
    >>> table = pipeline.residual_table(result, "level")
    >>> table[["axis", "unit"]].to_numpy().tolist()[:2]
    [['Fx', 'N'], ['Fy', 'N']]
    >>> bool(table["rms"].max() < 10.0)
    True
    """
    columns = [field.name for field in fields(ResidualRow)]
    return pd.DataFrame(residual_rows(result, condition), columns=columns)


def residual_rows(result: TrialResult, condition: str) -> tuple[ResidualRow, ...]:
    """Summarise a trial's residuals, one row per variant and axis.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the table.

    Returns
    -------
    tuple of ResidualRow
        The headline window first; of each, as measured and then compensated; axes in the order of
        `AXES`. Empty where no frame of the headline window counts.
    """
    if not counted(result).any():
        return ()
    return tuple(row for window in windows(result) for row in _rows(result, condition, window))


def _rows(result: TrialResult, condition: str, window: Window) -> list[ResidualRow]:
    """Summarise a trial's residuals over one window."""
    time, counts = result.motion.time, _counted(result, window)
    inside = frames_within(time, {"": window.spans}, None)
    with_data = [
        bool(counts[(time >= start) & (time < stop)].any()) for start, stop in window.spans
    ]
    weight = result.body.mass * GRAVITY_MPS2
    scale = np.array([weight] * 3 + [weight * result.body.height_m] * 3) / 100
    rows = []
    for name, dynamics in result.variants.items():
        value = reported(dynamics.residual[counts])
        rms = np.sqrt(np.mean(value**2, axis=0))
        rms_of_cycles = _rms_of_cycles(result, name, window)
        spread: list[float | None] = [None] * len(AXES)
        if name == "compensated" and result.uncertainty is not None:
            spread = np.sqrt(np.mean(result.uncertainty.residual[counts] ** 2, axis=0)).tolist()
        for k, axis in enumerate(AXES):
            row = ResidualRow(
                subject=result.subject.id,
                condition=condition,
                compensated=name == "compensated",
                window=window.name,
                headline=window.headline,
                axis=axis,
                unit=UNITS[k],
                rms=float(rms[k]),
                rms_of_cycles=float(rms_of_cycles[k]),
                mean=float(value[:, k].mean()),
                sd=float(value[:, k].std()),
                peak=float(np.abs(value[:, k]).max()),
                rms_percent=float(rms[k] / scale[k]),
                n_cycles=0 if result.span else sum(with_data),
                valid_share=float(np.count_nonzero(counts) / np.count_nonzero(inside)),
                compensation_sd=spread[k],
            )
            rows.append(row)
    return rows


def _rms_of_cycles(result: TrialResult, variant: str, window: Window) -> Array:
    """Give the RMS over cycles of each cycle's RMS in a window, (6,); NaN without cycles."""
    curves = np.concatenate(list(cycle_residuals(result, variant).values()))
    if window.name != "cycle" and not result.span:
        share = np.linspace(0, 1, curves.shape[1])
        start, stop = _joined(result.cycles).T[..., None]
        first, last = ((bound[:, None] - start) / (stop - start) for bound in window.spans.T)
        inside = (share >= first) & (share <= last)
        curves = np.where(inside[..., None], curves, np.nan)
    curves = curves[np.isfinite(curves).any(axis=(1, 2))]
    if result.span or not len(curves):
        return np.full(len(AXES), np.nan)
    return np.asarray(np.sqrt(np.mean(np.nanmean(curves**2, axis=1), axis=0)))


def height_of_mass(body: Body, q: Array) -> float:
    """Give the mean height of the centre of mass above the lowest joint of the feet [m].

    Of coordinates (T, 46), wherever the laboratory has its origin.
    """
    lowest = joint_positions(body, q, FOOT_SEGMENTS)[..., 2].min(axis=1)
    return float(np.mean(center_of_mass(body, q)[:, 2] - lowest))


def threshold_rows(result: TrialResult) -> tuple[ThresholdRow, ...]:
    """Compare a trial's peak residuals with published limits.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    tuple of ThresholdRow
        Force and moment, as measured and compensated; empty where no frame counts.

    Notes
    -----
    Hicks et al. 2015 (J Biomech Eng 137:020905): the peak residual force should stay below 5 % of
    the peak net external force, the peak residual moment below 1 % of the height of the centre of
    mass times that force. Peaks are of the vectors' magnitudes, over the frames that count; the
    height is the mean one above the lowest joint of the feet (ankles and toes) in each frame.
    """
    inside = counted(result)
    if not inside.any():
        return ()
    q = result.motion.q[inside]
    height = height_of_mass(result.body, q)
    rows = []
    for name, dynamics in result.variants.items():
        ground = np.sum(list(result.ground[name].values()), axis=0)[inside, :3]
        external = float(np.linalg.norm(ground, axis=1).max())
        residual = dynamics.residual[inside]
        for quantity, unit, part, limit in (
            ("force", "N", residual[:, :3], MAX_FORCE_SHARE * external),
            ("moment", "N·m", residual[:, 3:], MAX_MOMENT_SHARE * height * external),
        ):
            peak = float(np.linalg.norm(part, axis=1).max())
            compensated = name == "compensated"
            rows.append(ThresholdRow(compensated, quantity, unit, peak, limit, peak < limit))
    return tuple(rows)


def marker_rows(result: TrialResult) -> tuple[MarkerRow, ...]:
    """Give each marker's RMS and largest distance from the model, and its gaps.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    tuple of MarkerRow
        In the motion's order of markers; the last row, "all", over all of them.
    """
    error = result.motion.marker_error * 1000
    rows = [_marker_row(name, error[:, k]) for k, name in enumerate(result.motion.markers)]
    return (*rows, _marker_row(EVERY_MARKER, error))


def _marker_row(name: str, error_mm: Array) -> MarkerRow:
    """Summarise distances; RMS and peak are NaN where there are none."""
    seen = error_mm[np.isfinite(error_mm)]
    missing = 100 * (1 - len(seen) / error_mm.size)
    if not len(seen):
        return MarkerRow(name, np.nan, np.nan, missing)
    return MarkerRow(name, float(np.sqrt(np.mean(seen**2))), float(seen.max()), missing)
