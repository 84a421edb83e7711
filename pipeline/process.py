"""One trial, from what was recorded to the residuals: the whole method, top to bottom."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hbm.body import Body, build_body
from hbm.coordinates import SEGMENTS
from hbm.dynamics import Dynamics, filter_motion, inverse_dynamics_variants
from hbm.filtering import butterworth, resample
from hbm.kinematics import solve_ik
from hbm.markers import MarkerSet
from hbm.motion import Motion
from hbm.native import kernels
from hbm.skeleton import GRAVITY
from hbm.spatial import Array, Mask
from pipeline.contact import share_between_feet
from pipeline.cycles import gait_cycles, gait_events
from pipeline.delay import marker_plate_delay
from pipeline.recording import Event, Plate, Recording
from pipeline.study import Settings, Subject

WEIGHING_FRAMES = 100
STEADY_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class TrialResult:
    """Everything that is known of a trial once it has been processed.

    Attributes
    ----------
    source
        The recording's file.
    subject, settings
        As stated.
    body
        The subject's body.
    motion
        Filtered motion with marker errors.
    measured
        Dynamics with the plates as measured.
    compensated
        Dynamics with the platform's artefacts removed; None without a calibration.
    ground
        Per variant ("measured", "compensated") the filtered wrench on each foot, (T, 6), lab axes
        about the lab origin.
    events
        Gait events.
    cycles
        Side -> start and stop of each gait cycle, (C, 2) [s].
    delay_s, delay_uncertainty_s
        How much later the plates are than the markers, and its standard error; NaN where unknown.
    ambiguous
        Frames in which the split of a plate between the feet is uncertain, (T,).
    notes
        Whatever was inferred, locked, filled or refused, as sentences.
    """

    source: Path
    subject: Subject
    settings: Settings
    body: Body
    motion: Motion
    measured: Dynamics
    compensated: Dynamics | None
    ground: dict[str, dict[str, Array]]
    events: tuple[Event, ...]
    cycles: dict[str, Array]
    delay_s: float
    delay_uncertainty_s: float
    ambiguous: Mask
    notes: tuple[str, ...]


def process_recording(
    recording: Recording,
    subject: Subject,
    settings: Settings,
    *,
    static: Recording | None = None,
    static_window_s: tuple[float, float] | None = None,
    marker_set: MarkerSet | None = None,
    jobs: int = 1,
) -> TrialResult:
    """Process one trial.

    Parameters
    ----------
    recording
        The trial.
    subject, settings
        Who walked, and how to process.
    static
        Recording of the calibration pose; by default the trial itself.
    static_window_s
        Where the pose is in it [s]; by default its quietest second.
    marker_set
        A marker set of one's own; by default recognised from the labels.
    jobs
        Threads.

    Returns
    -------
    TrialResult
        With the plates as measured.

    Raises
    ------
    ValueError
        If the trial has no plates, no known markers, no usable mass, or is too short.
    """
    pose = static or recording
    _require_plates(recording)
    mass, weighed = _body_mass(subject, pose)
    body = build_body(
        pose.markers,
        mass=mass,
        sex=subject.sex,
        height_m=subject.height_m,
        marker_set=marker_set or settings.marker_set,
        window_s=static_window_s,
        hip=settings.hip,
        marker_offset_m=settings.marker_offset_m,
    )
    raw = solve_ik(body, recording.markers, jobs=jobs)
    motion = filter_motion(raw, cutoff=settings.cutoff_hz, method=settings.filter)

    plates = [plate_at(plate, motion.time, settings.plate_delay_s) for plate in recording.plates]
    feet, ambiguous = share_between_feet(plates, feet_of(body, raw), settings.contact_threshold_n)
    ground = {
        foot: butterworth(wrench, motion.time, settings.cutoff_hz, settings.filter).value
        for foot, wrench in feet.items()
    }
    (measured,) = inverse_dynamics_variants(body, motion, [ground], jobs=jobs)

    events, which = gait_events(recording)
    cycles, rejected = cut_cycles(events, measured)
    delay, uncertainty, said = _delay(measured, ground, motion)
    return TrialResult(
        source=recording.source,
        subject=subject,
        settings=settings,
        body=body,
        motion=motion,
        measured=measured,
        compensated=None,
        ground={"measured": ground},
        events=events,
        cycles=cycles,
        delay_s=delay,
        delay_uncertainty_s=uncertainty,
        ambiguous=ambiguous,
        notes=(
            *recording.notes,
            weighed,
            *body.notes,
            *_motion_notes(body, raw),
            which,
            *rejected,
            said,
        ),
    )


def plate_at(plate: Plate, time: Array, delay_s: float) -> Array:
    """Give a plate's wrench at the markers' times, (T, 6), lab axes about the lab origin.

    Parameters
    ----------
    plate
        The plate.
    time
        Marker times, (T,) [s].
    delay_s
        How much later the plate is than the markers [s].
    """
    return resample(plate.time, plate.wrench, time + delay_s)


def feet_of(body: Body, motion: Motion) -> Array:
    """Give the middle of the left and right foot, ankle to toes, in the lab, (T, 2, 3) [m]."""
    poses = kernels().segment_poses(motion.q, body.geometry)[0].reshape(len(motion.q), -1, 12)
    origin = {s: poses[:, SEGMENTS.index(s), 9:] for s in SEGMENTS}
    return np.stack(
        [(origin[f"{side}_foot"] + origin[f"{side}_toes"]) / 2 for side in ("left", "right")], 1
    )


def cut_cycles(
    events: Sequence[Event], dynamics: Dynamics
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Cut gait cycles of both sides; leave out those with undefined frames, with the reason."""
    undefined = dynamics.time[np.isnan(dynamics.residual).any(axis=1)]
    cycles, rejected = {}, []
    for side in ("left", "right"):
        spans, reasons = gait_cycles(events, side)
        hit = [bool(((undefined >= a) & (undefined < b)).any()) for a, b in spans]
        rejected += [
            *reasons,
            *(
                f"{side} cycle {a:.2f}–{b:.2f} s has frames without a solution"
                for (a, b), bad in zip(spans, hit, strict=True)
                if bad
            ),
        ]
        cycles[side] = spans[~np.array(hit, bool)]
    return cycles, tuple(rejected)


def _require_plates(recording: Recording) -> None:
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: the file has no force plates; residuals need the ground "
            "reaction wrench (FORCE_PLATFORM group, or a second file with forces)"
        )


def _body_mass(subject: Subject, pose: Recording) -> tuple[float, str]:
    """Give body mass as stated, or weighed over the first frames of the calibration pose."""
    if subject.mass_kg is not None:
        return subject.mass_kg, f"body mass {subject.mass_kg:.1f} kg as given"
    name = pose.source.name
    if not pose.plates:
        raise ValueError(f"{name}: mass missing, and there are no plates to weigh by; state it")
    total = np.sum([plate.wrench[:, 2] for plate in pose.plates], axis=0)
    first = pose.plates[0].time < pose.markers.time[0] + WEIGHING_FRAMES / pose.markers.rate_hz
    weight, mean = total[first], float(np.nanmean(total)) / GRAVITY
    if np.std(weight) > STEADY_SHARE * np.mean(weight) or np.mean(weight) < 10 * GRAVITY:
        hint = f"; the mean vertical force of the whole file would be {mean:.1f} kg" * (mean > 10)
        raise ValueError(
            f"{name}: mass missing: nobody stands still on the plates in the first "
            f"{WEIGHING_FRAMES} frames to be weighed; state the mass{hint}"
        )
    mass = float(np.mean(weight)) / GRAVITY
    return mass, f"body mass {mass:.1f} kg by the plates, first {WEIGHING_FRAMES} frames of {name}"


def _motion_notes(body: Body, motion: Motion) -> list[str]:
    """Say what was locked, bridged or not solved."""
    notes = []
    if body.locked:
        notes.append(f"locked at neutral, for no marker shows them: {', '.join(body.locked)}")
    locked = np.array([name in body.locked for name in motion.names])
    lost = (~motion.observed & motion.converged[:, None])[:, ~locked]
    if lost.any():
        names = [
            n for n, hit in zip(np.array(motion.names)[~locked], lost.any(0), strict=True) if hit
        ]
        notes.append(
            f"bridged in time over {np.count_nonzero(lost.any(axis=1))} frames without enough "
            f"markers: {', '.join(names)}"
        )
    gaps = int(np.isnan(motion.marker_error).sum())
    if gaps:
        notes.append(f"{gaps} marker samples are missing and were left out of the fit")
    failed = int(np.count_nonzero(~motion.converged))
    if failed:
        notes.append(f"{failed} of {len(motion.time)} frames could not be solved")
    return notes


def _delay(
    dynamics: Dynamics, ground: dict[str, Array], motion: Motion
) -> tuple[float, float, str]:
    """Estimate how much later the plates are than the markers."""
    plates = np.sum([wrench[:, :3] for wrench in ground.values()], axis=0)
    needed = dynamics.residual[:, :3] + plates
    try:
        delay, uncertainty = marker_plate_delay(plates, needed, motion.time)
    except ValueError as error:
        return np.nan, np.nan, f"delay of the plates unknown: {error}"
    return (
        delay,
        uncertainty,
        f"plates are {delay * 1000:.1f} ± {uncertainty * 1000:.1f} ms later than the markers",
    )
