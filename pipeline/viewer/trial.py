"""A processed trial as a recording for the Rerun viewer."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import pandas as pd
import rerun as rr

from compensation.inertia.sensors import QUANTILE_95
from compensation.platform import PlatformPose
from hbm.markers import Markers
from hbm.notes import provenance, warnings_of
from hbm.spatial import Array, Indices
from pipeline.explain.budget import Bands
from pipeline.figures.joints import LEG
from pipeline.figures.residuals import SIDE_COLOURS
from pipeline.statistics.table_3 import markdown_table
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.residuals import (
    AXES,
    DIRECTIONS,
    HEALTHY_RMS,
    CycleExtreme,
    cycle_measures,
    reported,
    residual_rows,
    threshold_rows,
    unseen_sentence,
    windows,
    worst_cycles,
)
from pipeline.trial.result import TrialResult
from pipeline.viewer.file import Timelines, printable, recording_file
from pipeline.viewer.layout import LEGEND, log_text, trial_layout
from pipeline.viewer.plots import (
    changes_of,
    draw_curves,
    draw_residual_curves,
    log_marker_errors,
    log_states,
    send_curves,
    send_residual_curves,
)
from pipeline.viewer.scene import draw_scene, send_scene
from pipeline.viewer.serve import view

APPLICATION: Final = "hbm_residuals_trial"
VIEW_RATE_HZ: Final = 50.0
"""Smooth to the eye, and half of the file's size at a camera's 100 Hz."""
CYCLE: Final = "gait cycle"
"""Timeline whose steps are gait cycles, each shown where it stands out, with its RMS residuals."""
PERTURBATION_S: Final = 1.0
"""How long a perturbation is drawn; only its onset is known."""
PHASES: Final = {"foot_strike": "stance", "foot_off": "swing"}
PHASE_COLOURS: Final = {"stance": "#009E73", "swing": "#3A4A45"}
STATES: Final = {"perturbation": "#E69F00", "uncertain": "#CC79A7", "not used": "#BBBBBB"}
"""Colours of other states."""


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
        view(path, web=web, cursor=("time", round(opening_s(result) * 1e9)))


def write_recording(
    result: TrialResult, path: Path, *, view_hz: float = VIEW_RATE_HZ, bands: Bands | None = None
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
    """
    motion, markers = result.motion, result.markers
    shown = slice(None, None, max(1, round(markers.rate_hz / view_hz)))

    def clock(time: Array) -> Timelines:
        frame = np.rint((time - motion.time[0]) * markers.rate_hz).astype(int)
        return {"time": time, "frame": frame + result.first_frame}

    whole, view = clock(motion.time), clock(motion.time[shown])
    counts, uncertain = result.counts, ~free_of(result.quality, Quality.FOOT_UNCERTAIN)
    pushed = [
        change
        for onset in result.onsets.tolist()
        for change in ((onset, "perturbation"), (onset + PERTURBATION_S, ""))
    ]
    states = {
        "perturbation": pushed,
        "plate_split": changes_of(uncertain, motion.time, "uncertain"),
        "residual": changes_of(~counts, motion.time, "not used"),
    }
    has_phases = bool(result.events or any(states.values()))
    layout = trial_layout(motion.q[shown, :3], phases=has_phases)
    with recording_file(path, APPLICATION, _title(result), layout) as stream:
        draw_scene(stream, result.body, markers.names, result.plates, result.variants)
        _send_frames(stream, view, result, shown)
        curves = {
            name: np.where(counts[:, None], reported(dynamics.residual), np.nan)
            for name, dynamics in result.variants.items()
        }
        if bands is not None:
            curves |= _ends_of_bands(bands, motion.time)
        draw_residual_curves(stream, curves)
        send_residual_curves(stream, whole, curves)
        _send_cycles(stream, result)
        _send_joint_moments(stream, whole, result)
        log_marker_errors(stream, view, motion.markers, motion.marker_error[shown] * 1000)
        for side in ("left", "right"):
            phases = [(e.time, PHASES[e.label]) for e in result.events if e.side == side]
            log_states(stream, clock, f"foot_{side}", phases, PHASE_COLOURS)
        for row, changes in states.items():
            own = {state: STATES[state] for _, state in changes if state}
            log_states(stream, clock, row, changes, own)
        log_text(stream, "summary", printable(trial_summary(result)))
        log_text(stream, "legend", LEGEND)


def side_cycles(result: TrialResult) -> list[CycleExtreme]:
    """Give the gait cycles of the side with the worst one, the worst first; they may be none."""
    worst = worst_cycles(result)
    return [cycle for cycle in worst if cycle.side == worst[0].side]


def opening_s(result: TrialResult, at_s: float | None = None) -> float:
    """Give where a trial opens [s]: where stated, else in the worst gait cycle."""
    first, last = result.motion.time[[0, -1]]
    if at_s is None:
        return worst_instant(result, next(iter(side_cycles(result)), None))
    if not first <= at_s <= last:
        raise ValueError(f"--at {at_s:g}: {_title(result)} lasts from {first:.2f} to {last:.2f} s")
    return at_s


def worst_instant(result: TrialResult, cycle: CycleExtreme | None = None) -> float:
    """Give when the residual is largest for that of healthy people [s].

    In a gait cycle, in the axis that stands out, or in all that counts.
    """
    time, best = result.motion.time, [*result.variants.values()][-1]
    size, counts = np.abs(best.residual) / HEALTHY_RMS, result.counted
    if cycle is not None:
        size = size[:, AXES.index(cycle.axis), None]
        counts = result.counts & (time >= cycle.start_s) & (time < cycle.stop_s)
    return float(time[np.argmax(np.where(counts, size.max(axis=1), -1))])


def _send_cycles(stream: rr.RecordingStream, result: TrialResult) -> None:
    """Send the instant at which each gait cycle stands out, and its RMS residuals."""
    cycles = sorted(side_cycles(result), key=lambda cycle: cycle.number)
    if cycles:
        numbers = [cycle.number for cycle in cycles]
        instants = [worst_instant(result, cycle) for cycle in cycles]
        frames = np.searchsorted(result.motion.time, instants)
        rms = {
            name: np.array([
                rms
                for side, number, _, _, rms, *_ in cycle_measures(result, name, windows(result)[0])
                if side == cycles[0].side and number in numbers
            ])
            for name in result.variants
        }
        _send_frames(stream, {CYCLE: np.array(numbers)}, result, frames)
        send_residual_curves(stream, {CYCLE: np.array(numbers)}, rms)


def _send_frames(
    stream: rr.RecordingStream, timelines: Timelines, result: TrialResult, at: slice | Indices
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
        {n: np.where(counts, each.residual[at], np.nan) for n, each in result.variants.items()},
        surface_m=float(np.mean([plate.center[2] for plate in result.plates])),
        threshold_n=result.settings.contact_threshold_n,
    )


def _send_joint_moments(
    stream: rr.RecordingStream, timelines: Timelines, result: TrialResult
) -> None:
    """Send the moments of both legs by body mass [N·m/kg], of the plates closest to the truth."""
    tau = [*result.variants.values()][-1].tau / result.body.mass
    for motion in LEG:
        columns = [motion.column(side)[0] for side in SIDE_COLOURS]
        draw_curves(stream, f"joints/{motion.name}", [*SIDE_COLOURS], [*SIDE_COLOURS.values()])
        send_curves(stream, timelines, f"joints/{motion.name}", tau[:, columns])


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
    """Give residuals, peaks beside their limits and notes of a trial, in Markdown."""
    blocks = [f"# {_title(result)}"]
    if result.counted.any():
        rows = [row for row in residual_rows(result) if row.headline]
        shown = pd.DataFrame({"": AXES, "direction": DIRECTIONS})
        for name in result.variants:
            own = [row for row in rows if row.compensated == (name == "compensated")]
            shown[name] = [f"{row.rms:.1f} {row.unit}, {row.rms_percent:.2f} %" for row in own]
        peaks = pd.DataFrame(threshold_rows(result))
        limits = pd.DataFrame(
            {
                "plates": np.where(peaks["compensated"], "compensated", "measured"),
                "residual": peaks["quantity"],
                "peak": peaks["peak"],
                "limit": peaks["limit"],
                "unit": peaks["unit"],
                "": np.where(peaks["passed"], "passes", "**fails**"),
            }
        )
        blocks += [
            "## Pelvis residuals (RMS)",
            *filter(None, [unseen_sentence(result, rows)]),
            markdown(shown),
            "% of body weight, or of body weight × stature.",
            "## Peaks against Hicks et al. 2015",
            markdown(limits, 1),
        ]
    else:
        blocks.append("No frame is used: no residuals; see the warnings.")
    warnings = [f"- **{note}** `{note.code}`: {note.advice}" for note in warnings_of(result.notes)]
    items = pd.DataFrame(provenance(result.notes), columns=["item", " "]).replace(
        "[|]", "/", regex=True
    )
    blocks += ["## Warnings", "\n".join(warnings), "## Provenance", markdown(items)]
    return "\n\n".join(blocks)


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """Give a table as Markdown, numbers with so many digits after the point."""
    cells = [
        [f"{v:.{digits}f}" if isinstance(v, float) else str(v) for v in row]
        for row in table.itertuples(index=False)
    ]
    return markdown_table([*map(str, table.columns)], cells)
