"""A study checked before it is processed: what a run will use, leave out or refuse.

Every recording passes the stages of `pipeline.trial.chain` that need no solved motion; what one of
them refuses is collected, and the next one follows.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from joblib import delayed

from compensation import PlatformPose
from compensation.inertia.sensors import describe_sensors
from hbm.body import Body
from hbm.coordinates import COORDINATES
from hbm.ik.problem import known_markers, undetermined
from hbm.notes import Note, warnings_of
from hbm.numbers import read_numbers
from hbm.plausibility.motion import implausible
from hbm.signals.filtering import low_pass
from hbm.spelling import counted, did_you_mean, listed
from pipeline.config.schema import Condition, PlateContact, SubjectFile, Trial, WantedWindow
from pipeline.config.study import Study
from pipeline.io.c3d.second_reader import compare_readers
from pipeline.io.input_file import describe_error
from pipeline.io.recording import Recording
from pipeline.run.processes import in_processes
from pipeline.trial.chain import Chain
from pipeline.trial.gait.contact import require_contacts
from pipeline.trial.gait.cycles import found_cycles
from pipeline.trial.gait.events import BY_PLATES, SIDES, choose_method, foot_swings, gait_events
from pipeline.trial.ground.accelerometers import mean_belt_speed
from pipeline.trial.ground.belts import belt_wrenches
from pipeline.trial.ground.laboratory import Laboratory, with_corrected_plates
from pipeline.trial.ground.platform import platform_pose
from pipeline.trial.ground.wrenches import uncertainty_limits
from pipeline.trial.inputs import Inputs
from pipeline.trial.plate_units import require_units, reversed_plates
from pipeline.trial.quality import Quality, flagged, settled_frames
from pipeline.trial.study_files import (
    read_body_files,
    read_study_file,
    read_study_laboratory,
    saying_what_was_read,
    unused_renames,
)
from pipeline.trial.subject import (
    BodyMass,
    MassUnknownError,
    body_mass,
    differing_masses,
    roughly_weighed,
)
from pipeline.trial.window import NO_POSE, what_counts

LIMITS: Final = read_numbers("pipeline.run", "thresholds.toml", "check")
USED: Final = {
    "sex": "mean of women and men",
    "height_m": "the file's, else by the legs",
    "mass_kg": "by the plates, else the file's",
}
"""Key that is not stated of a subject -> what is used instead."""
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Finding:
    """What to know of a file or trial before it is processed."""

    place: str
    said: Note | str
    contents: bool = False
    """Whether it is only what a file holds."""
    variant: str = ""
    """Which one it is about; empty for the study's main way."""

    @property
    def doubtful(self) -> bool:
        """Whether somebody should look at it."""
        return not self.contents if isinstance(self.said, str) else self.said.level == "warning"

    def __str__(self) -> str:
        text, name = str(self.said), Path(self.place).name
        if text.startswith(f"{name}: "):
            text = self.place + text.removeprefix(name)
        sentence = f"variant {self.variant}: {text}" if self.variant else text
        named = isinstance(self.said, str) and self.place in sentence
        return sentence if named else f"{self.place}: {sentence}"


@dataclass(slots=True)
class Findings:
    """What a check found, each thing once: faults stop a trial, remarks do not."""

    faults: list[Finding] = field(default_factory=list)
    remarks: list[Finding] = field(default_factory=list)
    variant: str = ""
    """Which one is checked; empty for the study's main way. It adds only faults of its own."""
    read: dict[str, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    """Name of a file -> digest of its markers' positions, labels to rename that it lacks."""
    known: set[Finding] = field(default_factory=set)
    """All of both kinds."""

    def remark(self, place: str, *said: Note | str, contents: bool = False) -> None:
        """Add what is to be known of a place, or what a file holds."""
        if not self.variant:
            self._add(self.remarks, (Finding(place, text, contents) for text in said))

    def fault(self, place: str, reason: str) -> None:
        """Add what stops a trial."""
        self._add(self.faults, [Finding(place, reason, variant=self.variant)])

    def include(self, others: "Findings") -> None:
        """Add what another check found, in another process."""
        self._add(self.faults, others.faults)
        self._add(self.remarks, others.remarks)
        self.read.update(others.read)

    def _add(self, kind: list[Finding], findings: Iterable[Finding]) -> None:
        """Add those that are not known, of a variant nor of the main way."""
        for finding in findings:
            if self.known.isdisjoint((finding, replace(finding, variant=""))):
                self.known.add(finding)
                kind.append(finding)

    def attempt(self, place: str, action: Callable[[], Result]) -> Result | None:
        """Give what a function returns; where it raises, its message is a fault of the place."""
        try:
            return action()
        except (ValueError, OSError) as error:
            self.fault(place, describe_error(error))
            return None


@dataclass(frozen=True, slots=True)
class Way:
    """One way of processing a study, its own or a variant, with what is found about it."""

    study: Study
    laboratory: Laboratory
    findings: Findings

    @classmethod
    def of(cls, study: Study, findings: Findings) -> "Way":
        """Read the laboratory, without calibrations where that fails; say what is doubtful."""
        file, treadmill = "study.toml", study.file.treadmill
        laboratory = findings.attempt(file, lambda: read_study_laboratory(study))
        laboratory = laboratory or Laboratory(treadmill)
        findings.remark(file, *laboratory.notes)
        if (calibration := laboratory.calibration) is not None:
            file = str(treadmill.calibration)
            findings.remark(file, f"compensates {listed(calibration.plates)}", contents=True)
            findings.remark(file, *calibration.notes, *describe_sensors(calibration.sensors))
        elif treadmill.platform is not None and not treadmill.calibration:
            findings.remark(file, "no treadmill.calibration, so nothing will be compensated")
        return cls(study, laboratory, findings)

    def read(
        self, file: str | None, trial: Trial | None = None, static: str | None = None
    ) -> Recording | None:
        """Read a recording and correct its plates; None where there is none, or that fails."""

        def corrected(file: str) -> Recording:
            recording = read_study_file(self.study, file, trial, static)
            # every coordinate in one piece, as in memory
            digest = sha256(np.moveaxis(recording.markers.position, 0, -1).tobytes()).hexdigest()
            self.findings.read[file] = digest, recording.labels_absent
            return with_corrected_plates(recording, self.laboratory.plates)

        return self.findings.attempt(file, lambda: corrected(file)) if file else None


def check_study(study: Study, jobs: int | None = 1) -> Findings:
    """Check every recording of a study without processing it.

    Parameters
    ----------
    study
        The study; its TOML files are already checked.
    jobs
        How many subjects at a time; None: as `pipeline.run.processes.in_processes` chooses.

    Returns
    -------
    Findings
        All faults of all files, not only the first; those of variants too.
    """
    findings = Findings()
    findings.attempt(str(study.folder), study.to_process)
    variants = {"": study, **study.variants}
    # ways share the lists of findings
    ways = [Way.of(way, replace(findings, variant=name)) for name, way in variants.items()]
    tasks = (
        delayed(_check_subject)([replace(way, study=way.study.alone(subject)) for way in ways])
        for subject in study.subjects
    )
    for of_subject in in_processes(tasks, jobs, ordered=True):
        findings.include(of_subject)
    _remark_unstated(study, findings)
    _remark_repeated(study, findings)
    renames = unused_renames(absent for _, absent in findings.read.values())
    findings.remark("study.toml", *(fact.note for fact in renames))
    return findings


def _check_subject(ways: Sequence[Way]) -> Findings:
    """Check the recordings of the one subject of some ways, the first of which is the main one."""
    study, findings = ways[0].study, Findings()
    ways = [replace(way, findings=replace(findings, variant=way.findings.variant)) for way in ways]
    ((subject, person),) = study.subjects.items()
    poses = [way.read(person.static) for way in ways]
    for name, trial in person.named_trials.items():
        if trial.exclude is not None:
            findings.remark(str(name), f"excluded: {trial.exclude}")
            continue
        for way, pose in zip(ways, poses, strict=True):
            recording = way.read(trial.file, trial, person.static)
            if recording is not None:
                _TrialCheck(way, person, trial, way.study.rule(name), recording).run(pose)
    if without := [name for name in study.file.conditions if name not in person.trials]:
        findings.remark(subject, f"no trial for {listed(without)}")
    return findings


class _TrialCheck:
    """The stages of a trial that need no solved motion, each passed as far as it can go."""

    def __init__(
        self, way: Way, person: SubjectFile, trial: Trial, rule: Condition, recording: Recording
    ) -> None:
        self.study, self.laboratory, self.findings = way.study, way.laboratory, way.findings
        self.person, self.trial, self.rule = person, trial, rule
        self.recording, self.markers, self.plates = recording, recording.markers, recording.plates
        self.settings = way.study.file.settings
        inputs = Inputs(
            recording=recording,
            subject=person.person,
            marker_set=self.study.marker_set,
            laboratory=self.laboratory,
        )
        self.chain = Chain(inputs, self.settings).changed(trial=recording)
        self.channels = recording.analog.names if recording.analog is not None else ()
        self.file = str(trial.file)
        self.remark = partial(self.findings.remark, self.file)
        self.fault = partial(self.findings.fault, self.file)

    def attempt(self, action: Callable[[], Result]) -> Result | None:
        """Give what a function returns; where it raises, that is a fault of the recording."""
        return self.findings.attempt(self.file, action)

    def run(self, pose: Recording | None) -> None:
        """Pass all stages; the pose is that of the static recording, where it could be read."""
        time, settings, rule = self.markers.time, self.settings, self.rule
        duration_s = len(time) / self.markers.rate_hz
        self.remark(self.contents(duration_s), contents=True)
        self.remark(*self.recording.notes)
        if rule.cycles and duration_s < rule.skip_s + rule.cycles * LIMITS.shortest_cycle:
            self.remark(f"too short for {rule.cycles} gait cycles after {rule.skip_s:g} s")
        self.attempt(lambda: low_pass(0 * time, time, settings.cutoff_hz, settings.filter))
        stepped_on = self.check_loads()
        platform = self.check_ground()
        standing = pose if self.person.static else self.recording
        body = None if standing is None else self.body(standing)
        if body is not None:
            self.check_markers(body)
            self.check_window(body, platform, stepped_on=stepped_on)

    def contents(self, duration_s: float) -> str:
        """Say what the file holds."""
        rate_hz, plates, analog = self.markers.rate_hz, self.plates, self.recording.analog
        contents = [f"{duration_s:.1f} s, {len(self.markers.names)} markers at {rate_hz:g} Hz"]
        if plates:
            contents.append(f"{counted(len(plates), 'plate')} at {plates[0].rate_hz:.6g} Hz")
        if analog is not None:
            channels = zip(analog.names, analog.units, strict=True)
            contents.append("channels " + " ".join(f"{c} [{unit}]" for c, unit in channels))
        return ", ".join([*contents, f"{len(self.recording.events) or 'no'} gait events"])

    def check_loads(self) -> bool:
        """Refuse plates on which nobody ever stands, and stated contacts that are not there.

        Gives whether somebody may step on a plate.
        """
        threshold_n, plates = self.settings.contact_threshold_n, {p.number: p for p in self.plates}
        loaded = {
            number: np.linalg.norm(plate.wrench_in_plate[:, :3], axis=1) > threshold_n
            for number, plate in plates.items()
        }
        if not plates:
            self.fault(self.recording.why_no_plates)
        elif not any(samples.any() for samples in loaded.values()):
            self.fault(f"nobody is on the plates: none is loaded by more than {threshold_n:g} N")

        def require(contact: PlateContact) -> None:
            require_contacts([contact], [*plates], self.markers.time)
            number, time_s = contact.plate, contact.time_s
            if not loaded[number][np.argmin(np.abs(plates[number].time - time_s))]:
                raise ValueError(f"contacts: nobody is on plate {number} at {time_s:g} s")

        self.remark(*(fact.note for fact in reversed_plates(self.recording).values()))
        self.attempt(lambda: require_units(self.recording, self.person.person.mass_kg))
        contacts = self.trial.contacts if plates else ()
        for contact in contacts:
            self.attempt(partial(require, contact))
        self.attempt(lambda: require_contacts(contacts, [*plates], self.markers.time))
        starts = (samples[1:] > samples[:-1] for samples in loaded.values())
        # what a moving plate reads without load may exceed the threshold until it is compensated
        return self.laboratory.calibration is not None or any(map(np.any, starts))

    def body(self, pose: Recording) -> Body | None:
        """Weigh the subject and build the body."""
        # where it is not stated, any mass does: only the positions of joints are used
        person, mass = self.person, BodyMass.rough(70.0)
        if self.plates:
            try:
                mass = body_mass(person.person, pose, self.recording)
                self.remark(mass.note, *differing_masses(mass.known_kg, None))
            except MassUnknownError as unknown:  # steps may weigh, which a solved motion shows
                if self.attempt(partial(roughly_weighed, self.recording, unknown)):
                    self.remark(f"{unknown}; else steps weigh, where plates carry them")

        def build() -> Body:
            hips, segments = read_body_files(self.study, person)
            files = {"standing": pose, "hip_trial": hips, "segments": segments or {}}
            with saying_what_was_read(pose, hips):
                return self.chain.changed(mass=mass, **files).body

        body = self.attempt(build)
        self.remark(*((*implausible(body), *body.notes) if body is not None else ()))
        return body

    def check_markers(self, body: Body) -> None:
        """Say which markers are there, what they leave unknown, and which are often missing."""
        names, marker_set = self.markers.names, body.marker_set
        self.attempt(lambda: known_markers(body, self.markers))
        present = list(marker_set.present(names).segment)
        needed = [marker for marker in marker_set.markers if not marker.optional]
        absent = [m.labels[0] for m in needed if not set(m.labels) & set(present)]
        there = f"{len(needed) - len(absent)} of the {len(needed)} markers of {marker_set.name}"
        self.remark(there + f"; missing: {listed(absent)}" * bool(absent), contents=True)
        missing = np.isnan(self.markers.position[..., 0]).mean(axis=0)
        shares = {marker: missing[names.index(marker)] for marker in present}
        held, _ = undetermined(body, tuple(m for m, fraction in shares.items() if fraction < 1))
        if held.any():
            coordinates = tuple(np.array(COORDINATES)[held].tolist())
            self.remark(Note.of("coordinates_held", coordinates=coordinates))
        most = LIMITS.largest_missing
        if often := [f"{m} {100 * s:.0f} %" for m, s in shares.items() if s > most]:
            self.remark(f"often missing: {', '.join(often)}")

    def check_ground(self) -> PlatformPose | None:
        """Look for what compensation, platform and perturbations need; give the known pose."""
        recording, laboratory, time = self.recording, self.laboratory, self.markers.time
        rule, settings, calibration = self.rule, self.settings, laboratory.calibration
        treadmill, models = laboratory.treadmill, laboratory.belts
        platform, belt = treadmill.platform, treadmill.belt
        if self.plates:
            lab = self.attempt(lambda: self.chain.lab)
            if lab is not None and calibration is not None:
                self.remark(*uncertainty_limits(mean_belt_speed(lab.belts), calibration))
        if self.plates and belt is not None and models:
            times = [time] * len(self.plates)
            self.attempt(lambda: belt_wrenches(recording, models, belt, times, settings.filter))
        pose, notes = self.attempt(lambda: platform_pose(recording, platform, time)) or (None, ())
        self.remark(*notes)
        if rule.part == "motion" and platform is None:
            self.findings.fault("study.toml", NO_POSE)
        belts = belt.speed_channels if belt is not None and not models else ()
        for channel in filter(None, (*belts, rule.pulse_channel)):
            if channel not in self.channels:
                hint = did_you_mean(channel, self.channels)
                self.fault(f"no analog channel {channel!r}{hint}")
        return pose

    def check_window(self, body: Body, platform: PlatformPose | None, *, stepped_on: bool) -> None:
        """Look for what counts, by the file's events or, in place of better ones, by markers."""
        recording, markers, settings = self.recording, self.markers, self.settings
        time, least = markers.time, settings.min_valid_share
        settling = self.chain.settling
        settled = settled_frames(np.ones(len(time), bool), time, settling)
        quality = flagged({Quality.SETTLING: ~settled})
        swings = foot_swings(markers, body.marker_set)
        source, doubts = choose_method(recording.events, swings, settings.events)
        self.remark(*warnings_of(doubts))
        events, note, unknown = gait_events(recording.events, markers, body.marker_set, source)
        guessed = source in BY_PLATES  # the run's events need poses; these may err
        if unknown and not guessed:
            self.remark(note)

        def count(rule: Condition) -> None:
            rest = settling, platform, least, swings.feet, unknown
            counted = what_counts(recording, events, quality, rule, *rest)
            later = [event for event in events if event.time >= rule.skip_s]
            shown = found_cycles(later, SIDES) if rule.wanted == "cycle" else counted.found
            stepped = shown if source == "auto" else stepped_on
            no_step = not (stepped or unknown)
            unperturbed = rule.perturbed and (counted.onsets < rule.skip_s).all()
            sure = not guessed or no_step or unperturbed or rule.skip_s > time[-1]
            if counted.shortage and sure:
                self.fault(counted.shortage)
            elif counted.shortage and not unknown:
                before = "by the markers' gait events, before a pose is solved"
                self.remark(f"{before}: {counted.shortage}")

        pulse = self.rule.pulse_channel
        if self.rule.perturbed:  # all gait cycles first: without any, perturbations do not matter
            cycles = self.rule.model_copy(update={"perturbed": False, "window": "cycle"})
            self.attempt(lambda: count(cycles))
            needs_pose = pulse is None or self.rule.part == "motion"
            if pulse not in (None, *self.channels) or (needs_pose and platform is None):
                return  # a fault of the ground
        self.attempt(lambda: count(self.rule))


def _remark_unstated(study: Study, findings: Findings) -> None:
    """Say in one line what is not stated of subjects, and what is used instead."""
    people = study.subjects.values()
    without = {
        "sex": [one.id for one in people if one.sex == "unspecified"],
        "height_m": [one.id for one in people if one.height_m is None],
        "mass_kg": [one.id for one in people if one.mass_kg is None],
    }
    parts = [f"{key} of {listed(of, 3)} ({USED[key]})" for key, of in without.items() if of]
    usual = not (without["sex"] or without["height_m"])  # plates weigh best
    if parts:
        findings.remark("subjects", f"not stated: {', '.join(parts)}", contents=usual)


def _remark_repeated(study: Study, findings: Findings) -> None:
    """Name trials, and poses of other subjects, that are one recording, whatever its name.

    Of two subjects it is a fault. Windows of one subject may overlap on purpose.
    """
    groups: dict[str, dict[str, tuple[str, WantedWindow]]] = {}
    for subject, person in study.subjects.items():
        trials = [(n, trial) for n, trial in person.named_trials.items() if trial.exclude is None]
        uses = [(str(name), trial.file, study.rule(name).wanted) for name, trial in trials]
        for use, file, part in [*uses, (subject, person.static, None)]:
            if file not in findings.read:
                continue
            group = groups.setdefault(findings.read[file][0], {})
            newest, _ = next(reversed(group.values()), ("", None))
            if use != subject or subject != newest:  # a subject's uses follow each other
                group[use] = subject, part
    for group in groups.values():
        first, *others = group
        owners, windows = zip(*group.values(), strict=True)
        spans = sorted(window for window in windows if isinstance(window, tuple))
        apart = len(spans) == len(group) and all(a[1] <= b[0] for a, b in pairwise(spans))
        if others and not (apart and len({*owners}) == 1):
            same = f"the same recording as {listed(others, len(others))}"
            if len({*owners}) > 1:
                findings.fault(first, f"{same}; a recording is of one subject: correct one file")
            else:
                findings.remark(first, f"{same}; frames that several use count more than once")


def study_recordings(study: Study) -> tuple[Path, ...]:
    """Give every C3D file that a study uses: trials, poses, hip trials, calibrations."""
    return tuple(study.path(name) for name in study.files if name.lower().endswith(".c3d"))


def read_twice(path: Path, findings: Findings) -> bool:
    """Compare our reading of a C3D file with ezc3d's; each disagreement is a fault.

    Gives whether both readings are the same; a remark says why ezc3d does not read a file.
    """
    second = findings.attempt(path.name, lambda: compare_readers(path))
    if second is None:
        return False
    for line in second.disagreements:
        findings.fault(path.name, line)
    if second.refusal and not second.disagreements:
        findings.remark(path.name, f"{second.reader} does not read it: {second.refusal}")
    return not (second.refusal or second.disagreements)
