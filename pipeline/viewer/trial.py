"""A processed trial as a recording for the Rerun viewer."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import rerun as rr

from compensation.inertia.sensors import QUANTILE_95
from compensation.platform import PlatformPose
from hbm.markers import Markers
from hbm.notes import warnings_of
from hbm.spatial import Array, Indices, Mask
from pipeline.explain.budget import Bands
from pipeline.figures.joints import LEG
from pipeline.figures.residuals import SIDE_COLOURS
from pipeline.statistics.table_3 import markdown_table
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import (
    AXES,
    DIRECTIONS,
    HEALTHY_RMS,
    UNITS,
    CycleExtreme,
    reported,
    residual_rows,
    unseen_sentence,
    worst_cycles,
)
from pipeline.trial.result import TrialResult
from pipeline.viewer import plots
from pipeline.viewer.file import Clock, Folder, Stream, Timelines, printable, recording_file, send
from pipeline.viewer.layout import (
    CYCLE,
    PERCENT,
    ROWS,
    beside_layout,
    log_legend,
    log_text,
    trial_layout,
)
from pipeline.viewer.scene import draw_scene, send_scene
from pipeline.viewer.serve import Cursor, view

VIEW_RATE_HZ: Final = 50.0
"""Smooth to the eye, and half of the file's size at a camera's 100 Hz."""
STEPPING: Final = """\
Choose the timeline `gait cycle` below, and press ← or →: each gait cycle is shown where it stands \
out, curves are its RMS residuals. On `gait cycle, %`, 1235 is 35 % of the 12th."""
STATES: Final = {
    **{"stance": "#009E73", "swing": "#3A4A45", "perturbation": "#E69F00"},
    **{"uncertain": "#CC79A7", "not used": "#BBBBBB"},
}
"""Colours of states."""


def view_result(result: TrialResult, *, web: bool = False) -> None:
    """Show a trial in the viewer's window, or in a browser (``web``), until it is closed.

    It opens where the residual of the worst gait cycle is largest.

    Parameters
    ----------
    result
        The processed trial, with its frames.
    web
        Whether the page is served to a browser on this machine, until Ctrl-C.

    Raises
    ------
    OSError
        If there is no screen, or the viewer does not start.

    Examples
    --------
    >>> import hbm_residuals as hr
    >>> hr.view(hr.read_result("results/trials/sub01_sway.parquet"))  # doctest: +SKIP
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trial.rrd"
        write_recording(result, path)
        view(path, web=web, cursor=opening(result))


def write_recording(
    result: TrialResult,
    path: Path,
    *,
    view_hz: float = VIEW_RATE_HZ,
    bands: Bands | None = None,
    beside: TrialResult | None = None,
    video: tuple[Path, float] | None = None,
) -> None:
    """Write a trial for the viewer, with its layout.

    Parameters
    ----------
    result
        The processed trial.
    path
        The file, ``.rrd``.
    view_hz
        Rate of the scene and of the marker errors; residual curves keep the full rate.
    bands
        How sure the residuals are, where the trial is explained.
    beside
        Another trial, shown next to it at the same percentage of the same gait cycle.
    video
        An MP4 file of the trial, and when in the trial it begins [s].

    Raises
    ------
    ValueError
        If one of two trials has no gait cycle that counts, or the video cannot be read.
    """
    trials = [result, *([beside] if beside is not None else [])]
    side = next((cycle.side for cycle in side_cycles(result)), "")
    worst = _start(result, side)
    paths = {_title(trial): trial.motion.q[:, :3] for trial in trials}
    if beside is None:
        layout = trial_layout(result.motion.q[:, :3], video=video is not None)
    else:
        if not all(side and side_cycles(trial, side) for trial in trials):
            raise ValueError(f"{path.stem}: side by side needs gait cycles that count in both")
        curves = [curve for trial in trials for curve in _residuals(trial).values()]
        scales = np.nanmax(np.abs(np.concatenate(curves)), axis=0).tolist()
        layout = beside_layout(paths, scales, video=video is not None)
    with recording_file(path, "hbm_residuals_trial", " beside ".join(paths), layout) as stream:
        for k, trial in enumerate(trials):
            folder = stream if beside is None else Folder(stream, f"trial_{k}")
            _send_trial(folder, trial, side, view_hz, None if k else bands, worst)
        if video is not None:
            _send_video(stream, _clock(result, side), result.motion.time[0], *video)
        log_legend(stream)


def _send_trial(
    stream: Stream,
    result: TrialResult,
    side: str,
    view_hz: float,
    bands: Bands | None,
    worst: int,
) -> None:
    """Send all of a trial, with the gait cycles of a side; its worst one begins at a percentage."""
    shift = worst - _start(result, side)
    motion, markers, clock = result.motion, result.markers, _clock(result, side, shift)
    shown = slice(None, None, max(1, round(markers.rate_hz / view_hz)))
    whole, view = clock(motion.time), clock(motion.time[shown])
    draw_scene(stream, result.body, markers.names, result.plates, result.variants)
    _send_frames(stream, view, result, shown)
    curves = _residuals(result)
    if bands is not None:
        curves |= _ends_of_bands(bands, motion.time)
    plots.draw_residual_curves(stream, curves)
    plots.send_residual_curves(stream, whole, curves)
    if cycles := side_cycles(result, side):
        _send_cycles(stream, result, sorted(cycles, key=lambda cycle: cycle.start_s), shift)
    # moments of both legs by body mass [N·m/kg], of the plates closest to the truth
    tau = [*result.variants.values()][-1].tau / result.body.mass
    for motion_of_leg in LEG:
        entity = f"joints/{motion_of_leg.name}"
        columns = [motion_of_leg.column(side)[0] for side in SIDE_COLOURS]
        plots.draw_curves(stream, entity, [*SIDE_COLOURS], [*SIDE_COLOURS.values()])
        plots.send_curves(stream, whole, entity, tau[:, columns])
    plots.log_marker_errors(stream, view, motion.markers, motion.marker_error[shown] * 1000)
    for row, changes in _states(result).items():
        plots.log_states(stream, clock, row, changes, STATES)
    log_text(stream, "summary", printable(trial_summary(result)))


def _clock(result: TrialResult, side: str, shift: int = 0) -> Clock:
    """Give the clock of a trial; one timeline counts the gait cycles of a side, if any."""

    def clock(time: Array) -> Timelines:
        frame = np.rint((time - result.motion.time[0]) * result.markers.rate_hz).astype(int)
        lines = {"time": time, "frame": frame + result.first_frame}
        return lines | ({PERCENT: _percent(result, side, time, shift)} if side else {})

    return clock


def _percent(result: TrialResult, side: str, time: Array, shift: int = 0) -> Indices:
    """Give 100 times the number of the gait cycle, plus its percentage, at instants [s].

    Foot strikes of a side are counted, from the shift on. All that is before the first one is in
    its place: segments of a trial that begins later would be drawn without their poses.
    """
    strike = side, "foot_strike"
    strikes = sorted(e.time for e in result.events if (e.side, e.label) == strike)
    percent = [100, *(shift + 100 * np.arange(1, len(strikes) + 1))]
    of_time = np.interp(time, [result.motion.time[0], *strikes], percent)
    return np.asarray(np.rint(np.maximum(of_time, 100)), int)


def _start(result: TrialResult, side: str) -> int:
    """Give where the worst gait cycle of a side begins, as `_percent` does; 0 without any."""
    starts = [cycle.start_s for cycle in side_cycles(result, side)[:1]]
    # a part of a gait cycle may count, which begins after the foot strike
    return int(_percent(result, side, np.array(starts[0]))) // 100 * 100 if starts else 0


def _residuals(result: TrialResult) -> dict[str, Array]:
    """Give the residuals of each variant in the reported axes, (T, 6); NaN where none counts."""
    counts = result.counts[:, None]
    return {
        name: np.where(counts, reported(dynamics.residual), np.nan)
        for name, dynamics in result.variants.items()
    }


def _states(result: TrialResult) -> dict[str, list[tuple[float, str]]]:
    """Give the states of each row: from which time on [s] which one; "" is none."""
    time, onsets = result.motion.time, result.onsets
    # a perturbation is drawn for a second: only its onset is known
    pushed = (time[:, None] >= onsets) & (time[:, None] < onsets + 1.0)
    uncertain = ~free_of(result.quality, Quality.FOOT_UNCERTAIN)
    begins = {"foot_strike": "stance", "foot_off": "swing"}
    phases = (
        [(event.time, begins[event.label]) for event in result.events if event.side == side]
        for side in ("left", "right")
    )
    changes = (
        plots.changes_of(np.asarray(pushed.any(axis=1)), time, "perturbation"),
        plots.changes_of(uncertain, time, "uncertain"),
        plots.changes_of(~result.counts, time, "not used"),
    )
    return dict(zip(ROWS, (*phases, *changes), strict=True))


def _send_video(
    stream: rr.RecordingStream, clock: Clock, first_s: float, path: Path, start_s: float
) -> None:
    """Send a video that begins at a time of the trial [s]; the viewer decodes it."""
    try:
        video = rr.AssetVideo(contents=path.read_bytes(), media_type="video/mp4")
        shown_ns = video.read_frame_timestamps_nanos()
    except RuntimeError as error:
        raise ValueError(f"{path}: no MP4 video that can be read ({error})") from error
    stream.log("video", video, static=True)
    seconds = start_s + shown_ns / 1e9
    during = seconds >= first_s  # before a trial, its segments have no poses yet
    send_video = clock(seconds[during]), rr.VideoFrameReference, np.ones((during.sum(), 1), bool)
    send(stream, "video", *send_video, timestamp=shown_ns[during, None])


def side_cycles(result: TrialResult, side: str = "") -> list[CycleExtreme]:
    """Give the gait cycles of a side, or of that of the worst one, the worst first, if any."""
    worst = worst_cycles(result) if result.events else []
    return [cycle for cycle in worst if cycle.side == (side or worst[0].side)]


def opening(result: TrialResult, at_s: float | None = None, *, beside: bool = False) -> Cursor:
    """Give where a trial opens: where stated [s], else where its worst gait cycle stands out."""
    time, cycles = result.motion.time, side_cycles(result)
    if at_s is None and cycles:
        at_s = float(time[_worst_frame(result, cycles[0])])
    elif at_s is None:
        residual = np.abs([*result.variants.values()][-1].residual) / HEALTHY_RMS
        at_s = float(time[np.argmax(np.where(result.counted, residual.max(axis=1), -1))])
    if not time[0] <= at_s <= time[-1]:
        lasts = f"lasts from {time[0]:.2f} to {time[-1]:.2f} s"
        raise ValueError(f"--at {at_s:g}: {_title(result)} {lasts}")
    if beside and cycles:
        return PERCENT, int(_percent(result, cycles[0].side, np.array(at_s)))
    return "time", round(at_s * 1e9)


def _worst_frame(result: TrialResult, cycle: CycleExtreme) -> int:
    """Give the frame of a gait cycle with the largest residual in the axis that stands out."""
    residual = [*result.variants.values()][-1].residual[:, AXES.index(cycle.axis)]
    return int(np.argmax(np.where(_used(result, cycle), np.abs(residual), -1)))


def _used(result: TrialResult, cycle: CycleExtreme) -> Mask:
    time = result.motion.time
    return np.asarray(result.counts & (time >= cycle.start_s) & (time < cycle.stop_s))


def _send_cycles(
    stream: Stream, result: TrialResult, cycles: list[CycleExtreme], shift: int
) -> None:
    """Send the instant at which each gait cycle stands out, and its RMS residuals."""
    starts = np.array([cycle.start_s for cycle in cycles])
    number = {CYCLE: _percent(result, cycles[0].side, starts, shift) // 100}
    _send_frames(stream, number, result, np.array([_worst_frame(result, one) for one in cycles]))
    rms = {
        name: np.array([np.sqrt(np.mean(curve[_used(result, one)] ** 2, axis=0)) for one in cycles])
        for name, curve in _residuals(result).items()
    }
    plots.send_residual_curves(stream, number, rms)


def _send_frames(
    stream: Stream, timelines: Timelines, result: TrialResult, at: slice | Indices
) -> None:
    """Send the scene of some frames."""
    markers, counts = result.markers, result.counts[at, None]
    pose = result.platform
    send_scene(
        stream,
        timelines,
        result.body,
        result.motion.q[at],
        Markers(markers.time[at], markers.names, markers.position[at]),
        pose and PlatformPose(pose.rotation[at], pose.position[at]),
        {n: np.stack(list(result.ground[n].values()), 1)[at] for n in result.variants},
        {n: np.where(counts, v.residual[at], np.nan) for n, v in result.variants.items()},
        surface_m=float(np.mean([plate.center[2] for plate in result.plates])),
        threshold_n=result.settings.contact_threshold_n,
    )


def _ends_of_bands(bands: Bands, time: Array) -> dict[str, Array]:
    """Give the ends of 95 % intervals at all frames of a trial, (T, 6); NaN where unexplained."""
    frames = np.searchsorted(time, bands.time)
    ends = {}
    for name, sign in (("95 % low", -1), ("95 % high", 1)):
        ends[name] = np.full((len(time), len(AXES)), np.nan)
        ends[name][frames] = bands.residual + sign * QUANTILE_95 * bands.deviation
    return ends


def _title(result: TrialResult) -> str:
    return f"{result.subject.id} · {result.source.stem}"


def trial_summary(result: TrialResult) -> str:
    """Give residuals and warnings of a trial, in Markdown; its page has the rest."""
    blocks = [f"# {_title(result)}", "No frame is used: no residuals; see the warnings."]
    if rows := [row for row in residual_rows(result) if row.headline]:
        heads = [f"{axis} {DIRECTIONS[k % 3]}, {UNITS[k]}" for k, axis in enumerate(AXES)]
        cells = [f"{row.rms:.1f} ({row.rms_percent:.2f} %)" for row in rows]
        columns = (cells[k : k + len(AXES)] for k in range(0, len(cells), len(AXES)))
        blocks[1:] = [
            "## Pelvis residuals (RMS)",
            *filter(None, [unseen_sentence(result, rows)]),
            markdown_table(["", *result.variants], [*zip(heads, *columns, strict=True)]),
            "% of body weight, or of body weight × stature.",
        ]
    warnings = [f"- **{note}** `{note.code}`: {note.advice}" for note in warnings_of(result.notes)]
    return "\n\n".join(
        [*blocks, "## Warnings", "\n".join(warnings) or "None.", "## Gait cycles", STEPPING]
    )
