"""Residuals of a trial: over gait cycles, as tables, and beside published thresholds."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from hbm.model import Body
from hbm.plausibility.motion import mass_share, unseen_covariance, unseen_segments
from hbm.poses import center_of_mass, joint_positions
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.result import TrialResult
from pipeline.trial.window import frames_within

HEALTHY_RMS: Final = (37.1, 30.4, 63.1, 11.4, 20.5, 4.5)
HEALTHY: Final = "healthy adults on a treadmill at rest (van de Loosdrecht 2018, Table III)"
"""RMS residuals [N, N·m], and of whom; they are lower in lighter people."""
AXES: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
UNITS: Final = ("N", "N", "N", "N·m", "N·m", "N·m")
DIRECTIONS: Final = ("forward", "right", "up", "forward", "right", "up")
REPORTED_SIGN: Final = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
"""From lab axes, with Y to the left, to the reported ones, with y to the right."""
MAX_FORCE_SHARE: Final = 0.05
"""Peak residual force over peak net external force (Hicks et al. 2015)."""
MAX_MOMENT_SHARE: Final = 0.01
"""Peak residual moment over that force times the height of the centre of mass (ibid.)."""
FOOT_SEGMENTS: Final = ("left_foot", "left_toes", "right_foot", "right_toes")
"""Begin at the ankle and at the ball of the foot."""
TRIAL_COLUMNS: Final = ("subject", "condition", "recording", "session")
"""Which trial: the recording is empty where there is one of the condition."""
CYCLE_COLUMNS: Final = (
    *TRIAL_COLUMNS,
    *("compensated", "window", "headline", "side", "cycle", "start_s", "stop_s"),
    *("axis", "unit", "rms", "peak", "n_frames", "valid_share"),
)
RESIDUAL_COLUMNS: Final = (
    *TRIAL_COLUMNS,
    *("compensated", "window", "headline", "axis", "unit"),
    *("rms", "rms_of_cycles", "mean", "sd", "peak", "rms_percent"),
    *("n_cycles", "n_frames", "valid_share", "compensation_sd", "expected"),
)
THRESHOLD_COLUMNS: Final = (
    *("compensated", "quantity", "unit", "peak", "limit", "passed", "above_percent"),
)
EVERY_MARKER: Final = "all"
"""Name of the row over all markers."""


@dataclass(frozen=True, slots=True)
class Window:
    """What of a trial residuals are summarised over.

    Attributes
    ----------
    name, headline
        As in `residual_table`.
    of_sides
        Side -> start and stop of each of its stretches, (N, 2) [s]: one per gait cycle, NaN where a
        cycle has none; or one of the recording, of no side.
    """

    name: str
    headline: bool
    of_sides: Mapping[str, Array]

    @property
    def spans(self) -> Array:
        """Those of both sides one after another, (N, 2) [s]."""
        return np.concatenate([np.empty((0, 2)), *self.of_sides.values()])


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

    Raises
    ------
    ValueError
        If the trial has no such residuals.
    """
    if variant not in result.variants:
        raise ValueError(f"no {variant} residuals; the trial has {', '.join(result.variants)}")
    dynamics = result.variants[variant]
    values = np.where(result.counts[:, None], reported(dynamics.residual), np.nan)
    return {side: normalise(dynamics.time, values, spans) for side, spans in result.cycles.items()}


def windows(result: TrialResult) -> tuple[Window, ...]:
    """Give what a trial's residuals are summarised over, the headline first."""
    if result.span:
        return (Window("span", True, {"": np.array([result.span])}),)

    def arrays(of_sides: Mapping[str, ArrayLike]) -> dict[str, Array]:
        return {side: np.reshape(of_sides[side], (-1, 2)) for side in result.cycles}

    cycles = Window(result.unit, result.part is None, arrays(result.cycles))
    if result.part is None:
        return (cycles,)
    return Window(result.part.name, True, arrays(result.part.spans)), cycles


def counted(result: TrialResult) -> Mask:
    """Give whether each frame counts: it is in the headline window and valid, (T,)."""
    spans = windows(result)[0].spans
    return np.asarray(frames_within(result.motion.time, {"": spans}, None) & result.counts)


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
        subject, condition, recording, session, compensated, window and headline (as in
        `residual_table`), side, cycle (from 1 for each side), start_s, stop_s, axis, unit, rms and
        peak (largest magnitude) over the frames of the window in the cycle that count, their number
        and share; NaN where none counts. Empty where a span of the recording counts.
    """
    return pd.DataFrame(cycle_rows(result, condition), columns=CYCLE_COLUMNS)


def cycle_rows(result: TrialResult, condition: str) -> list[tuple[Any, ...]]:
    """Give the rows of `cycles_of`."""
    return [
        (*trial_columns(result, condition), *of_window, *cycle, *measure, count, share)
        for name in result.variants
        for window in (() if result.span else windows(result))
        for of_window in [(name == "compensated", window.name, window.headline)]
        for *cycle, rms, peak, count, share in _of_cycles(result, name, window)
        for measure in zip(AXES, UNITS, rms.tolist(), peak.tolist(), strict=True)
    ]


def _of_cycles(
    result: TrialResult, variant: str, window: Window
) -> Iterator[tuple[str, int, float, float, Array, Array, int, float]]:
    """Give of each gait cycle side, number, start, stop, RMS, peak, (6,), used frames, share."""
    time, counts = result.motion.time, result.counts
    residual = reported(result.variants[variant].residual)
    for side, spans in window.of_sides.items():
        for number, (start, stop) in enumerate(spans.tolist(), start=1):
            inside = (time >= start) & (time < stop)
            used = residual[inside & counts]
            rms = peak = np.full(len(AXES), np.nan)
            if len(used):
                rms, peak = np.sqrt(np.mean(used**2, axis=0)), np.abs(used).max(axis=0)
            share = len(used) / max(1, int(np.count_nonzero(inside)))
            yield side, number, start, stop, rms, peak, len(used), share


def trial_columns(result: TrialResult, condition: str) -> tuple[str, str, str, str]:
    """Give a trial's `TRIAL_COLUMNS`."""
    return result.subject.id, condition, result.recording, result.session


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
        The headline window first; of each, as measured and then compensated; axes in the order of
        `AXES`. Empty where no frame of the headline window counts.

        subject, condition, recording, session
            The trial; recording and session are empty where there is one.
        compensated
            Whether the plates' wrenches were compensated.
        window, headline
            What counts: "cycle", "step", "stance", "span" of the recording, or a part of the
            perturbed gait cycles:
            "motion", or what was stated, such as "0.2 to 0.5 s"; and whether this is the window
            that the condition asks for. Where that is a part, there are rows of "cycle" too.
        axis, unit
            "Fx" … "Mz" as reported: x forward, y right, z up; moments about the pelvis origin.
        rms, mean, sd, peak
            Over all samples of the window; the peak is the largest magnitude.
        rms_of_cycles
            RMS over cycles of each cycle's RMS in the window, that of `cycles_of`.
        rms_percent
            The RMS in percent of body weight, or of body weight × stature.
        n_cycles
            Number of gait cycles, steps or stances of which any frame in the window counts; 0 for a
            span.
        n_frames, valid_share
            Number and share of the window's frames that count: the pose is known and the plates
            carry the subject.
        compensation_sd
            RMS of one standard deviation of the residual due to the compensation; NaN where there
            is none.
        expected
            One standard deviation of what the motion of segments that no marker shows adds
            (`hbm.plausibility.motion`); NaN where markers show trunk, head and arms. Hands alone
            do not count.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
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
    return pd.DataFrame(residual_rows(result, condition), columns=RESIDUAL_COLUMNS)


def residual_rows(result: TrialResult, condition: str) -> list[tuple[Any, ...]]:
    """Give the rows of `residual_table`."""
    if not counted(result).any():
        return []
    return [
        (*trial_columns(result, condition), *row)
        for window in windows(result)
        for name in result.variants
        for row in _summary(result, window, name)
    ]


def _summary(result: TrialResult, window: Window, variant: str) -> Iterator[tuple[Any, ...]]:
    """Summarise the residuals of one variant over one window, a row for each axis."""
    inside = frames_within(result.motion.time, {"": window.spans}, None)
    counts = inside & result.counts
    percent = result.body.mass * GRAVITY_MPS2 * np.repeat([1.0, result.body.height_m], 3) / 100
    value = reported(result.variants[variant].residual[counts])
    rms = np.sqrt(np.mean(value**2, axis=0))
    cycles = () if result.span else _of_cycles(result, variant, window)
    of_cycles = [rms_of_one**2 for *_, rms_of_one, _, count, _ in cycles if count]
    unknown = np.full(len(AXES), np.nan)
    rms_of_cycles = np.sqrt(np.mean(of_cycles, axis=0)) if of_cycles else unknown
    spread = unknown
    if variant == "compensated" and result.uncertainty is not None:
        spread = np.sqrt(np.mean(result.uncertainty[counts] ** 2, axis=0))
    expected = np.sqrt(np.diag(unseen_covariance(result.body, result.motion, counts)))
    expected = np.where(expected > 0, expected, np.nan)
    peak, used = np.abs(value).max(axis=0), int(np.count_nonzero(counts))
    of_frames = len(of_cycles), used, used / int(np.count_nonzero(inside))
    sizes = rms, rms_of_cycles, value.mean(axis=0), value.std(axis=0), peak, rms / percent
    uncertain = np.transpose([spread, expected]).tolist()
    for axis, unit, size, sd in zip(
        AXES, UNITS, np.transpose(sizes).tolist(), uncertain, strict=True
    ):
        of_window = variant == "compensated", window.name, window.headline
        yield *of_window, axis, unit, *size, *of_frames, *sd


def reference_of(residuals: pd.DataFrame) -> tuple[str, Mapping[str, float], str]:
    """Give what RMS residuals are compared with: its title, size by axis, and meaning.

    Those of healthy people, of whom markers showed all segments; in recordings without, the mean of
    what is expected.
    """
    expected = residuals.groupby("axis")["expected"].mean()
    if expected.notna().any():
        meaning = "Expected: by the motion of segments that no marker shows, in walking people."
        return "Expected", {axis: float(expected[axis]) for axis in AXES}, meaning
    healthy = dict(zip(AXES, HEALTHY_RMS, strict=True))
    return "Healthy", healthy, f"Healthy: RMS of {HEALTHY}; lower in lighter people."


def unseen_sentence(result: TrialResult, table: pd.DataFrame) -> str:
    """Say what is expected of the residuals closest to the truth, in a trial's `residual_table`."""
    best = table["headline"] & (table["compensated"] == (result.compensated is not None))
    share = mass_share(result.body, unseen_segments(result.body, result.motion))
    what = f"{100 * share:.0f} % of the body's mass has no markers"
    return expectation(table[best], what)


def expectation(residuals: pd.DataFrame, what: str = "Trunk, head or arms have no markers") -> str:
    """Say what RMS the motion of segments without markers leads to, and what was measured.

    Of rows of `residual_table`, in % of body weight; means where there are several of an axis.
    Recordings whose markers show trunk, head and arms do not count; empty where all do.
    """
    unseen = residuals[residuals["expected"].notna()]
    if unseen.empty:
        return ""
    percent = unseen.assign(expected=unseen["expected"] * unseen["rms_percent"] / unseen["rms"])
    means = percent.groupby("axis")[["expected", "rms_percent"]].mean()
    digits = dict(zip(AXES, (1, 1, 1, 2, 2, 2), strict=True))
    expected = [f"{axis} {means.expected[axis]:.{digits[axis]}f}" for axis in AXES]
    measured = [f"{means.rms_percent[axis]:.{digits[axis]}f}" for axis in AXES]
    some = " in some recordings" * (len(unseen) < len(residuals))
    return (
        f"{what}{some}; expected from that alone in walking: {', '.join(expected[:3])} % of body "
        f"weight, {', '.join(expected[3:])} % of body weight × stature; measured "
        f"{', '.join(measured)}."
    )


def height_of_mass(body: Body, q: Array) -> float:
    """Give the mean height of the centre of mass above the lowest joint of the feet [m].

    Of coordinates (T, 46), wherever the laboratory has its origin.
    """
    lowest = joint_positions(body, q, FOOT_SEGMENTS)[..., 2].min(axis=1)
    return float(np.mean(center_of_mass(body, q)[:, 2] - lowest))


def threshold_table(result: TrialResult) -> pd.DataFrame:
    """Compare a trial's peak residuals with published limits.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pandas.DataFrame
        compensated, quantity (force, moment), unit, peak, limit, passed, and the percentage of
        used frames above the limit; empty where no frame is used.

    Notes
    -----
    Hicks et al. 2015 (J Biomech Eng 137:020905): the peak residual force should stay below 5 % of
    the peak net external force, the peak residual moment below 1 % of the height of the centre of
    mass times that force. Peaks are of the vectors' magnitudes, over the used frames; the
    height is the mean one above the lowest joint of the feet (ankles and toes) in each frame.
    """
    inside = counted(result)
    if not inside.any():
        return pd.DataFrame(columns=THRESHOLD_COLUMNS)
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
            size = np.linalg.norm(part, axis=1)
            peak, above = float(size.max()), 100 * float(np.mean(size >= limit))
            compensated = name == "compensated"
            rows.append((compensated, quantity, unit, peak, limit, peak < limit, above))
    return pd.DataFrame(rows, columns=THRESHOLD_COLUMNS)


def marker_table(result: TrialResult) -> pd.DataFrame:
    """Give each marker's distance from the model, and its gaps.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    pandas.DataFrame
        marker, rms_mm, peak_mm, missing_percent, in the motion's order of markers; the last row,
        "all", is over all of them. RMS and peak of a marker that was never seen are NaN.
    """
    error_mm = 1000 * result.motion.marker_error
    seen = np.isfinite(error_mm)
    squares = np.where(seen, error_mm**2, 0.0).sum(axis=0)
    peak = np.where(seen, error_mm, -np.inf).max(axis=0, initial=-np.inf)
    # of each marker, and of all
    count, size, squares = (
        np.append(each, each.sum())
        for each in (seen.sum(axis=0), np.full(seen.shape[1], len(seen)), squares)
    )
    peak = np.append(peak, peak.max())
    with np.errstate(invalid="ignore"):  # of a marker that was never seen
        rms = np.sqrt(squares / count)
    columns = {"rms_mm": rms, "peak_mm": np.where(count > 0, peak, np.nan)}
    names = [*result.motion.markers, EVERY_MARKER]
    return pd.DataFrame({"marker": names, **columns, "missing_percent": 100 * (1 - count / size)})


def rows_of(table: pd.DataFrame) -> list[Any]:
    """Give the rows of a table, with its columns as attributes."""
    return list(table.itertuples())
