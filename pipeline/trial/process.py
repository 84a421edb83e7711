"""One trial from recording to residuals: the whole method, top to bottom."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hbm.markers import MarkerSet
from hbm.segments import SegmentOverride
from pipeline.config.schema import Condition, PlateContact, Settings, Subject, Treadmill, TrialName
from pipeline.config.study import Study
from pipeline.io.recording import Recording
from pipeline.trial.chain import Chain
from pipeline.trial.corrections import find_faults
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.inputs import Inputs
from pipeline.trial.notes import notes_of
from pipeline.trial.plate_units import require_possible, require_units
from pipeline.trial.result import TrialResult
from pipeline.trial.stages import known_forces
from pipeline.trial.study_files import (
    read_body_files,
    read_study_file,
    read_study_laboratory,
    saying_what_was_read,
    with_unused_renames,
)


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
    TypeError
        If a file has not been read as a recording.
    ValueError
        If the trial has no plates, no known markers, no usable mass, or is shorter than the filter
        needs; if a stated span or contact is not in it.

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
    inputs = Inputs(
        recording=recording,
        subject=subject,
        static=static,
        static_window_s=static_window_s,
        hip_trial=hip_trial,
        segments=segments or {},
        marker_set=marker_set,
        laboratory=laboratory or Laboratory(Treadmill()),
        condition=condition or Condition(),
        contacts=tuple(contacts),
    )
    return result_of(Chain(inputs, settings, jobs=jobs))


def result_of(chain: Chain) -> TrialResult:
    """Pass a trial through its stages; a ValueError says what it lacks, or what is wrong with it.

    A chain computes a stage where it is first asked for; here they stand in the order of the
    method.
    """
    inputs, settings = chain.inputs, chain.settings
    # units: what no body does is no geometry
    for recording in {id(file): file for file in (chain.trial, chain.standing)}.values():
        require_units(recording, inputs.subject.mass_kg)
    inputs.require_all(settings)

    # body: segments and joints from the calibration pose, scaled by mass and stature
    body = chain.body
    # pose: inverse kinematics, without outliers, and low-pass
    motion = chain.pose.motion
    # ground: plates at the markers' times, compensated in their own frames, then in the lab
    ground = chain.ground
    # loads: joint forces and pelvis residual of every variant
    loads = chain.loads
    # quality: in which frames pose and support are known and filters have settled
    quality = chain.quality
    require_possible(loads.dynamics[ground.best].residual[chain.counts], body)
    # gait and window: events, and the cycles that count
    events, window = chain.gait.events, chain.window
    # faults of plates, and what corrects them
    faults, calibration = find_faults(chain), inputs.laboratory.calibration

    return TrialResult(
        source=chain.trial.source,
        subject=inputs.subject,
        settings=settings,
        body=body,
        markers=chain.trial.markers,
        first_frame=chain.trial.first_frame,
        plates=tuple(plate.place for plate in chain.trial.plates),
        motion=motion,
        solved=chain.pose.solved.q,
        variants=known_forces(loads.dynamics, quality),
        ground=loads.wrenches,
        overridden_segments=tuple(inputs.segments),
        platform=ground.pose,
        events=events,
        cycles=window.cycles,
        unit=window.unit,
        found_cycles=window.found,
        span=window.span,
        quality=quality,
        onsets=window.onsets,
        part=window.part,
        uncertainty=chain.uncertainty,
        delay_s=chain.delay.seconds,
        delay_uncertainty_s=chain.delay.uncertainty_s,
        notes=notes_of(chain, faults),
        of_calibration=() if calibration is None else calibration.notes,
        shortage=window.shortage,
        findings=faults,
        procedure=chain.procedure,
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
    return process_chain(trial_chain(study, name, laboratory, jobs=jobs), study, name)


def process_chain(chain: Chain, study: Study, name: TrialName) -> TrialResult:
    """Process a trial of a study; an error says what was found on reading its files, too."""
    inputs, session = chain.inputs, study.trial(name).session or ""
    with saying_what_was_read(inputs.recording, inputs.static, inputs.hip_trial):
        result = result_of(chain)
    return replace(result, condition=name.condition, recording=name.recording, session=session)


def trial_chain(
    study: Study,
    name: TrialName,
    laboratory: Laboratory | None = None,
    *,
    like: Chain | None = None,
    jobs: int = 1,
) -> Chain:
    """Give the chain of a trial of a study.

    ``like`` is the chain of the same trial in another way of processing: what both have in common
    is read and computed once. Errors are those of `process_trial`.
    """
    person, trial = study.subject(name.subject), study.trial(name)
    if trial.file is None or trial.exclude is not None:
        raise ValueError(f"{name} is excluded: {trial.exclude}")
    before = None if like is None else like.inputs
    hip_trial, segments = read_body_files(study, person)
    if before is not None and before.recording.options == study.stated_of(trial):
        recording, static = before.recording, before.static
    else:
        static = read_study_file(study, person.static) if person.static else None
        read = read_study_file(study, trial.file, trial, person.static)
        recording = with_unused_renames(read, static, hip_trial)
    given: dict[str, Any] = {
        "recording": recording,
        "static": static,
        "hip_trial": hip_trial,
        "marker_set": study.marker_set,
        "laboratory": laboratory or read_study_laboratory(study),
        "condition": study.rule(name),
    }
    settings = study.file.settings
    if like is not None:
        return like.changed(settings=settings, **given)
    inputs = Inputs(
        subject=person.person, segments=segments or {}, contacts=trial.contacts, **given
    )
    return Chain(inputs, settings, jobs=jobs)
