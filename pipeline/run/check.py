"""A study checked before it is processed: what a run will use, leave out or refuse."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from compensation.inertia.sensors import describe_sensors
from hbm.body import Body
from hbm.coordinates import COORDINATES, LAST_Q, support
from hbm.engines.engine import choose_engine
from hbm.notes import Note, NoteValue
from hbm.signals.filtering import low_pass
from hbm.spelling import did_you_mean
from pipeline.config.schema import Condition, Settings, SubjectFile, Trial
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments
from pipeline.io.read import preview_recording
from pipeline.io.recording import Preview, Recording
from pipeline.trial.gait.contact import require_contacts
from pipeline.trial.gait.cycles import found_cycles
from pipeline.trial.gait.events import SIDES, gait_events
from pipeline.trial.ground.accelerometers import accelerations, fastest_belt, mean_belt_speed
from pipeline.trial.ground.belt_calibration import read_belts
from pipeline.trial.ground.calibration_check import read_check
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import (
    Laboratory,
    plate_models,
    read_calibration,
    require_uncompensated,
)
from pipeline.trial.ground.platform import platform_pose
from pipeline.trial.ground.uncertainty import belt_speed_notes
from pipeline.trial.quality import settling_s
from pipeline.trial.study_files import labels_in_none, read_study_file, read_study_plates
from pipeline.trial.subject import body_mass, differing_masses, subject_body
from pipeline.trial.window import NO_POSE, counted_span, cycle_shortage

MIN_CYCLE_S: Final = 0.8
"""Gait cycle of fast walking: a recording cannot hold more cycles than of this duration."""
MAX_MISSING_SHARE: Final = 0.2
"""Share of the frames looked at; a marker that is missing in more is named."""
ASSUMED_MASS_KG: Final = 70.0
"""For a body whose mass is not stated: a check uses only the positions of its joints."""
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Fault:
    """Why a trial cannot be processed: the file or trial at fault, and the reason."""

    place: str
    reason: str

    def __str__(self) -> str:
        return self.reason if self.place in self.reason else f"{self.place}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Remark:
    """Information on a file or trial before it is processed."""

    place: str
    note: Note

    def __str__(self) -> str:
        return f"{self.place}: {self.note}"


@dataclass(slots=True)
class Findings:
    """What a check found, each thing once: faults stop a trial, remarks do not."""

    faults: list[Fault] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    notes_of_files: list[tuple[Note, ...]] = field(default_factory=list)

    def remark(self, place: str, code: str, **values: NoteValue) -> None:
        """Add a note on a place."""
        self.notes(place, [Note.of(code, **values)])

    def notes(self, place: str, notes: Iterable[Note]) -> None:
        """Add what is not yet known of a place."""
        for remark in (Remark(place, note) for note in notes):
            if remark not in self.remarks:
                self.remarks.append(remark)

    def fault(self, place: str, reason: str) -> None:
        """Add what stops a trial."""
        if (fault := Fault(place, reason)) not in self.faults:
            self.faults.append(fault)

    def attempt(self, place: str, action: Callable[[], Result]) -> Result | None:
        """Give what a function returns; where it raises, its message is a fault of the place."""
        try:
            return action()
        except (ValueError, OSError) as error:
            self.fault(place, str(error))
            return None

    def add(self, other: "Findings") -> None:
        """Add all that another check found."""
        for fault in other.faults:
            self.fault(fault.place, fault.reason)
        for remark in other.remarks:
            self.notes(remark.place, [remark.note])
        self.notes_of_files += other.notes_of_files


def check_study(study: Study) -> Findings:
    """Check every recording of a study without processing it.

    Parameters
    ----------
    study
        The study; its TOML files are already checked.

    Returns
    -------
    Findings
        All faults of all files, not only the first. A recording is judged by its header, its
        beginning and frames spread over it; before a fault is reported, all of it is read.
    """
    found = Findings()
    found.attempt("study.toml", lambda: choose_engine(study.file.settings.engine))
    laboratory = _check_laboratory(study, found)
    trial_of: dict[Path, str] = {}
    for subject, person in study.subjects.items():
        for condition, trial in person.trials.items():
            name = f"{subject} {condition}"
            if trial.exclude is not None:
                found.remark(name, "trial_excluded", reason=trial.exclude)
            elif trial.file is not None:
                other = trial_of.setdefault(study.path(trial.file).resolve(), name)
                if other != name:
                    found.remark(name, "recording_used_twice", other=other)
                found.add(_check_trial(study, condition, person, trial, laboratory))
        without = tuple(name for name in study.file.conditions if name not in person.trials)
        if without:
            found.remark(subject, "conditions_without_trial", conditions=without)
    if absent := labels_in_none(found.notes_of_files):
        found.remark("study.toml", "rename_without_label", labels=absent)
    return found


def _check_laboratory(study: Study, found: Findings) -> Laboratory:
    """Check the calibrations; give the treadmill with those of platform and plates."""
    treadmill, stated = study.file.treadmill, study.stated
    plates = found.attempt("study.toml", lambda: read_study_plates(study))
    if not treadmill.calibration:
        found.remark("study.toml", "calibration_not_stated")
        laboratory = Laboratory(treadmill, plates=plates)
        _check_belts(study, laboratory, found)
        return laboratory
    path, beside = study.path(treadmill.calibration), tuple(map(study.path, treadmill.beside))
    calibration = found.attempt(
        path.name, lambda: read_calibration(path, treadmill, stated, plates, beside)
    )
    if calibration is not None:
        found.notes(path.name, (*calibration.notes, *describe_sensors(calibration.sensors)))
        found.remark(path.name, "calibration_of_plates", plates=tuple(calibration.plates))
    laboratory = Laboratory(treadmill, calibration, plates=plates)
    if calibration is not None and treadmill.check:
        other = study.path(treadmill.check)
        day = found.attempt(other.name, lambda: read_check(other, laboratory, stated))
        found.notes(other.name, day.notes if day is not None else ())
    _check_belts(study, laboratory, found)
    return laboratory


def _check_belts(study: Study, laboratory: Laboratory, found: Findings) -> None:
    """Check the calibration of the belts, if one is stated."""
    belt = laboratory.treadmill.belt
    if belt is None:
        return
    path = study.path(belt.calibration)
    read = found.attempt(path.name, lambda: read_belts(path, laboratory, study.stated))
    if read is not None:
        found.notes(path.name, read[1])


def _check_trial(
    study: Study,
    condition: str,
    person: SubjectFile,
    trial: Trial,
    laboratory: Laboratory,
) -> Findings:
    """Check one trial: its beginning and, if that has a fault or contacts are stated, all of it."""
    rule = study.file.conditions[condition]
    file, *_ = trial.files
    path = study.path(file)
    forces, record = (study.path(name) if name else None for name in (trial.forces, trial.record))

    def check(preview: Preview) -> Findings:
        found = Findings()
        pose: Recording | None = preview.beginning
        static = person.static
        if static is not None:
            pose = found.attempt(
                study.path(static).name,
                lambda: with_corrected_plates(read_study_file(study, static), laboratory.plates),
            )
        _check_contents(preview, rule, found)
        _check_loads(trial, preview.beginning, study.file.settings, found)
        found.notes_of_files += [each.notes for each in (preview.beginning, pose) if each]
        if pose is not None:
            body = _check_body(study, person, preview, pose, found)
            if body is not None:
                settings = study.file.settings
                _check_window(preview, rule, settings, laboratory, body, found)
        _check_ground(preview.beginning, laboratory, rule, found)
        return found

    def corrected(preview: Preview) -> Preview:
        beginning = with_corrected_plates(preview.beginning, laboratory.plates)
        return replace(preview, beginning=beginning)

    of_beginning, of_whole = Findings(), Findings()
    preview = of_beginning.attempt(
        path.name,
        lambda: corrected(
            preview_recording(
                path,
                study.stated,
                forces,
                record=record,
                static=study.path(person.static) if person.static else None,
            )
        ),
    )
    if preview is not None:
        of_beginning = check(preview)
        if not of_beginning.faults and not trial.contacts:
            return of_beginning
    missing = preview.missing if preview is not None else {}

    def whole() -> Preview:
        recording = read_study_file(study, file, trial, person.static)
        return corrected(Preview(recording, len(recording.markers.time), missing))

    preview = of_whole.attempt(path.name, whole)
    return of_whole if preview is None else check(preview)


def _check_contents(preview: Preview, rule: Condition, found: Findings) -> None:
    """Note what a file holds, and whether that is enough."""
    recording = preview.beginning
    name, rate_hz = recording.source.name, recording.markers.rate_hz
    duration_s = preview.frames / rate_hz
    plates, analog = recording.plates, recording.analog
    contents = [f"{len(recording.markers.names)} markers at {rate_hz:g} Hz"]
    if plates:
        contents.append(f"{len(plates)} plates at {plates[0].rate_hz:.6g} Hz")
    if analog is not None:
        channels = zip(analog.names, analog.units, strict=True)
        contents.append("channels " + " ".join(f"{c} [{unit}]" for c, unit in channels))
    contents.append(f"{len(recording.events) or 'no'} gait events")
    found.remark(name, "recording_contents", duration_s=duration_s, contents=tuple(contents))
    found.notes(name, recording.notes)
    if not plates:
        found.fault(name, recording.why_no_plates)
    if rule.cycles and duration_s < rule.skip_s + rule.cycles * MIN_CYCLE_S:
        found.remark(name, "recording_short", cycles=rule.cycles, skip_s=rule.skip_s)


def _check_window(
    preview: Preview,
    rule: Condition,
    settings: Settings,
    laboratory: Laboratory,
    body: Body,
    found: Findings,
) -> None:
    """Look for what counts in a trial: gait events, or the span that is stated."""
    recording = preview.beginning
    name, start_s = recording.source.name, recording.markers.time[0]
    settling = settling_s(laboratory.filters(settings))
    time = start_s + np.arange(preview.frames) / recording.markers.rate_hz
    found.attempt(name, lambda: low_pass(0 * time, time, settings.cutoff_hz, settings.filter))
    every, least = np.ones(len(time), bool), settings.min_valid_share
    found.attempt(
        name,
        lambda: counted_span(rule.wanted, {}, time, settling, every, least),
    )
    if rule.wanted not in (None, "cycle"):
        return
    events, note = gait_events(
        recording.events, recording.markers, body.marker_set, settings.events
    )
    unknown = note.code == "events_unknown"
    if unknown and settings.events in (None, "auto", "plates"):
        return  # these need poses, and other markers than those that stand in for them here
    counted = [event for event in events if event.time >= rule.skip_s]
    if rule.wanted == "cycle" and not found_cycles(events, SIDES):
        reason = cycle_shortage(events, (), time, np.ones(len(time), bool))
        found.fault(name, str(note) if unknown else reason)
    elif rule.wanted == "cycle" and not found_cycles(counted, SIDES):
        found.fault(name, f"no gait cycle begins after the first {rule.skip_s:g} s, skip_s")
    elif unknown:
        found.notes(name, (note,))


def _check_body(
    study: Study, person: SubjectFile, preview: Preview, pose: Recording, found: Findings
) -> Body | None:
    """Build the body; note its mass, its locked coordinates, and which markers have gaps."""
    name = preview.beginning.source.name
    mass = None
    if pose.plates or person.static:
        mass = found.attempt(name, lambda: body_mass(person.person, pose, preview.beginning))
    if mass is not None:
        found.notes(name, (mass.note, *differing_masses(mass.known_kg, None)))

    def build() -> Body:
        return subject_body(
            pose,
            person.person,
            study.file.settings,
            mass.mass_kg if mass is not None else ASSUMED_MASS_KG,
            marker_set=study.marker_set,
            hip_trial=read_study_file(study, person.hip_trial) if person.hip_trial else None,
            segments=read_segments(study.path(person.segments)) if person.segments else None,
        )

    body = found.attempt(name, build)
    if body is not None:
        _check_markers(body, preview, found)
        found.notes(name, body.notes)
    return body


def _check_markers(body: Body, preview: Preview, found: Findings) -> None:
    name, known = preview.beginning.source.name, body.marker_set
    present = list(known.present(preview.beginning.markers.names).segment)
    needed = [marker for marker in known.markers if not marker.optional]
    absent = tuple(m.labels[0] for m in needed if not set(m.labels) & set(present))
    counts: dict[str, NoteValue] = {
        "present": len(needed) - len(absent),
        "count": len(needed),
        "marker_set": known.name,
    }
    if absent:
        found.remark(name, "markers_missing", **counts, missing=absent)
    else:
        found.remark(name, "markers_complete", **counts)
    used = [s for m, s in body.segment_of.items() if m in present]
    shown = {i for segment in used for i in support(LAST_Q[segment])}
    locked = tuple(c for i, c in enumerate(COORDINATES) if i not in shown)
    if locked:
        found.remark(name, "coordinates_locked", coordinates=locked)
    gaps = {m: share for m in present if (share := preview.missing.get(m, 0.0)) > 0}
    if gaps:
        found.remark(name, "markers_with_gaps", count=len(gaps))
    often = {marker: share for marker, share in gaps.items() if share > MAX_MISSING_SHARE}
    if often:
        found.remark(name, "markers_often_missing", share=often)


def _check_loads(trial: Trial, recording: Recording, settings: Settings, found: Findings) -> None:
    """Refuse plates on which nobody ever stands, and stated contacts that are not there."""
    name, plates = recording.source.name, {plate.number: plate for plate in recording.plates}
    threshold_n = settings.contact_threshold_n
    force = {
        number: np.linalg.norm(plate.wrench_in_plate[:, :3], axis=1)
        for number, plate in plates.items()
    }
    if plates and not any((each > threshold_n).any() for each in force.values()):
        found.fault(name, f"nobody is on the plates: none is loaded by more than {threshold_n:g} N")
    for contact in trial.contacts if plates else ():
        try:
            require_contacts([contact], [*plates], recording.markers.time)
        except ValueError as error:
            found.fault(name, str(error))
            continue
        sample = np.argmin(np.abs(plates[contact.plate].time - contact.time_s))
        if not force[contact.plate][sample] > threshold_n:
            found.fault(
                name, f"contacts: nobody is on plate {contact.plate} at {contact.time_s:g} s"
            )


def _check_ground(
    recording: Recording, laboratory: Laboratory, rule: Condition, found: Findings
) -> None:
    """Look for everything that compensation, platform pose and perturbations need."""
    name, treadmill = recording.source.name, laboratory.treadmill
    found.attempt(name, lambda: require_uncompensated(recording, laboratory))
    calibration = laboratory.calibration
    if calibration is not None and recording.plates:
        readings = found.attempt(name, lambda: accelerations(recording, treadmill))
        if readings is not None:
            found.attempt(name, lambda: plate_models(recording, laboratory))
            of_belts = found.attempt(
                name,
                lambda: belt_speed_notes(
                    mean_belt_speed(fastest_belt(recording, treadmill)), calibration
                ),
            )
            found.notes(name, of_belts or ())
    time, platform = recording.markers.time, treadmill.platform
    pose = found.attempt(name, lambda: platform_pose(recording, platform, time))
    if pose is not None:
        found.notes(name, pose[1])
    known = recording.analog.names if recording.analog is not None else ()
    belts = treadmill.belt.speed_channels if treadmill.belt is not None else ()
    if rule.part == "motion" and platform is None:
        found.fault("study.toml", NO_POSE)
    for channel in filter(None, (*belts, rule.pulse_channel)):
        if channel not in known:
            found.fault(name, f"no analog channel {channel!r}{did_you_mean(channel, known)}")
