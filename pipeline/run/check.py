"""A study checked before it is processed: what a run will use, leave out or refuse.

Every recording passes the stages of `pipeline.trial.process` that need no solved motion; what one
of them refuses is collected, and the next one follows.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import combinations
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from compensation import PlatformPose
from compensation.inertia.sensors import describe_sensors
from hbm.body import Body
from hbm.coordinates import COORDINATES, LAST_Q, support
from hbm.engines.engine import choose_engine
from hbm.ik.problem import Problem
from hbm.notes import Note
from hbm.plausibility.motion import implausible
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
from pipeline.io.read import file_format
from pipeline.io.recording import Recording
from pipeline.trial.gait.contact import require_contacts
from pipeline.trial.gait.cycles import found_cycles
from pipeline.trial.gait.events import SIDES, TIMED_BY_PLATES, gait_events, has_strides
from pipeline.trial.ground.accelerometers import mean_belt_speed
from pipeline.trial.ground.belts import belt_wrenches
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory, bind
from pipeline.trial.ground.platform import platform_pose
from pipeline.trial.ground.uncertainty import uncertainty_limits
from pipeline.trial.once import computing_once
from pipeline.trial.quality import Quality, flagged, settled_frames, settling_s
from pipeline.trial.study_files import labels_in_none, read_study_file, read_study_laboratory
from pipeline.trial.subject import (
    MassUnknownError,
    body_mass,
    differing_masses,
    roughly_weighed,
    subject_body,
)
from pipeline.trial.window import NO_POSE, what_counts

MIN_CYCLE_S: Final = 0.8
"""Gait cycle of fast walking: a recording cannot hold more cycles than of this duration."""
MAX_MISSING_SHARE: Final = 0.2
"""Share of the frames; a marker that is missing in more is named."""
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
    variant: str = ""
    """Which one is checked; empty for the study's own way. It adds only faults of its own."""
    read: dict[str, tuple[Note, ...]] = field(default_factory=dict)
    """Name of a file -> notes on reading it."""
    content: dict[str, str] = field(default_factory=dict)
    """Name of a file -> digest of its markers' positions."""

    def remark(self, place: str, *said: Note | str, contents: bool = False) -> None:
        """Add what is to be known of a place, or what a file holds."""
        for one in (Finding(place, one, contents) for one in said):
            if not self.variant and one not in self.remarks:
                self.remarks.append(one)

    def fault(self, place: str, reason: str) -> None:
        """Add what stops a trial."""
        of_variant = f"variant {self.variant}: {reason}" if self.variant else reason
        if not {Finding(place, reason), Finding(place, of_variant)} & {*self.faults}:
            self.faults.append(Finding(place, of_variant))

    def attempt(self, place: str, action: Callable[[], Result]) -> Result | None:
        """Give what a function returns; where it raises, its message is a fault of the place."""
        try:
            return action()
        except (ValueError, OSError) as error:
            self.fault(place, str(error))
            return None


def check_study(study: Study) -> Findings:
    """Check every recording of a study without processing it.

    Parameters
    ----------
    study
        The study; its TOML files are already checked.

    Returns
    -------
    Findings
        All faults of all files, not only the first; those of variants too.
    """
    found, ways = Findings(), {"": study, **study.variants}
    of_way = {way: replace(found, variant=way) for way in ways}  # they share their lists
    laboratories = {way: _check_laboratory(ways[way], of_way[way]) for way in ways}
    for subject, person in study.subjects.items():
        poses = {
            way: _read(ways[way], person.static, laboratories[way], of_way[way]) for way in ways
        }
        for name, trial in person.named_trials.items():
            if trial.exclude is not None:
                found.remark(str(name), f"excluded: {trial.exclude}")
                continue
            with computing_once() if study.variants else nullcontext():
                for way, own in ways.items():
                    _check_trial(own, name, laboratories[way], poses[way], of_way[way])
        without = [name for name in study.file.conditions if name not in person.trials]
        if without:
            found.remark(subject, f"no trial for {listed(without)}")
    _check_repeated(study, found)
    if absent := labels_in_none(found.read.values()):
        found.remark("study.toml", Note.of("rename_without_label", labels=absent))
    return found


def _check_laboratory(study: Study, found: Findings) -> Laboratory:
    """Read the laboratory, without calibrations where that fails; say what is doubtful."""
    file, treadmill = "study.toml", study.file.treadmill
    found.attempt(file, lambda: choose_engine(study.file.settings.engine))
    laboratory = found.attempt(file, lambda: read_study_laboratory(study)) or Laboratory(treadmill)
    found.remark(file, *laboratory.notes)
    if (calibration := laboratory.calibration) is not None:
        file = str(treadmill.calibration)
        found.remark(file, f"compensates {listed(calibration.plates)}", contents=True)
        found.remark(file, *calibration.notes, *describe_sensors(calibration.sensors))
    elif treadmill.platform is not None and not treadmill.calibration:
        found.remark(file, "no treadmill.calibration, so nothing will be compensated")
    return laboratory


def _read(
    study: Study,
    file: str | None,
    laboratory: Laboratory,
    found: Findings,
    trial: Trial | None = None,
    static: str | None = None,
) -> Recording | None:
    """Read a recording and correct its plates; None where there is none, or that fails."""

    def corrected(name: str) -> Recording:
        recording = read_study_file(study, name, trial, static)
        found.read[name] = recording.notes
        found.content[name] = sha256(recording.markers.position.tobytes()).hexdigest()
        return with_corrected_plates(recording, laboratory.plates)

    return found.attempt(file, lambda: corrected(file)) if file else None


def _check_trial(
    study: Study,
    trial_name: TrialName,
    laboratory: Laboratory,
    pose: Recording | None,
    found: Findings,
) -> None:
    """Pass the stages of a trial that need no solved motion, each as far as it can go."""
    person, trial = study.subject(trial_name.subject), study.trial(trial_name)
    rule, settings = study.rule(trial_name), study.file.settings
    recording = _read(study, trial.file, laboratory, found, trial, person.static)
    if recording is None:
        return
    name, markers = recording.source.name, recording.markers
    duration_s = len(markers.time) / markers.rate_hz
    found.remark(name, _contents(recording, duration_s), contents=True)
    found.remark(name, *recording.notes)
    if rule.cycles and duration_s < rule.skip_s + rule.cycles * MIN_CYCLE_S:
        found.remark(name, f"too short for {rule.cycles} gait cycles after {rule.skip_s:g} s")
    found.attempt(
        name, lambda: low_pass(0 * markers.time, markers.time, settings.cutoff_hz, settings.filter)
    )
    _check_loads(recording, trial.contacts, settings.contact_threshold_n, found)
    platform = _check_ground(recording, laboratory, rule, settings, found)
    standing = pose if person.static else recording
    if standing is None:
        return
    body = _check_body(study, person, standing, recording, found)
    if body is not None:
        _check_markers(body, recording, found)
        _check_window(body, rule, recording, platform, laboratory, settings, found)


def _contents(recording: Recording, duration_s: float) -> str:
    """Say what a file holds."""
    markers, plates, analog = recording.markers, recording.plates, recording.analog
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
    name, mass_kg = recording.source.name, ASSUMED_MASS_KG
    functional = study.file.settings.hip == "functional"
    if recording.plates:
        try:
            mass = body_mass(person.person, pose, recording)
            mass_kg = mass.mass_kg
            found.remark(name, mass.note, *differing_masses(mass.known_kg, None))
        except MassUnknownError as unknown:  # steps may weigh, which only a solved motion shows
            if found.attempt(name, partial(roughly_weighed, recording, unknown)):
                found.remark(name, f"{unknown}; else steps weigh, where plates carry them")
    body = found.attempt(
        name,
        lambda: subject_body(
            pose,
            person.person,
            study.file.settings,
            mass_kg,
            marker_set=study.marker_set,
            hip_trial=read_study_file(study, str(person.hip_trial)) if functional else None,
            segments=read_segments(study.path(person.segments)) if person.segments else None,
        ),
    )
    found.remark(name, *((*implausible(body), *body.notes) if body is not None else ()))
    return body


def _check_markers(body: Body, recording: Recording, found: Findings) -> None:
    """Say which markers are there, what they leave unknown, and which are often missing."""
    name, markers, known = recording.source.name, recording.markers, body.marker_set
    found.attempt(name, lambda: Problem(body, markers))
    present = list(known.present(markers.names).segment)
    needed = [marker for marker in known.markers if not marker.optional]
    absent = [m.labels[0] for m in needed if not set(m.labels) & set(present)]
    there = f"{len(needed) - len(absent)} of the {len(needed)} markers of {known.name}"
    there += f"; missing: {listed(absent)}" if absent else ""
    found.remark(name, there, contents=True)
    used = {segment for marker, segment in body.segment_of.items() if marker in present}
    shown = {i for segment in used for i in support(LAST_Q[segment])}
    locked = tuple(c for i, c in enumerate(COORDINATES) if i not in shown)
    if locked:
        found.remark(name, Note.of("coordinates_held", coordinates=locked))
    missing = np.isnan(markers.position[..., 0]).mean(axis=0)
    shares = {marker: missing[markers.names.index(marker)] for marker in present}
    often = [f"{m} {100 * s:.0f} %" for m, s in shares.items() if s > MAX_MISSING_SHARE]
    if often:
        found.remark(name, f"often missing: {', '.join(often)}")


def _check_ground(
    recording: Recording,
    laboratory: Laboratory,
    rule: Condition,
    settings: Settings,
    found: Findings,
) -> PlatformPose | None:
    """Look for what compensation, platform pose and perturbations need; give the pose, if known."""
    name, markers, treadmill = recording.source.name, recording.markers, laboratory.treadmill
    bound, belt, models = None, treadmill.belt, laboratory.belts
    if recording.plates:
        bound = found.attempt(name, lambda: bind(recording, laboratory, settings.plate_delay_s))
    if bound is not None and laboratory.calibration is not None:
        speed_mps = mean_belt_speed(bound.belts)
        found.remark(name, *uncertainty_limits(speed_mps, laboratory.calibration))
    if recording.plates and belt is not None and models:
        times = [markers.time] * len(recording.plates)
        found.attempt(name, lambda: belt_wrenches(recording, models, belt, times, settings.filter))
    placed = found.attempt(name, lambda: platform_pose(recording, treadmill.platform, markers.time))
    pose, notes = placed or (None, ())
    found.remark(name, *notes)
    if rule.part == "motion" and treadmill.platform is None:
        found.fault("study.toml", NO_POSE)
    known = recording.analog.names if recording.analog is not None else ()
    belts = belt.speed_channels if belt is not None and not models else ()
    for channel in filter(None, (*belts, rule.pulse_channel)):
        if channel not in known:
            found.fault(name, f"no analog channel {channel!r}{did_you_mean(channel, known)}")
    return pose


def _check_window(
    body: Body,
    rule: Condition,
    recording: Recording,
    platform: PlatformPose | None,
    laboratory: Laboratory,
    settings: Settings,
    found: Findings,
) -> None:
    """Look for what counts, by the events of the file or, in place of better ones, by markers."""
    name, markers, time = recording.source.name, recording.markers, recording.markers.time
    channels = recording.analog.names if recording.analog is not None else ()
    settling = settling_s(laboratory.filters(settings))
    settled = settled_frames(np.ones(len(time), bool), time, settling)
    quality, least = flagged({Quality.SETTLING: ~settled}), settings.min_valid_share
    events, note = gait_events(recording.events, markers, body.marker_set, settings.events)
    unknown = note.code == "events_unknown"
    source = settings.events or ("file" if has_strides(recording.events) else "auto")
    guessed = source in TIMED_BY_PLATES  # the run's events need poses; these may err
    if unknown and not guessed:
        found.remark(name, note)

    def count(rule: Condition) -> None:
        notes = [note]
        counted = what_counts(recording, events, quality, rule, settling, platform, notes, least)
        later = [event for event in events if event.time >= rule.skip_s]
        sure = not guessed or (
            rule.wanted == "cycle" and not unknown and not found_cycles(later, SIDES)
        )
        if sure or (rule.perturbed and (counted.onsets < rule.skip_s).all()):
            for shortage in (one for one in notes if one.code == "no_residuals"):
                found.fault(name, str(shortage.values["reason"]))

    if rule.perturbed:  # all gait cycles first: without any, perturbations do not matter
        found.attempt(
            name, lambda: count(rule.model_copy(update={"perturbed": False, "window": "cycle"}))
        )
        needs_pose = rule.pulse_channel is None or rule.part == "motion"
        if rule.pulse_channel not in (None, *channels) or (needs_pose and platform is None):
            return  # a fault of the ground
    found.attempt(name, lambda: count(rule))


def _check_repeated(study: Study, found: Findings) -> None:
    """Refuse a recording of two subjects, and one that counts twice, whatever its name."""
    uses: dict[str, list[tuple[str, TrialName | None]]] = {}
    for subject, person in study.subjects.items():
        trials = [(trial.file, name) for name, trial in person.named_trials.items()]
        for file, name in [(person.static, None), *trials]:
            if file in found.content and (name is None or study.trial(name).exclude is None):
                uses.setdefault(found.content[file], []).append((subject, name))
    for of_content in uses.values():
        for (subject, name), (other_subject, other) in combinations(of_content, 2):
            place, same = str(other or other_subject), f"the same recording as {name or subject}"
            if subject != other_subject:
                found.fault(place, f"{same}, another subject")
            elif name is not None and other is not None:
                rules = [study.rule(each) for each in (name, other)]
                spans = [
                    rule.wanted if isinstance(rule.wanted, tuple) else (rule.skip_s, np.inf)
                    for rule in rules
                ]
                starts, stops = zip(*spans, strict=True)
                if max(starts) >= min(stops):
                    continue
                if rules[0].perturbed != rules[1].perturbed:
                    found.remark(place, same)
                else:
                    found.fault(place, f"{same}: it counts twice; exclude one, or state windows")


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
