"""A processed trial as a recording for the Rerun viewer."""

from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr

from compensation.platform import PlatformPose
from hbm.coordinates import MOVING
from hbm.markers import Markers
from hbm.poses import segment_frames
from hbm.spatial import Array
from pipeline.explain.budget import Bands
from pipeline.explain.shares import NORMAL_95
from pipeline.figures.residuals import residual_figure
from pipeline.figures.style import COLOURS
from pipeline.trial.gait.cycles import mean_and_sd, normalise
from pipeline.trial.residuals import AXES, cycle_residuals, reported, variants
from pipeline.trial.result import TrialResult
from pipeline.viewer.blueprint import cycle_layout, trial_layout
from pipeline.viewer.body import draw_body, send_body
from pipeline.viewer.file import Timelines, printable, recording_file
from pipeline.viewer.legend import LEGEND
from pipeline.viewer.plots import (
    PERTURBATION_COLOUR,
    UNCERTAIN_COLOUR,
    UNCOUNTED_COLOUR,
    draw_residual_curves,
    intervals_of,
    log_curves,
    log_intervals,
    log_marker_errors,
    log_phases,
    send_residual_curves,
)
from pipeline.viewer.scene import (
    draw_arrows,
    draw_markers,
    draw_plates,
    send_ground,
    send_markers,
    send_platform,
    send_residual,
)
from pipeline.viewer.summary import trial_summary

TRIAL_APPLICATION: Final = "hbm_residuals_trial"
CYCLE_APPLICATION: Final = "hbm_residuals_gait_cycle"
VIEW_RATE_HZ: Final = 50.0
"""Smooth to the eye, and half of the file's size at a camera's 100 Hz."""
PERTURBATION_S: Final = 1.0
"""How long a perturbation is drawn; only its onset is known."""
PELVIS: Final = MOVING.index("pelvis")


def write_recording(
    result: TrialResult,
    path: Path,
    *,
    view_hz: float = VIEW_RATE_HZ,
    bands: Bands | None = None,
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

    Raises
    ------
    ValueError
        If the rate is not positive.
    """
    if not view_hz > 0:
        raise ValueError(f"view_hz must be positive, got {view_hz}")
    motion, markers, body = result.motion, result.markers, result.body
    shown = slice(None, None, max(1, round(markers.rate_hz / view_hz)))
    rotation, origin = segment_frames(body, motion.q[shown])
    pelvis = origin[:, PELVIS]
    pose = result.platform and PlatformPose(
        result.platform.rotation[shown], result.platform.position[shown]
    )
    surface = float(np.mean([plate.center[2] for plate in result.plates]))

    def clock(time: Array) -> Timelines:
        frame = np.rint((time - motion.time[0]) * markers.rate_hz).astype(int)
        return {"time": time, "frame": frame + result.first_frame}

    whole, view = clock(motion.time), clock(motion.time[shown])
    perturbed = [(t, t + PERTURBATION_S, "perturbation") for t in result.onsets.tolist()]
    uncertain = intervals_of(result.ambiguous, motion.time, "uncertain")
    uncounted = intervals_of(~result.validity.counts, motion.time, "does not count")
    has_cycles = any(len(spans) for spans in result.cycles.values())
    has_phases = bool(result.events or uncertain or uncounted or perturbed)
    layout = trial_layout(pelvis, phases=has_phases, figure=has_cycles)
    with recording_file(path, TRIAL_APPLICATION, _title(result), layout) as stream:
        stream.log("lab", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("lab/axes", rr.TransformAxes3D(0.2), static=True)
        draw_body(stream, body)
        send_body(stream, view, rotation, origin)
        measured = Markers(markers.time[shown], markers.names, markers.position[shown])
        draw_markers(stream, markers.names)
        send_markers(stream, view, measured, body, rotation, origin)
        draw_plates(stream, result.plates)
        send_platform(stream, view, pose)
        for name, dynamics in variants(result).items():
            draw_arrows(stream, name)
            send_ground(
                stream,
                view,
                name,
                {foot: wrench[shown] for foot, wrench in result.ground[name].items()},
                surface_m=surface,
                platform=pose,
                threshold_n=result.settings.contact_threshold_n,
            )
            residual = np.where(result.validity.counts[:, None], dynamics.residual, np.nan)
            send_residual(stream, view, name, residual[shown], pelvis)
        curves = {
            n: np.where(result.validity.counts[:, None], reported(d.residual), np.nan)
            for n, d in variants(result).items()
        }
        if bands is not None:
            curves |= _ends_of_bands(bands, motion.time)
        draw_residual_curves(stream, list(curves))
        send_residual_curves(stream, whole, curves)
        log_marker_errors(stream, view, motion.markers, motion.marker_error[shown] * 1000)
        log_phases(stream, clock, result.events)
        log_intervals(stream, clock, "perturbation", perturbed, PERTURBATION_COLOUR)
        log_intervals(stream, clock, "plate_split", uncertain, UNCERTAIN_COLOUR)
        log_intervals(stream, clock, "residual", uncounted, UNCOUNTED_COLOUR)
        summary = printable(trial_summary(result))
        stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)
        stream.log("legend", rr.TextDocument(LEGEND, media_type="text/markdown"), static=True)
        if has_cycles:
            stream.log("gait_cycle", _figure(result), static=True)


def write_cycles(result: TrialResult, path: Path) -> None:
    """Write a trial's mean gait cycle for the viewer: mean stick figure, residuals mean ± SD.

    Parameters
    ----------
    result
        The processed trial. Its right cycles are shown; left ones stand in where there are none.
    path
        The file, ``.rrd``.

    Raises
    ------
    ValueError
        If the trial has no gait cycle.
    """
    side, spans = next(
        ((s, result.cycles[s]) for s in ("right", "left") if len(result.cycles.get(s, ()))),
        ("", np.empty((0, 2))),
    )
    if not side:
        raise ValueError(
            f"{result.source.name}: no gait cycle was found, so there is no mean one to show"
        )
    motion = result.motion
    settled = np.where(result.validity.settled[:, None], motion.q, np.nan)
    q, _ = mean_and_sd(normalise(motion.time, settled, spans))
    rotation, origin = segment_frames(result.body, q)
    timelines = {"gait_cycle_percent": np.arange(len(q))}
    title = f"{_title(result)}, mean of {len(spans)} {side} gait cycles"
    layout = cycle_layout(origin[:, PELVIS])
    with recording_file(path, CYCLE_APPLICATION, title, layout, opens=False) as stream:
        stream.log("lab", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        draw_body(stream, result.body)
        send_body(stream, timelines, rotation, origin)
        curves: dict[str, Array] = {}
        for name in variants(result):
            middle, spread = mean_and_sd(cycle_residuals(result, name)[side])
            draw_arrows(stream, name)
            send_residual(stream, timelines, name, reported(middle), origin[:, PELVIS])
            curves |= {
                f"{name}, mean": middle,
                f"{name}, +SD": middle + spread,
                f"{name}, −SD": middle - spread,
            }
        for k, axis in enumerate(AXES):
            log_curves(
                stream,
                timelines,
                f"residual/{axis}",
                np.column_stack([curve[:, k] for curve in curves.values()]),
                list(curves),
                [COLOURS[name.partition(",")[0]] for name in curves],
                [2.5 if name.endswith("mean") else 0.75 for name in curves],
            )


def _ends_of_bands(bands: Bands, time: Array) -> dict[str, Array]:
    """Give the ends of 95 % intervals at all frames of a trial, (T, 6); NaN where unexplained."""
    frames = np.searchsorted(time, bands.time)
    ends = {}
    for name, sign in (("95 % low", -1), ("95 % high", 1)):
        ends[name] = np.full((len(time), len(AXES)), np.nan)
        ends[name][frames] = bands.residual + sign * NORMAL_95 * bands.deviation
    return ends


def _title(result: TrialResult) -> str:
    return f"{result.subject.id} · {result.source.stem}"


def _figure(result: TrialResult) -> rr.EncodedImage:
    picture = BytesIO()
    residual_figure(result).savefig(picture, format="png", dpi=150)
    return rr.EncodedImage(contents=picture.getvalue(), media_type="image/png")
