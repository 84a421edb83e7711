"""A study checked before it is processed: what a run will use, leave out or refuse.

Every recording passes the stages of `pipeline.trial.process` that need no solved motion, on its
beginning; what one of them refuses is collected, and the next one follows.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from compensation.inertia.sensors import describe_sensors
from hbm.body import Body
from hbm.coordinates import COORDINATES, LAST_Q, support
from hbm.engines.engine import choose_engine
from hbm.notes import Note
from hbm.signals.filtering import low_pass
from hbm.spelling import did_you_mean, listed
from pipeline.config.schema import Condition, PlateContact, Settings, SubjectFile, Trial
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments
from pipeline.io.c3d.second_reader import compare_readers
from pipeline.io.read import file_format, preview_recording
from pipeline.io.recording import Preview, Recording
from pipeline.trial.gait.contact import require_contacts
from pipeline.trial.gait.cycles import found_cycles
from pipeline.trial.gait.events import SIDES, gait_events
from pipeline.trial.ground.accelerometers import mean_belt_speed
from pipeline.trial.ground.belt_calibration import read_belts
from pipeline.trial.ground.calibration_check import read_check
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, bind, read_calibration
from pipeline.trial.ground.platform import platform_pose
from pipeline.trial.ground.uncertainty import uncertainty_limits
from pipeline.trial.quality import settling_s
from pipeline.trial.study_files import labels_in_none, read_study_file, read_study_plates
from pipeline.trial.subject import body_mass, subject_body
from pipeline.trial.window import NO_POSE, counted_span, cycle_shortage

MIN_CYCLE_S: Final = 0.8
"""Gait cycle of fast walking: a recording cannot hold more cycles than of this duration."""
MAX_MISSING_SHARE: Final = 0.2
"""Share of the frames looked at; a marker that is missing in more is named."""
ASSUMED_MASS_KG: Final = 70.0
"""For a body whose mass is not stated: a check uses only the positions of its joints."""
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Finding:
    """What is to be known of a file or trial before it is processed."""

    place: str
    said: Note | str

    def __str__(self) -> str:
        text = str(self.said)
        return (
            text if isinstance(self.said, str) and self.place in text else f"{self.place}: {text}"
        )


@dataclass(slots=True)
class Findings:
    """What a check found, each thing once: faults stop a trial, remarks do not."""

    faults: list[Finding] = field(default_factory=list)
    remarks: list[Finding] = field(default_factory=list)
    read: dict[str, tuple[Note, ...]] = field(default_factory=dict)
    """Name of a file -> notes on reading it."""

    def remark(self, place: str, *said: Note | str) -> None:
        """Add what is not yet known of a place."""
        found = (Finding(place, one) for one in said)
        self.remarks += [one for one in dict.fromkeys(found) if one not in self.remarks]

    def fault(self, place: str, reason: str) -> None:
        """Add what stops a trial."""
        if (fault := Finding(place, reason)) not in self.faults:
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
            self.fault(fault.place, str(fault.said))
        for remark in other.remarks:
            self.remark(remark.place, remark.said)
        self.read |= other.read


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
                found.remark(name, f"excluded: {trial.exclude}")
            elif trial.file is not None:
                other = trial_of.setdefault(study.path(trial.file).resolve(), name)
                if other != name:
                    found.remark(name, f"the same recording as {other}")
                _check_trial(study, condition, person, trial, laboratory, found)
        without = [name for name in study.file.conditions if name not in person.trials]
        if without:
            found.remark(subject, f"no trial for {listed(without)}")
    if absent := labels_in_none(found.read.values()):
        found.remark("study.toml", Note.of("rename_without_label", labels=absent))
    return found


def _check_laboratory(study: Study, found: Findings) -> Laboratory:
    """Read the calibrations, each by itself; give the treadmill with those that can be read."""
    treadmill, stated = study.file.treadmill, study.stated
    plates = found.attempt("study.toml", lambda: read_study_plates(study))
    laboratory = Laboratory(treadmill, plates=plates)
    if treadmill.calibration:
        path, beside = study.path(treadmill.calibration), tuple(map(study.path, treadmill.beside))
        calibration = found.attempt(
            path.name, lambda: read_calibration(path, treadmill, stated, plates, beside)
        )
        laboratory = replace(laboratory, calibration=calibration)
        if calibration is not None:
            found.remark(path.name, f"compensates {listed(calibration.plates)}")
            found.remark(path.name, *calibration.notes, *describe_sensors(calibration.sensors))
            if treadmill.check:
                other = study.path(treadmill.check)
                day = found.attempt(other.name, lambda: read_check(other, laboratory, stated))
                found.remark(other.name, *(day.notes if day is not None else ()))
    else:
        found.remark("study.toml", "no treadmill.calibration, so nothing will be compensated")
    if treadmill.belt is not None:
        belt = study.path(treadmill.belt.calibration)
        read = found.attempt(belt.name, lambda: read_belts(belt, laboratory, stated))
        found.remark(belt.name, *(read[1] if read is not None else ()))
    return laboratory


def _check_trial(
    study: Study,
    condition: str,
    person: SubjectFile,
    trial: Trial,
    laboratory: Laboratory,
    found: Findings,
) -> None:
    """Check one trial: its beginning and, if that has a fault or contacts are stated, all of it."""
    file, *_ = trial.files
    path = study.path(file)
    forces, record, static = (
        study.path(name) if name else None for name in (trial.forces, trial.record, person.static)
    )

    def check(read: Callable[[], Preview]) -> tuple[Findings, Preview | None]:
        own = Findings()
        preview = own.attempt(path.name, read)
        if preview is not None:
            recording = own.attempt(
                path.name, lambda: with_corrected_plates(preview.beginning, laboratory.plates)
            )
            if recording is not None:
                rule = study.file.conditions[condition]
                _Stages(study, rule, person, trial, laboratory, preview, recording, own).check()
        return own, preview

    own, preview = check(
        lambda: preview_recording(path, study.stated, forces, record=record, static=static)
    )
    if own.faults or trial.contacts:
        missing = preview.missing if preview is not None else {}

        def whole() -> Preview:
            recording = read_study_file(study, file, trial, person.static)
            return Preview(recording, len(recording.markers.time), missing)

        own, _ = check(whole)
    found.add(own)


@dataclass(frozen=True, slots=True)
class _Stages:
    """The stages that the beginning of a recording passes, each as far as it can go."""

    study: Study
    rule: Condition
    person: SubjectFile
    trial: Trial
    laboratory: Laboratory
    preview: Preview
    recording: Recording
    found: Findings

    @property
    def name(self) -> str:
        """Name of the recording's file."""
        return self.recording.source.name

    @property
    def settings(self) -> Settings:
        """How trials are processed."""
        return self.study.file.settings

    def check(self) -> None:
        """Pass all stages."""
        self.contents()
        self.loads()
        pose: Recording | None = self.recording
        if (static := self.person.static) is not None:
            pose = self.found.attempt(
                self.study.path(static).name,
                lambda: with_corrected_plates(
                    read_study_file(self.study, static), self.laboratory.plates
                ),
            )
        for each in filter(None, (self.recording, pose)):
            self.found.read[each.source.name] = each.notes
        body = self.body(pose) if pose is not None else None
        if body is not None:
            self.markers(body)
            self.window(body)
        self.ground()

    def contents(self) -> None:
        """Say what the file holds, and whether that is enough."""
        recording, rate_hz, rule = self.recording, self.recording.markers.rate_hz, self.rule
        duration_s = self.preview.frames / rate_hz
        plates, analog = recording.plates, recording.analog
        contents = [f"{duration_s:.1f} s, {len(recording.markers.names)} markers at {rate_hz:g} Hz"]
        if plates:
            contents.append(f"{len(plates)} plates at {plates[0].rate_hz:.6g} Hz")
        if analog is not None:
            channels = zip(analog.names, analog.units, strict=True)
            contents.append("channels " + " ".join(f"{c} [{unit}]" for c, unit in channels))
        contents.append(f"{len(recording.events) or 'no'} gait events")
        self.found.remark(self.name, ", ".join(contents), *recording.notes)
        if rule.cycles and duration_s < rule.skip_s + rule.cycles * MIN_CYCLE_S:
            text = f"too short for {rule.cycles} gait cycles after {rule.skip_s:g} s"
            self.found.remark(self.name, text)

    def loads(self) -> None:
        """Refuse plates on which nobody ever stands, and stated contacts that are not there."""
        threshold_n = self.settings.contact_threshold_n
        plates = {plate.number: plate for plate in self.recording.plates}
        loaded = {
            number: np.linalg.norm(plate.wrench_in_plate[:, :3], axis=1) > threshold_n
            for number, plate in plates.items()
        }
        if not plates:
            self.found.fault(self.name, self.recording.why_no_plates)
        elif not any(each.any() for each in loaded.values()):
            reason = f"nobody is on the plates: none is loaded by more than {threshold_n:g} N"
            self.found.fault(self.name, reason)

        def require(contact: PlateContact) -> None:
            require_contacts([contact], [*plates], self.recording.markers.time)
            number, time_s = contact.plate, contact.time_s
            if not loaded[number][np.argmin(np.abs(plates[number].time - time_s))]:
                raise ValueError(f"contacts: nobody is on plate {number} at {time_s:g} s")

        for contact in self.trial.contacts if plates else ():
            self.found.attempt(self.name, partial(require, contact))

    def body(self, pose: Recording) -> Body | None:
        """Weigh the subject and build the body."""
        study, person, mass = self.study, self.person, None
        if pose.plates or person.static:
            mass = self.found.attempt(
                self.name, lambda: body_mass(person.person, pose, self.recording)
            )
        if mass is not None:
            self.found.remark(self.name, mass.note)
        body = self.found.attempt(
            self.name,
            lambda: subject_body(
                pose,
                person.person,
                self.settings,
                mass.mass_kg if mass is not None else ASSUMED_MASS_KG,
                marker_set=study.marker_set,
                hip_trial=read_study_file(study, person.hip_trial) if person.hip_trial else None,
                segments=read_segments(study.path(person.segments)) if person.segments else None,
            ),
        )
        self.found.remark(self.name, *(body.notes if body is not None else ()))
        return body

    def markers(self, body: Body) -> None:
        """Say which markers are there, what they leave unknown, and which are often missing."""
        known = body.marker_set
        present = list(known.present(self.recording.markers.names).segment)
        needed = [marker for marker in known.markers if not marker.optional]
        absent = [m.labels[0] for m in needed if not set(m.labels) & set(present)]
        there = f"{len(needed) - len(absent)} of the {len(needed)} markers of {known.name}"
        self.found.remark(self.name, f"{there}; missing: {listed(absent)}" if absent else there)
        used = {segment for marker, segment in body.segment_of.items() if marker in present}
        shown = {i for segment in used for i in support(LAST_Q[segment])}
        locked = tuple(c for i, c in enumerate(COORDINATES) if i not in shown)
        if locked:
            self.found.remark(self.name, Note.of("coordinates_held", coordinates=locked))
        missing = {m: self.preview.missing.get(m, 0.0) for m in present}
        often = [f"{m} {100 * s:.0f} %" for m, s in missing.items() if s > MAX_MISSING_SHARE]
        if often:
            self.found.remark(self.name, f"often missing: {', '.join(often)}")

    def window(self, body: Body) -> None:
        """Look for what counts: gait events, or the span that is stated."""
        settings, rule, markers = self.settings, self.rule, self.recording.markers
        settling = settling_s(self.laboratory.filters(settings))
        time = markers.time[0] + np.arange(self.preview.frames) / markers.rate_hz
        every, least = np.ones(len(time), bool), settings.min_valid_share

        def span() -> None:
            low_pass(0 * time, time, settings.cutoff_hz, settings.filter)
            counted_span(rule.wanted, {}, time, settling, every, least)

        self.found.attempt(self.name, span)
        if rule.wanted not in (None, "cycle"):
            return
        events, note = gait_events(self.recording.events, markers, body.marker_set, settings.events)
        unknown = note.code == "events_unknown"
        if unknown and settings.events in (None, "auto", "plates"):
            return  # these need poses, and other markers than those that stand in for them here
        counted = [event for event in events if event.time >= rule.skip_s]
        if rule.wanted == "cycle" and not found_cycles(events, SIDES):
            reason = str(note) if unknown else cycle_shortage(events, (), time, every)
            self.found.fault(self.name, reason)
        elif rule.wanted == "cycle" and not found_cycles(counted, SIDES):
            reason = f"no gait cycle begins after the first {rule.skip_s:g} s, skip_s"
            self.found.fault(self.name, reason)
        elif unknown:
            self.found.remark(self.name, note)

    def ground(self) -> None:
        """Look for everything that compensation, platform pose and perturbations need."""
        recording, laboratory, found = self.recording, self.laboratory, self.found
        treadmill, calibration = laboratory.treadmill, laboratory.calibration
        bound, platform = None, treadmill.platform
        if recording.plates:
            delay_s = self.settings.plate_delay_s
            bound = found.attempt(self.name, lambda: bind(recording, laboratory, delay_s))
        if bound is not None and calibration is not None:
            speed_mps = mean_belt_speed(bound.belts)
            found.remark(self.name, *uncertainty_limits(speed_mps, calibration))
        time = recording.markers.time
        pose = found.attempt(self.name, lambda: platform_pose(recording, platform, time))
        found.remark(self.name, *(pose[1] if pose is not None else ()))
        if self.rule.part == "motion" and platform is None:
            found.fault("study.toml", NO_POSE)
        known = recording.analog.names if recording.analog is not None else ()
        belts = treadmill.belt.speed_channels if treadmill.belt is not None else ()
        for channel in filter(None, (*belts, self.rule.pulse_channel)):
            if channel not in known:
                reason = f"no analog channel {channel!r}{did_you_mean(channel, known)}"
                found.fault(self.name, reason)


def study_recordings(study: Study) -> tuple[Path, ...]:
    """Give every recording that a study uses: trials, poses, hip trials, calibrations."""
    names: list[str | None] = [*study.file.treadmill.files.values()]
    for person in study.subjects.values():
        names += [person.static, person.hip_trial]
        for trial in person.trials.values():
            names += trial.files if trial.exclude is None else ()
    return tuple(dict.fromkeys(study.path(name) for name in names if name))


def read_twice(path: Path, found: Findings) -> bool:
    """Compare our reading of a recording with ezc3d's; each disagreement is a fault.

    Gives whether both readings are the same; a remark says why ezc3d does not read a file.
    """
    kind = found.attempt(path.name, lambda: file_format(path))
    if kind != "C3D":
        if kind is not None:
            found.remark(path.name, "not a C3D file: there is no second reader for it")
        return False
    second = found.attempt(path.name, lambda: compare_readers(path))
    if second is None:
        return False
    for line in second.disagreements:
        found.fault(path.name, line)
    if second.refusal and not second.disagreements:
        found.remark(path.name, f"{second.reader} does not read it: {second.refusal}")
    return not (second.refusal or second.disagreements)
