"""Residuals of a trial: over gait cycles, as tables, and beside published thresholds."""

from collections import namedtuple
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from math import isnan
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from hbm.model import Body
from hbm.numbers import read_numbers
from hbm.plausibility.motion import mass_share, unseen_covariance, unseen_segments
from hbm.poses import center_of_mass, joint_positions
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.quality import frames_within
from pipeline.trial.result import TrialResult

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "residuals")

if TYPE_CHECKING:
    import pandas as pd

HEALTHY_RMS: Final = (37.1, 30.4, 63.1, 11.4, 20.5, 4.5)
HEALTHY: Final = "healthy adults on a treadmill at rest (van de Loosdrecht 2018, Table III)"
"""RMS residuals [N, N·m], and of whom; they are lower in lighter people."""
AXES: Final = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
UNITS: Final = ("N", "N", "N", "N·m", "N·m", "N·m")
DIRECTIONS: Final = ("forward", "right", "up", "about forward", "about right", "about up")
TRIAL_COLUMNS: Final = ("subject", "condition", "recording", "session")
"""Which trial: the recording is empty where there is one of the condition."""
CYCLE_COLUMNS: Final = (
    *TRIAL_COLUMNS,
    *("compensated", "window", "headline", "side", "cycle", "start_s", "stop_s"),
    *("axis", "unit", "rms", "peak", "n_frames", "valid_share"),
)

Residual = namedtuple(
    "Residual",
    "subject condition recording session compensated window headline axis unit rms rms_of_cycles "
    "mean sd peak rms_percent n_cycles n_frames valid_share compensation_sd expected",
)
"""A row of `residual_table`."""
Threshold = namedtuple("Threshold", "compensated quantity unit peak limit passed above_percent")
"""A row of `threshold_table`."""
MarkerError = namedtuple("MarkerError", "marker rms_mm peak_mm missing_percent")
"""A row of `marker_rows`."""
CycleExtreme = namedtuple("CycleExtreme", "side start_s stop_s axis unit rms ratio")
"""A gait cycle, and the residual in it that is largest for its reference, `ratio` times that."""


class Window(NamedTuple):
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
    # from lab axes, with Y to the left, to the reported ones, with y to the right
    return np.asarray(residual * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0]))


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
    if result.span or result.part is None:
        return (Window("span" if result.span else result.unit, True, result.spans),)
    cycles = Window(result.unit, False, replace(result, part=None).spans)
    return Window(result.part.name, True, result.spans), cycles


def cycle_rows(result: TrialResult, condition: str) -> list[tuple[object, ...]]:
    """Give the residuals of every gait cycle that counts, as `cycles.csv` holds them.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the table.

    Returns
    -------
    list of tuple
        Rows of `CYCLE_COLUMNS`: subject, condition, recording, session, compensated, window and
        headline (as in `residual_table`), side, cycle (from 1 for each side), start_s, stop_s,
        axis, unit, rms and peak (largest magnitude) over the frames of the window in the cycle that
        count, their number and share; NaN where none counts. Empty where a span of the recording
        counts.
    """
    rows = []
    for name in result.variants:
        for window in () if result.span else windows(result):
            of_window = name == "compensated", window.name, window.headline
            for *cycle, rms, peak, count, valid_share in _of_cycles(result, name, window):
                before = *trial_columns(result, condition), *of_window, *cycle
                measures = zip(AXES, UNITS, rms.tolist(), peak.tolist(), strict=True)
                rows += [(*before, *measure, count, valid_share) for measure in measures]
    return rows


def trial_columns(result: TrialResult, condition: str) -> tuple[str, str, str, str]:
    """Give the `TRIAL_COLUMNS` of a trial."""
    return result.subject.id, condition, result.recording, result.session


def _of_cycles(
    result: TrialResult, variant: str, window: Window
) -> Iterator[tuple[str, int, float, float, Array, Array, int, float]]:
    """Give of each gait cycle side, number, start, stop, RMS, peak, (6,), used frames, share."""
    time, counts = result.motion.time, result.counts
    residual = reported(result.variants[variant].residual)
    for side, spans in window.of_sides.items():
        for number, (start, stop) in enumerate(spans.tolist(), start=1):
            # a cycle ends before the strike that begins the next one
            inside = (time >= start) & (time < stop)
            used = residual[inside & counts]
            rms = peak = np.full(len(AXES), np.nan)
            if len(used):
                rms, peak = np.sqrt(np.mean(used**2, axis=0)), np.abs(used).max(axis=0)
            valid_share = len(used) / max(1, int(np.count_nonzero(inside)))
            yield side, number, start, stop, rms, peak, len(used), valid_share


def worst_cycles(result: TrialResult) -> list[CycleExtreme]:
    """Give the gait cycles that count, that with the largest residual for its reference first.

    The plates are those closest to the truth; the reference of each axis is that of `reference_of`.
    """
    if not result.counted.any() or result.span:
        return []
    headline = [row for row in residual_rows(result) if row.headline]
    reference, worst = reference_of(headline)[1], list[CycleExtreme]()
    for side, _, start, stop, rms, *_ in _of_cycles(
        result, [*result.variants][-1], windows(result)[0]
    ):
        # each axis by its own reference, so that newtons and newton metres compare
        ratio = rms / np.array([reference[axis] for axis in AXES])
        if np.isfinite(ratio).all():
            k = int(ratio.argmax())
            row = side, start, stop, AXES[k], UNITS[k], float(rms[k]), float(ratio[k])
            worst.append(CycleExtreme(*row))
    return sorted(worst, key=lambda cycle: -cycle.ratio)


def residual_table(result: TrialResult, condition: str = "") -> "pd.DataFrame":
    """Summarise a trial's residuals, one row per variant and axis.

    Parameters
    ----------
    result
        The trial.
    condition
        Name of the condition, for the table; by default the trial's own.

    Returns
    -------
    pandas.DataFrame
        The headline window first; of each, as measured and then compensated; axes in the order of
        `AXES`. Empty where no frame of the headline window counts. The columns that are read most
        are at both ends, which pandas prints of a wide table.

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
            RMS over cycles of each cycle's RMS in the window, that of `cycle_rows`.
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
    import pandas as pd

    rows = residual_rows(result, condition or result.condition)
    table = pd.DataFrame(rows, columns=Residual._fields)
    # what is read most at both ends, which pandas prints of a wide table
    first, last = ("compensated", "axis", "rms", "mean"), ("sd", "peak", "window")
    return table[[*first, *table.columns.drop([*first, *last]), *last]]


def residual_rows(result: TrialResult, condition: str = "") -> list[Residual]:
    """Give the rows of `residual_table`; pandas takes longer to load than they to compute."""
    if not result.counted.any():
        return []
    names = trial_columns(result, condition)
    return [
        Residual(*names, name == "compensated", window.name, window.headline, *row)
        for window in windows(result)
        for name in result.variants
        for row in _summary(result, window, name)
    ]


def _summary(result: TrialResult, window: Window, variant: str) -> Iterator[tuple[Any, ...]]:
    """Summarise the residuals of one variant over one window: the rows from the axis on."""
    inside = frames_within(result.motion.time, *window.of_sides.values())
    counts = inside & result.counts
    # forces by body weight, moments by body weight × stature
    percent = result.body.mass * GRAVITY_MPS2 * np.repeat([1.0, result.body.height_m], 3) / 100
    value = reported(result.variants[variant].residual[counts])
    rms = np.sqrt(np.mean(value**2, axis=0))
    cycles = () if result.span else _of_cycles(result, variant, window)
    # mean squares of cycles, so that long and short ones count alike
    of_cycles = [rms_of_one**2 for *_, rms_of_one, _, count, _ in cycles if count]
    unknown = np.full(len(AXES), np.nan)
    rms_of_cycles = np.sqrt(np.mean(of_cycles, axis=0)) if of_cycles else unknown
    spread = unknown
    if variant == "compensated" and result.uncertainty is not None:
        spread = np.sqrt(np.mean(result.uncertainty[counts] ** 2, axis=0))
    # standard deviation by what segments without markers add to this motion
    expected = np.sqrt(np.diag(unseen_covariance(result.body, result.motion, counts)))
    peak, used = np.abs(value).max(axis=0), int(np.count_nonzero(counts))
    measures = rms, rms_of_cycles, value.mean(axis=0), value.std(axis=0), peak, rms / percent
    extent = len(of_cycles), used, used / int(np.count_nonzero(inside))
    uncertain = spread, np.where(expected > 0, expected, np.nan)
    of_axes = np.transpose([*measures, *uncertain]).tolist()
    for axis, unit, row in zip(AXES, UNITS, of_axes, strict=True):
        yield axis, unit, *row[: len(measures)], *extent, *row[len(measures) :]


def reference_of(residuals: Collection[Any]) -> tuple[str, Mapping[str, float], str]:
    """Give what RMS residuals are compared with: its title, size by axis, and meaning.

    Of rows of `residual_table`. Those of healthy people, of whom markers showed all segments; in
    recordings without, the mean of what is expected.
    """
    if unseen := [row for row in residuals if not isnan(row.expected)]:
        meaning = "Expected: by the motion of segments that no marker shows, in walking people."
        return "Expected", _means(unseen, lambda row: float(row.expected)), meaning
    healthy = dict(zip(AXES, HEALTHY_RMS, strict=True))
    return "Healthy", healthy, f"Healthy: RMS of {HEALTHY}; lower in lighter people."


def _means(rows: Iterable[Any], value: Callable[[Any], float]) -> dict[str, float]:
    """Give the mean of a value of rows of each axis."""
    of_axis: dict[str, list[float]] = {axis: [] for axis in AXES}
    for row in rows:
        of_axis[row.axis].append(value(row))
    return {axis: float(np.mean(values)) for axis, values in of_axis.items()}


def unseen_sentence(result: TrialResult, rows: Iterable[Any]) -> str:
    """Say what is expected of the residuals closest to the truth, in a trial's `residual_table`."""
    compensated = result.compensated is not None
    best = [row for row in rows if row.headline and row.compensated == compensated]
    fraction = mass_share(result.body, unseen_segments(result.body, result.motion))
    return expectation(best, f"{100 * fraction:.0f} % of the body's mass has no markers")


def expectation(
    residuals: Collection[Any], what: str = "Trunk, head or arms have no markers"
) -> str:
    """Say what RMS the motion of segments without markers leads to, and what was measured.

    Of rows of `residual_table`, in % of body weight; means where there are several of an axis.
    Recordings whose markers show trunk, head and arms do not count; empty where all do.
    """
    unseen = [row for row in residuals if not isnan(row.expected)]
    if not unseen:
        return ""
    expects = _means(unseen, lambda row: row.expected * row.rms_percent / row.rms)
    measures = _means(unseen, lambda row: float(row.rms_percent))
    digits = dict(zip(AXES, (1, 1, 1, 2, 2, 2), strict=True))
    expected = [f"{axis} {expects[axis]:.{digits[axis]}f}" for axis in AXES]
    measured = [f"{measures[axis]:.{digits[axis]}f}" for axis in AXES]
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
    # segments of the feet begin at the ankle and at the ball
    feet = "left_foot", "left_toes", "right_foot", "right_toes"
    lowest = joint_positions(body, q, feet)[..., 2].min(axis=1)
    # above the foot that is lower in each frame
    return float(np.mean(center_of_mass(body, q)[:, 2] - lowest))


def threshold_table(result: TrialResult) -> "pd.DataFrame":
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
    import pandas as pd

    return pd.DataFrame(threshold_rows(result), columns=Threshold._fields)


def threshold_rows(result: TrialResult) -> list[Threshold]:
    """Give the rows of `threshold_table`."""
    inside, rows = result.counted, list[Threshold]()
    if not inside.any():
        return rows
    q = result.motion.q[inside]
    height = height_of_mass(result.body, q)
    for name, dynamics in result.variants.items():
        ground = np.sum(list(result.ground[name].values()), axis=0)[inside, :3]
        # net external force: the sum of both feet, without gravity
        external = float(np.linalg.norm(ground, axis=1).max())
        residual = dynamics.residual[inside]
        for quantity, unit, part, limit in (
            ("force", "N", residual[:, :3], LIMITS.largest_force * external),
            ("moment", "N·m", residual[:, 3:], LIMITS.largest_moment * height * external),
        ):
            # magnitudes of the vectors, as published
            size = np.linalg.norm(part, axis=1)
            peak, above = float(size.max()), 100 * float(np.mean(size >= limit))
            compensated = name == "compensated"
            row = compensated, quantity, unit, peak, limit, peak < limit, above
            rows.append(Threshold(*row))
    return rows


def marker_rows(result: TrialResult) -> list[MarkerError]:
    """Give each marker's distance from the model, and its gaps.

    Parameters
    ----------
    result
        The trial.

    Returns
    -------
    list of MarkerError
        marker, rms_mm, peak_mm, missing_percent, in the motion's order of markers; the last row,
        "all", is over all of them. RMS and peak of a marker that was never seen are NaN.
    """
    error_mm = 1000 * result.motion.marker_error
    columns = dict(zip(result.motion.markers, error_mm.T, strict=True)) | {"all": error_mm}
    rows = []
    for name, column in columns.items():
        error = column[np.isfinite(column)]
        rms, peak = (np.sqrt(np.mean(error**2)), error.max()) if len(error) else (np.nan, np.nan)
        missing_percent = 100 * (1 - len(error) / column.size)
        rows.append(MarkerError(name, float(rms), float(peak), missing_percent))
    return rows


def rows_of(table: "pd.DataFrame") -> list[Any]:
    """Give the rows of a table, with its columns as attributes."""
    return list(table.itertuples())
