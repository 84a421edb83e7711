"""One trial from recording to residuals: the whole method, top to bottom."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from hbm.body import Body
from hbm.engines.engine import choose_engine
from hbm.markers import MarkerSet, recognise_marker_set
from hbm.notes import Note
from hbm.plausibility.motion import implausible
from hbm.segments import SegmentOverride
from hbm.spatial import GRAVITY_MPS2, Array, Indices
from pipeline.config.schema import (
    Condition,
    PlateContact,
    Settings,
    Subject,
    Treadmill,
    TrialName,
)
from pipeline.config.study import Study
from pipeline.io.recording import Event, Recording
from pipeline.trial.checks import check_markers, check_motion, check_plates, other_person
from pipeline.trial.findings.raw import raw_faults
from pipeline.trial.gait.contact import contact_notes
from pipeline.trial.gait.detection import detect_events, foot_motion, plate_events
from pipeline.trial.gait.events import check_events, choose_method, foot_swings, other_events
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import BoundLaboratory, Laboratory, bind
from pipeline.trial.ground.platform import uncompensated_motion
from pipeline.trial.ground.uncertainty import uncertainty_notes
from pipeline.trial.ground.wrenches import Ground, ground_wrenches, plate_loads
from pipeline.trial.plate_faults import (
    LABELS_WRONG,
    Witnesses,
    misweigh,
    plate_faults,
    weight_of_steps,
    without_explained,
)
from pipeline.trial.plate_units import require_possible, require_units, reversed_plates
from pipeline.trial.quality import NO_SUPPORT, carried_notes, free_of, settling_s
from pipeline.trial.result import TrialResult
from pipeline.trial.stages import (
    Loads,
    Pose,
    dynamics_under_feet,
    frame_quality,
    known_forces,
    plate_delay,
    solve_pose,
)
from pipeline.trial.study_files import (
    read_body_files,
    read_study_file,
    read_study_laboratory,
    saying_what_was_read,
    with_unused_renames,
)
from pipeline.trial.subject import (
    ON_PLATES,
    BodyMass,
    MassUnknownError,
    body_mass,
    differing_masses,
    roughly_weighed,
    subject_body,
)
from pipeline.trial.window import what_counts


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
        What counts: gait cycles, steps, stances, the recording, or a span of it; by default all
        cycles of the right foot, or of the left one if the right has none; where there is none
        steps, else stances, else the whole recording.
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
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> f"{result.body.mass:.1f} kg, {len(result.cycles['right'])} gait cycles"
    '74.6 kg, 3 gait cycles'
    """
    laboratory, notes = laboratory or Laboratory(Treadmill()), list[Note]()
    choose_engine(settings.engine)
    raw = raw_faults(recording.plates)
    recording = with_corrected_plates(recording, laboratory.plates)
    standing = with_corrected_plates(static, laboratory.plates) if static else recording
    sound = [p for p in recording.plates if p.number not in {fault.plate for fault in raw}]
    doubted = reversed_plates(replace(recording, plates=tuple(sound)))
    notes += (*recording.notes, *(fact.note for fact in doubted))

    # units: what no body does is no geometry
    for each in (recording, standing)[: 2 - (standing is recording)]:
        require_units(each, subject.mass_kg)

    # body: segments and joints from the calibration pose, scaled by mass and stature
    try:
        mass = _body_mass(recording, standing, subject, settings, marker_set)
    except MassUnknownError as unknown:
        rough = subject.model_copy(update={"mass_kg": roughly_weighed(recording, unknown)})
        again = partial(
            process_recording,
            recording,
            settings=settings,
            static=static,
            static_window_s=static_window_s,
            hip_trial=hip_trial,
            segments=segments,
            marker_set=marker_set,
            laboratory=laboratory,
            condition=condition,
            contacts=contacts,
            jobs=jobs,
        )
        return _weighed_by_steps(again, again(rough), unknown)
    body = subject_body(
        standing,
        subject,
        settings,
        mass.mass_kg,
        window_s=static_window_s,
        marker_set=marker_set,
        hip_trial=hip_trial,
        segments=segments,
    )
    notes += (mass.note, *implausible(body), *check_markers(body, recording, standing), *body.notes)

    # pose: inverse kinematics and low-pass
    pose = solve_pose(body, recording.markers, settings, notes, jobs)
    motion = pose.motion
    notes += check_motion(body, pose.solved, pose.markers)

    # ground: plates at the markers' times, compensated in their own frames, then in the lab
    lab = bind(recording, laboratory, settings.plate_delay_s)
    ground = ground_wrenches(lab, motion.time, notes, settings.cutoff_hz, settings.filter)
    is_stated = laboratory.treadmill.platform is not None or laboratory.calibration is not None
    moves = () if is_stated else uncompensated_motion(recording, body.markers)
    still = ground.pose is None and not moves
    notes += moves
    notes += check_plates(recording, ground.variants[ground.best], mass.mass_kg)

    # dynamics: joint forces and pelvis residual of every variant
    loads = dynamics_under_feet(body, pose, ground, settings, contacts, jobs)
    notes += (loads.dynamics[ground.best].engine.note, *contact_notes(loads.shared, motion.time))

    # quality: in which frames pose and support are known and filters have settled
    settling = settling_s(laboratory.filters(settings))
    quality = frame_quality(body, pose, ground, loads, settings, settling)
    counts = free_of(quality)
    uncertainty = ground.uncertainty(motion.q[:, :3])
    notes += () if uncertainty is None else uncertainty_notes(uncertainty[counts])
    notes += carried_notes(quality, motion.time, loads.need, loads.measured)

    residual = loads.dynamics[ground.best].residual
    require_possible(residual[counts], body)

    # plates: their delay; each by itself, against its raw samples, the motion and the feet
    loaded = ground.variants[ground.best], residual, counts
    witnesses = Witnesses.of(body, motion, pose.solved, *loaded, settings)
    right_labels = LABELS_WRONG.isdisjoint(note.code for note in notes)
    delay_s, delay_uncertainty_s = plate_delay(loads, ground.best, counts, settings, notes, still)
    faults = plate_faults(recording.plates, witnesses, raw, by_motion=still and right_labels)
    notes, faults = without_explained(notes, faults, mass.known_kg)
    notes += faults
    carried_kg = None if misweigh(faults) else weight_of_steps(witnesses)
    if carried_kg is not None:
        notes.append(Note.of("mass_carried", mass_kg=carried_kg))
    notes += differing_masses(mass.known_kg, carried_kg)

    # gait: events and the cycles that count
    events, feet = _events(lab, body, pose, ground, loads, quality, notes, settings)
    counted = what_counts(
        recording,
        events,
        quality,
        condition or Condition(),
        settling,
        ground.pose,
        notes,
        settings.min_valid_share,
        feet,
    )
    if static is not None:
        known_kg = {**mass.known_kg, **({ON_PLATES: carried_kg} if carried_kg else {})}
        notes = other_person(notes, body, recording, standing, known_kg)
    return TrialResult(
        source=recording.source,
        subject=subject,
        settings=settings,
        body=body,
        markers=recording.markers,
        first_frame=recording.first_frame,
        plates=tuple(plate.place for plate in recording.plates),
        motion=motion,
        variants=known_forces(loads.dynamics, quality),
        ground=loads.wrenches,
        overridden_segments=tuple(segments or ()),
        platform=ground.pose,
        events=events,
        cycles=counted.cycles,
        unit=counted.unit,
        found_cycles=counted.found,
        span=counted.span,
        quality=quality,
        onsets=counted.onsets,
        part=counted.part,
        uncertainty=uncertainty,
        delay_s=delay_s,
        delay_uncertainty_s=delay_uncertainty_s,
        notes=tuple(notes),
    )


def process_trial(
    study: Study,
    subject: str,
    condition: str,
    recording: str = "",
    *,
    laboratory: Laboratory | None = None,
    jobs: int = 1,
) -> TrialResult:
    r"""Process one trial of a study.

    Parameters
    ----------
    study
        The study.
    subject, condition, recording
        Which trial; the recording is "01", "02", … where the condition has several.
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
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> _ = Path("study.toml").write_text("[conditions.level]")
    >>> trials = '[trials.level]\nfile = "walk.c3d"'
    >>> _ = Path("sub01.toml").write_text(f'id = "sub01"\nsex = "male"\n{trials}')
    >>> result = pipeline.process_trial(pipeline.read_study("."), "sub01", "level")
    >>> result.compensated is None
    True
    """
    name = TrialName(subject, condition, recording)
    person, trial, rule = study.subject(subject), study.trial(name), study.rule(name)
    if trial.file is None or trial.exclude is not None:
        raise ValueError(f"{name} is excluded: {trial.exclude}")
    walk = read_study_file(study, trial.file, trial, person.static)
    static = read_study_file(study, person.static) if person.static else None
    hip_trial, segments = read_body_files(study, person)
    walk = with_unused_renames(walk, static, hip_trial)
    with saying_what_was_read(walk, static, hip_trial):
        result = process_recording(
            walk,
            person.person,
            study.file.settings,
            static=static,
            hip_trial=hip_trial,
            segments=segments,
            marker_set=study.marker_set,
            laboratory=laboratory or read_study_laboratory(study),
            condition=rule,
            contacts=trial.contacts,
            jobs=jobs,
        )
    return replace(result, condition=condition, recording=recording, session=trial.session or "")


def _weighed_by_steps(
    again: Callable[[Subject], TrialResult], rough: TrialResult, unknown: MassUnknownError
) -> TrialResult:
    """Process a trial once more with the mass that its steps show, where nothing else tells it."""
    carried = [note for note in rough.notes if note.code == "mass_carried"]
    if not carried:
        raise unknown
    mass_kg = float(str(carried[0].values["mass_kg"]))
    result = again(rough.subject.model_copy(update={"mass_kg": mass_kg}))
    by_steps = Note.of("mass_by_steps", mass_kg=mass_kg)
    notes = (by_steps if note.code == "mass_stated" else note for note in result.notes)
    return replace(result, notes=tuple(notes))


def _body_mass(
    recording: Recording,
    standing: Recording,
    subject: Subject,
    settings: Settings,
    marker_set: MarkerSet | None,
) -> BodyMass:
    """Give the body mass, or say all at once that the trial lacks: labels, plates, mass."""
    faults, mass = list[str](), None
    if len(recording.markers.time) < 2:
        faults.append(f"{recording.source.name}: it is one frame; residuals need a motion")
    if marker_set is None and settings.marker_set is None:
        try:
            recognise_marker_set(standing.markers.names)
        except ValueError as unknown:
            faults.append(f"{standing.source.name}: {unknown}")
    if not recording.plates:
        file = recording.source
        plates = {
            ".trc": "give its file of forces, MOT or .forces (--forces, forces of the trial)",
            ".tsv": f"put its files of forces, {file.stem}_f_1.tsv and so on, beside it",
        }.get(file.suffix.lower(), "export it with its plates")
        faults.append(
            f"{file.name}: {recording.why_no_plates}; residuals need the ground reaction wrench: "
            f"{plates}"
        )
    try:
        mass = body_mass(subject, standing, recording)
    except MassUnknownError:
        if not faults:
            raise
        faults.append("the mass is missing too (--mass-kg)")
    if mass is None or faults:
        raise ValueError("; ".join(faults))
    return mass


def _events(
    lab: BoundLaboratory,
    body: Body,
    pose: Pose,
    ground: Ground,
    loads: Loads,
    quality: Indices,
    notes: list[Note],
    settings: Settings,
) -> tuple[tuple[Event, ...], Array]:
    """Give a trial's gait events by the method of the settings; checks of them are noted.

    With where the feet are from the pelvis, (T, 2, 3) [m].
    """
    time, of_file = pose.motion.time, lab.recording.events
    of_plates = plate_events(
        loads.shared.contacts, plate_loads(lab), time, body.mass * GRAVITY_MPS2
    )
    motion = foot_motion(body, time, pose.solved.q, ground.pose)
    swings = foot_swings(lab.recording.markers, body.marker_set)
    method, doubts = choose_method(of_file, swings, settings.events)
    events, note = detect_events(of_file, of_plates, motion, pose.markers, body.marker_set, method)
    carried = free_of(quality, NO_SUPPORT)
    reference = other_events(of_plates, swings.events, carried, method)
    notes += (*doubts, note, *check_events(events, reference))
    return events, swings.feet
