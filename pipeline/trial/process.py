"""One trial from recording to residuals: the whole method, top to bottom."""

from collections.abc import Mapping, Sequence

import numpy as np

from hbm.dynamics import filter_motion, inverse_dynamics_variants
from hbm.engines.engine import choose_engine
from hbm.markers import MarkerSet, recognise_marker_set
from hbm.motion import Motion
from hbm.notes import Note
from hbm.overrides import SegmentOverride
from hbm.plausibility.motion import implausible
from hbm.plausibility.outliers import solve_motion
from hbm.signals.filtering import acceleration_lag_s, low_pass
from hbm.spatial import GRAVITY_MPS2, Array, Mask
from pipeline.config.schema import (
    Condition,
    EventMethod,
    PlateContact,
    Settings,
    Subject,
    Treadmill,
)
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments
from pipeline.io.recording import Event, Recording
from pipeline.trial.delay import plate_delay
from pipeline.trial.event_check import check_events, reference_events
from pipeline.trial.gait.contact import (
    SharedPlates,
    contact_notes,
    feet_of,
    forces_of_legs,
    share_between_feet,
)
from pipeline.trial.gait.cycle_selection import select_cycles
from pipeline.trial.gait.cycles import cut_cycles, found_cycles
from pipeline.trial.gait.detection import TIMED_BY_PLATES, EventSources, detect_events
from pipeline.trial.gait.event_agreement import agreement_with_plates
from pipeline.trial.gait.foot_motion_events import foot_motion
from pipeline.trial.gait.perturbations import perturbation_onsets
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.ground.loads import plate_loads
from pipeline.trial.ground.uncertainty import sum_deviation, uncertainty_notes
from pipeline.trial.ground.wrenches import Ground, ground_wrenches
from pipeline.trial.marker_check import check_markers, other_person
from pipeline.trial.motion_check import check_motion, known_frames, shown_frames
from pipeline.trial.plate_check import check_plates
from pipeline.trial.quality import (
    NO_SUPPORT,
    Quality,
    carried_notes,
    flagged,
    free_of,
    settled_frames,
    settling_s,
)
from pipeline.trial.result import CompensationUncertainty, PlateSurface, TrialResult
from pipeline.trial.study_files import (
    naming_unused_renames,
    read_study_file,
    read_study_laboratory,
    with_unused_renames,
)
from pipeline.trial.subject_body import subject_body
from pipeline.trial.weighing import ON_PLATES, BodyMass, body_mass, carried_mass, differing_masses
from pipeline.trial.weight_bearing import weight_bearing_frames
from pipeline.trial.window import WantedWindow, counted_span, perturbed_part, window_notes


def process_recording(
    recording: Recording,
    subject: Subject,
    settings: Settings,
    *,
    static: Recording | None = None,
    static_window_s: tuple[float, float] | None = None,
    hip_trial: Recording | None = None,
    segments: Mapping[str, SegmentOverride] | None = None,
    marker_set: MarkerSet | None = None,
    laboratory: Laboratory | None = None,
    condition: Condition | None = None,
    window: WantedWindow = None,
    contacts: Sequence[PlateContact] = (),
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
        Start and end of the pose in it [s]; by default its quietest second.
    hip_trial
        Recording in which the thighs swing, where ``settings.hip`` is "functional".
    segments
        Segment -> what is known better than the table of inertias.
    marker_set
        A marker set of one's own; by default recognised from the labels.
    laboratory
        The treadmill and its calibrations; by default one that stands still.
    condition
        Which gait cycles count; by default all of the right foot, or of the left one if the right
        has none.
    window
        What counts: "cycle", "recording", or a span (start, stop) [s]; by default gait cycles, and
        the whole recording where there is none.
    contacts
        Whose foot was on a plate, where a person knows better.
    jobs
        Threads.

    Returns
    -------
    TrialResult
        With the plates as measured and, given a calibration, compensated; both from the same
        motion.

    Raises
    ------
    ValueError
        If the trial has no plates, no known markers, no usable mass, or is shorter than the filter
        needs; if a stated span or contact is not in it; if the engine cannot be imported, or the
        other one disagrees with it.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> f"{result.body.mass:.1f} kg, {len(result.cycles['right'])} gait cycles"
    '74.6 kg, 3 gait cycles'
    """
    laboratory = laboratory or Laboratory(Treadmill())
    _require_plates(recording)
    recording = with_corrected_plates(recording, laboratory.plates)
    pose = with_corrected_plates(static, laboratory.plates) if static else recording
    choose_engine(settings.engine)
    mass = _body_mass(subject, settings, pose, recording, marker_set)
    body = subject_body(
        pose,
        subject,
        settings,
        mass.mass_kg,
        window_s=static_window_s,
        marker_set=marker_set,
        hip_trial=hip_trial,
        segments=segments,
    )
    markers, unfiltered, outlier_notes = solve_motion(
        body, recording.markers, settings.filter, jobs
    )
    motion = filter_motion(unfiltered, cutoff=settings.cutoff_hz, method=settings.filter)

    ground = ground_wrenches(
        recording,
        laboratory,
        motion.time,
        settings.plate_delay_s,
        settings.cutoff_hz,
        settings.filter,
    )
    best, feet = ground.variants[ground.best], feet_of(body, unfiltered)
    under_feet = share_between_feet(
        motion.time,
        best,
        feet,
        settings.contact_threshold_n,
        numbers=[plate.number for plate in recording.plates],
        stated=contacts,
        method=settings.filter,
    )
    shared = {
        variant: under_feet.with_wrenches(plates) for variant, plates in ground.variants.items()
    }
    wrenches = {
        variant: _filtered(by_variant.by_foot, motion, settings)
        for variant, by_variant in shared.items()
    }
    by_variant = inverse_dynamics_variants(
        body, motion, [*wrenches.values()], jobs=jobs, engine=settings.engine
    )
    dynamics = dict(zip(wrenches, by_variant, strict=True))

    sources = EventSources(
        recording.events,
        markers,
        body.marker_set,
        foot_motion(body, motion.time, unfiltered.q, ground.pose),
        under_feet.contacts,
        plate_loads(recording, laboratory, settings.plate_delay_s, ground.accelerations),
        body.mass * GRAVITY_MPS2,
    )
    events, method, events_note = detect_events(sources, settings.events)
    known, shown = known_frames(body, motion), shown_frames(body, unfiltered)
    settling = settling_s(laboratory.filters(settings))
    computed = [np.isfinite(each.residual).all(axis=1) for each in dynamics.values()]
    gapless = np.all([known, shown, *computed], axis=0)
    total = np.sum([*wrenches[ground.best].values()], axis=0)
    vertical = total[:, 2] + dynamics[ground.best].residual[:, 2], total[:, 2]
    supports = weight_bearing_frames(
        body, motion, recording.plates, ground, under_feet, vertical, settings
    )
    quality = flagged(
        {
            Quality.POSE_UNKNOWN: ~known,
            Quality.LIMB_UNSEEN: ~shown,
            Quality.FORCES_UNKNOWN: ~ground.known,
            Quality.NOT_CARRIED: ~supports,
            Quality.SETTLING: ~settled_frames(gapless, motion.time, settling),
            Quality.FOOT_UNCERTAIN: under_feet.ambiguous,
        }
    )
    supported, counts = free_of(quality, NO_SUPPORT), free_of(quality)
    unknown = forces_of_legs(~free_of(quality, NO_SUPPORT | Quality.FOOT_UNCERTAIN))
    unknown |= ~free_of(quality, Quality.SETTLING)[:, None]
    dynamics = {variant: each.without_forces(unknown) for variant, each in dynamics.items()}
    cycles, cycle_notes = cut_cycles(events, motion.time, quality, settings.min_valid_share)
    rule = condition or Condition()
    onsets = perturbation_onsets(recording, rule, ground.pose) if rule.perturbed else np.empty(0)
    selected, selection_notes = select_cycles(cycles, rule, onsets)
    part, part_notes = perturbed_part(rule, selected, onsets, time=motion.time, pose=ground.pose)
    span = counted_span(
        window,
        selected,
        motion.time,
        settling,
        counts=counts,
        min_valid_share=settings.min_valid_share,
    )

    uncertainty = _uncertainty(ground, motion)
    residual = np.where(counts[:, None], dynamics[ground.best].residual, np.nan)
    lag_s = acceleration_lag_s(motion.time) if settings.filter == "realtime" else 0.0
    delay = plate_delay(total[:, :3], residual[:, :3], motion.time, lag_s)
    carried_kg = carried_mass(motion.time, total[:, 2], cycles, counts)
    reference = reference_events(
        under_feet.by_foot,
        motion.time,
        settings.contact_threshold_n,
        markers,
        body.marker_set,
        supported,
        method,
    )
    notes: tuple[Note, ...] = (
        *recording.notes,
        mass.note,
        *differing_masses(mass.known_kg, carried_kg),
        *implausible(body),
        *check_markers(body, recording, pose),
        *body.notes,
        *outlier_notes,
        *check_motion(body, unfiltered, markers),
        *ground.notes,
        *(uncertainty_notes(uncertainty.residual[counts]) if uncertainty else ()),
        *check_plates(recording, best, mass.mass_kg),
        dynamics[ground.best].engine.note,
        events_note,
        *check_events(events, reference),
        *_agreement(events, method, under_feet, motion, settings),
        *contact_notes(under_feet, motion.time),
        *carried_notes(quality, motion.time, *vertical),
        *cycle_notes,
        *selection_notes,
        *part_notes,
        *window_notes(
            window,
            span,
            selected,
            part=part,
            events=events,
            rejected=(events_note, *cycle_notes),
            time=motion.time,
            quality=quality,
        ),
        delay.note,
    )
    if static is not None:
        carried = {} if carried_kg is None else {ON_PLATES: carried_kg}
        notes = other_person(notes, body, recording, pose, {**mass.known_kg, **carried})
    return TrialResult(
        source=recording.source,
        subject=subject,
        settings=settings,
        body=body,
        markers=recording.markers,
        first_frame=recording.first_frame,
        plates=tuple(PlateSurface(p.number, p.center, p.corners) for p in recording.plates),
        motion=motion,
        variants=dynamics,
        ground=wrenches,
        overridden_segments=tuple(segments or ()),
        platform=ground.pose,
        events=events,
        cycles=selected,
        found_cycles=found_cycles(events, selected),
        span=span,
        quality=quality,
        onsets=onsets,
        part=part,
        uncertainty=uncertainty,
        delay_s=delay.delay_s,
        delay_uncertainty_s=delay.uncertainty_s,
        notes=notes,
    )


def process_trial(
    study: Study,
    subject: str,
    condition: str,
    *,
    laboratory: Laboratory | None = None,
    jobs: int = 1,
) -> TrialResult:
    r"""Process one trial of a study.

    Parameters
    ----------
    study
        The study.
    subject, condition
        Which trial.
    laboratory
        The study's, where it was read before.
    jobs
        Threads.

    Returns
    -------
    TrialResult
        With and without compensation if the study has a calibration.

    Raises
    ------
    ValueError
        If there is no such trial, or it cannot be processed.

    Examples
    --------
    >>> from pathlib import Path
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.stationary_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> _ = Path("study.toml").write_text("[conditions.level]")
    >>> trials = '[trials.level]\nfile = "walk.c3d"'
    >>> _ = Path("sub01.toml").write_text(f'id = "sub01"\nsex = "male"\n{trials}')
    >>> result = pipeline.process_trial(pipeline.read_study("."), "sub01", "level")
    >>> result.compensated is None
    True
    """
    person, rule = study.subject(subject), study.condition(condition)
    if condition not in person.trials:
        raise ValueError(f"subject {subject} has no trial {condition!r}")
    trial = person.trials[condition]
    if trial.file is None or trial.exclude is not None:
        raise ValueError(f"{subject} {condition} is excluded: {trial.exclude}")

    def read(name: str | None) -> Recording | None:
        return read_study_file(study, name) if name else None

    recording = read_study_file(study, trial.file, trial, person.static)
    static, hip_trial = read(person.static), read(person.hip_trial)
    recording = with_unused_renames(recording, static, hip_trial)
    with naming_unused_renames(recording):
        return process_recording(
            recording,
            person.person,
            study.file.settings,
            static=static,
            hip_trial=hip_trial,
            segments=read_segments(study.path(person.segments)) if person.segments else None,
            marker_set=study.marker_set,
            laboratory=laboratory or read_study_laboratory(study),
            condition=rule,
            window=rule.wanted,
            contacts=trial.contacts,
            jobs=jobs,
        )


def _body_mass(
    subject: Subject,
    settings: Settings,
    pose: Recording,
    recording: Recording,
    marker_set: MarkerSet | None,
) -> BodyMass:
    """Give the body mass; where it is missing and the labels are unknown, name these first."""
    try:
        return body_mass(subject, pose, recording)
    except ValueError as error:
        if marker_set is None and settings.marker_set is None:
            try:
                recognise_marker_set(pose.markers.names)
            except ValueError as unknown:
                raise ValueError(
                    f"{pose.source.name}: {unknown}; the mass is missing too (--mass-kg)"
                ) from error
        raise


def _require_plates(recording: Recording) -> None:
    if not recording.plates:
        raise ValueError(
            f"{recording.source.name}: {recording.why_no_plates}; residuals need the ground "
            "reaction wrench (FORCE_PLATFORM group, or a second file with forces)"
        )


def _uncertainty(ground: Ground, motion: Motion) -> CompensationUncertainty | None:
    """Give what the compensation makes uncertain: plates and residuals."""
    if not ground.spreads:
        return None
    origin = np.zeros(3)
    plates = [sum_deviation([spread], within, origin) for spread, within in ground.of_each]
    pelvis = sum_deviation(ground.spreads, ground.correlation, motion.q[:, :3])
    return CompensationUncertainty(tuple(plates), pelvis)


def _agreement(
    events: Sequence[Event],
    method: EventMethod,
    shared: SharedPlates,
    motion: Motion,
    settings: Settings,
) -> tuple[Note, ...]:
    """Compare events with the plates, unless these gave them."""
    if method in TIMED_BY_PLATES:
        return ()
    return agreement_with_plates(events, shared.by_foot, motion.time, settings.contact_threshold_n)


def _filtered(by_foot: Mapping[str, Array], motion: Motion, settings: Settings) -> dict[str, Array]:
    """Pass the wrench under each foot through the filter of the motion.

    In real time a gap of one foot is one of both: who carries a plate that is unknown is unknown.
    """
    gaps: Mask = np.zeros((len(motion.time), 1), bool)
    if settings.filter == "realtime":
        gaps[:, 0] = np.isnan(np.hstack([*by_foot.values()])).any(axis=1)
    return {
        foot: low_pass(
            np.where(gaps, np.nan, wrench), motion.time, settings.cutoff_hz, settings.filter
        )
        for foot, wrench in by_foot.items()
    }
