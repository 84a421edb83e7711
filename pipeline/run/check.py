"""A study checked before it is processed: what a run will use, leave out or refuse.

Every recording passes the stages of `pipeline.trial.process` that need no solved motion, on its
beginning; what one of them refuses is collected, and the next one follows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
from pipeline.config.schema import (
    Condition,
    PlateContact,
    Settings,
    SubjectFile,
    Trial,
    TrialName,
)
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments
from pipeline.io.c3d.second_reader import compare_readers
from pipeline.io.read import file_format, preview_recording
from pipeline.io.recording import Preview, Recording
from pipeline.trial.gait.contact import require_contacts
from pipeline.trial.gait.cycles import found_cycles
from pipeline.trial.gait.events import SIDES, gait_events
from pipeline.trial.ground.accelerometers import mean_belt_speed
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.platform import platform_pose
from pipeline.trial.ground.uncertainty import uncertainty_limits
from pipeline.trial.quality import settling_s
from pipeline.trial.study_files import labels_in_none, read_study_file, read_study_laboratory
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
    """What to know of a file or trial before it is processed."""

    place: str
    said: Note | str
    contents: bool = False
    """Whether it is only what a file holds."""

    @property
    def doubtful(self) -> bool:
        """Whether somebody should look at it."""
        return not self.contents if isinstance(self.said, str) else self.said.level == "warning"

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
        """Add what is to be known of a place."""
        self.add(Findings(remarks=[Finding(place, one) for one in said]))

    def contents(self, place: str, text: str) -> None:
        """Add what a file holds."""
        self.add(Findings(remarks=[Finding(place, text, contents=True)]))

    def fault(self, place: str, reason: str) -> None:
        """Add what stops a trial."""
        self.add(Findings(faults=[Finding(place, reason)]))

    def attempt(self, place: str, action: Callable[[], Result]) -> Result | None:
        """Give what a function returns; where it raises, its message is a fault of the place."""
        try:
            return action()
        except (ValueError, OSError) as error:
            self.fault(place, str(error))
            return None

    def add(self, other: "Findings") -> None:
        """Add all that another check found."""
        self.faults += [one for one in other.faults if one not in self.faults]
        self.remarks += [one for one in other.remarks if one not in self.remarks]
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
    laboratory = found.attempt("study.toml", lambda: read_study_laboratory(study))
    laboratory = laboratory or Laboratory(study.file.treadmill)
    found.remark("study.toml", *laboratory.notes)
    if (calibration := laboratory.calibration) is not None:
        file = str(study.file.treadmill.calibration)
        found.contents(file, f"compensates {listed(calibration.plates)}")
        found.remark(file, *calibration.notes)
        found.remark(file, *describe_sensors(calibration.sensors))
    elif study.file.treadmill.platform is not None and not study.file.treadmill.calibration:
        found.remark("study.toml", "no treadmill.calibration, so nothing will be compensated")
    trial_of: dict[Path, TrialName] = {}
    for subject, person in study.subjects.items():
        for name, trial in person.named_trials.items():
            if trial.exclude is not None:
                found.remark(str(name), f"excluded: {trial.exclude}")
            elif trial.file is not None:
                other = trial_of.setdefault(study.path(trial.file).resolve(), name)
                if other != name:
                    found.remark(str(name), f"the same recording as {other}")
                _check_trial(study, name, laboratory, found)
        without = [name for name in study.file.conditions if name not in person.trials]
        if without:
            found.remark(subject, f"no trial for {listed(without)}")
    if absent := labels_in_none(found.read.values()):
        found.remark("study.toml", Note.of("rename_without_label", labels=absent))
    return found


def _check_trial(
    study: Study, trial_name: TrialName, laboratory: Laboratory, found: Findings
) -> None:
    """Check one trial: its beginning and, if that has a fault or contacts are stated, all of it."""
    person, trial = study.subject(trial_name.subject), study.trial(trial_name)
    file, *_ = trial.files
    path = study.path(file)
    forces, record, static = (
        study.path(name) if name else None for name in (trial.forces, trial.record, person.static)
    )

    def check(read: Callable[[], Preview]) -> tuple[Findings, Preview | None]:
        own = Findings()
        preview = own.attempt(path.name, read)
        if preview is not None:
            rule = study.rule(trial_name)
            _check_stages(study, rule, person, trial, laboratory, preview, own)
        return own, preview

    own, preview = check(
        lambda: preview_recording(
            path, study.stated_of(trial), forces, record=record, static=static
        )
    )
    if own.faults or trial.contacts:
        missing = preview.missing if preview is not None else {}

        def whole() -> Preview:
            recording = read_study_file(study, file, trial, person.static)
            return Preview(recording, len(recording.markers.time), missing)

        own, _ = check(whole)
    found.add(own)


def _check_stages(
    study: Study,
    rule: Condition,
    person: SubjectFile,
    trial: Trial,
    laboratory: Laboratory,
    preview: Preview,
    found: Findings,
) -> None:
    """Pass the stages that a preview can pass, each as far as it can go."""
    settings, name = study.file.settings, preview.beginning.source.name

    def corrected(recording: Recording) -> Recording:
        found.read[recording.source.name] = recording.notes
        return with_corrected_plates(recording, laboratory.plates)

    recording = found.attempt(name, lambda: corrected(preview.beginning))
    if recording is None:
        return
    found.contents(name, _contents(recording, preview.frames))
    found.remark(name, *recording.notes)
    duration_s = preview.frames / recording.markers.rate_hz
    if rule.cycles and duration_s < rule.skip_s + rule.cycles * MIN_CYCLE_S:
        found.remark(name, f"too short for {rule.cycles} gait cycles after {rule.skip_s:g} s")
    _check_loads(recording, trial.contacts, settings.contact_threshold_n, found)
    pose, static = recording, person.static
    if static is not None:
        read = found.attempt(static, lambda: corrected(read_study_file(study, static)))
        if read is None:
            return
        pose = read
    body = _check_body(study, person, pose, recording, found)
    if body is not None:
        _check_markers(body, preview, found)
        _check_window(body, rule, preview, laboratory, settings, found)
    _check_ground(recording, laboratory, rule, settings, found)


def _contents(recording: Recording, frames: int) -> str:
    """Say what a file holds."""
    markers, plates, analog = recording.markers, recording.plates, recording.analog
    duration_s = frames / markers.rate_hz
    contents = [f"{duration_s:.1f} s, {len(markers.names)} markers at {markers.rate_hz:g} Hz"]
    if plates:
        contents.append(f"{len(plates)} plates at {plates[0].rate_hz:.6g} Hz")
    if analog is not None:
        channels = zip(analog.names, analog.units, strict=True)
        contents.append("channels " + " ".join(f"{c} [{unit}]" for c, unit in channels))
    return ", ".join([*contents, f"{len(recording.events) or 'no'} gait events"])


def _check_loads(
    recording: Recording, contacts: Sequence[PlateContact], threshold_n: float, found: Findings
) -> None:
    """Refuse plates on which nobody ever stands, and stated contacts that are not there."""
    name, plates = recording.source.name, {plate.number: plate for plate in recording.plates}
    loaded = {
        number: np.linalg.norm(plate.wrench_in_plate[:, :3], axis=1) > threshold_n
        for number, plate in plates.items()
    }
    if not plates:
        found.fault(name, recording.why_no_plates)
        return
    if not any(each.any() for each in loaded.values()):
        reason = f"nobody is on the plates: none is loaded by more than {threshold_n:g} N"
        found.fault(name, reason)

    def require(contact: PlateContact) -> None:
        require_contacts([contact], [*plates], recording.markers.time)
        number, time_s = contact.plate, contact.time_s
        if not loaded[number][np.argmin(np.abs(plates[number].time - time_s))]:
            raise ValueError(f"contacts: nobody is on plate {number} at {time_s:g} s")

    for contact in contacts:
        found.attempt(name, partial(require, contact))


def _check_body(
    study: Study, person: SubjectFile, pose: Recording, recording: Recording, found: Findings
) -> Body | None:
    """Weigh the subject and build the body."""
    name, mass = recording.source.name, None
    if pose.plates or person.static:
        mass = found.attempt(name, lambda: body_mass(person.person, pose, recording))
    if mass is not None:
        found.remark(name, mass.note)
    mass_kg = mass.mass_kg if mass is not None else ASSUMED_MASS_KG
    body = found.attempt(
        name,
        lambda: subject_body(
            pose,
            person.person,
            study.file.settings,
            mass_kg,
            marker_set=study.marker_set,
            hip_trial=read_study_file(study, person.hip_trial) if person.hip_trial else None,
            segments=read_segments(study.path(person.segments)) if person.segments else None,
        ),
    )
    found.remark(name, *(body.notes if body is not None else ()))
    return body


def _check_markers(body: Body, preview: Preview, found: Findings) -> None:
    """Say which markers are there, what they leave unknown, and which are often missing."""
    name, known = preview.beginning.source.name, body.marker_set
    present = list(known.present(preview.beginning.markers.names).segment)
    needed = [marker for marker in known.markers if not marker.optional]
    absent = [m.labels[0] for m in needed if not set(m.labels) & set(present)]
    there = f"{len(needed) - len(absent)} of the {len(needed)} markers of {known.name}"
    found.contents(name, f"{there}; missing: {listed(absent)}" if absent else there)
    used = {segment for marker, segment in body.segment_of.items() if marker in present}
    shown = {i for segment in used for i in support(LAST_Q[segment])}
    locked = tuple(c for i, c in enumerate(COORDINATES) if i not in shown)
    if locked:
        found.remark(name, Note.of("coordinates_held", coordinates=locked))
    missing = {m: preview.missing.get(m, 0.0) for m in present}
    often = [f"{m} {100 * s:.0f} %" for m, s in missing.items() if s > MAX_MISSING_SHARE]
    if often:
        found.remark(name, f"often missing: {', '.join(often)}")


def _check_window(
    body: Body,
    rule: Condition,
    preview: Preview,
    laboratory: Laboratory,
    settings: Settings,
    found: Findings,
) -> None:
    """Look for what counts: gait events, or the span that is stated."""
    recording, markers = preview.beginning, preview.beginning.markers
    name, settling = recording.source.name, settling_s(laboratory.filters(settings))
    time = markers.time[0] + np.arange(preview.frames) / markers.rate_hz
    every, least = np.ones(len(time), bool), settings.min_valid_share

    def span() -> None:
        low_pass(0 * time, time, settings.cutoff_hz, settings.filter)
        counted_span(rule.wanted, {}, time, settling, every, least)

    found.attempt(name, span)
    if rule.wanted not in (None, "cycle"):
        return
    events, note = gait_events(recording.events, markers, body.marker_set, settings.events)
    unknown = note.code == "events_unknown"
    if unknown and settings.events in (None, "auto", "plates"):
        return  # these need poses, and other markers than those that stand in for them here
    counted = [event for event in events if event.time >= rule.skip_s]
    if rule.wanted == "cycle" and not found_cycles(events, SIDES):
        reason = str(note) if unknown else cycle_shortage(events, (), time, every)
        found.fault(name, reason)
    elif rule.wanted == "cycle" and not found_cycles(counted, SIDES):
        found.fault(name, f"no gait cycle begins after the first {rule.skip_s:g} s, skip_s")
    elif unknown:
        found.remark(name, note)


def _check_ground(
    recording: Recording,
    laboratory: Laboratory,
    rule: Condition,
    settings: Settings,
    found: Findings,
) -> None:
    """Look for everything that compensation, platform pose and perturbations need."""
    name, bound = recording.source.name, None
    treadmill, calibration = laboratory.treadmill, laboratory.calibration
    if recording.plates:
        bound = found.attempt(name, lambda: bind(recording, laboratory, settings.plate_delay_s))
    if bound is not None and calibration is not None:
        speed_mps = mean_belt_speed(bound.belts)
        found.remark(name, *uncertainty_limits(speed_mps, calibration))
    platform, time = treadmill.platform, recording.markers.time
    pose = found.attempt(name, lambda: platform_pose(recording, platform, time))
    found.remark(name, *(pose[1] if pose is not None else ()))
    if rule.part == "motion" and platform is None:
        found.fault("study.toml", NO_POSE)
    known = recording.analog.names if recording.analog is not None else ()
    belts = treadmill.belt.speed_channels if treadmill.belt is not None else ()
    for channel in filter(None, (*belts, rule.pulse_channel)):
        if channel not in known:
            found.fault(name, f"no analog channel {channel!r}{did_you_mean(channel, known)}")


def study_recordings(study: Study) -> tuple[Path, ...]:
    """Give every recording that a study uses: trials, poses, hip trials, calibrations."""
    names: list[str | None] = [*study.file.treadmill.files]
    for person in study.subjects.values():
        names += [person.static, person.hip_trial]
    for trial in study.trials.values():
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
