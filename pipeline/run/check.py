"""A study looked over before any computing: what a run will use, lock, fill or refuse."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from compensation import Calibration, check_calibration
from hbm.body import Body
from hbm.coordinates import COORDINATES, LAST, support
from hbm.markers import MarkerSet, did_you_mean
from pipeline.config.schema import Condition, SubjectFile, Trial
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments
from pipeline.io.preview import Preview, preview_recording
from pipeline.io.recording import Recording
from pipeline.trial.gait.events import gait_events
from pipeline.trial.ground.belts import read_belts
from pipeline.trial.ground.laboratory import (
    Laboratory,
    accelerations,
    models_of,
    platform_pose,
    read_calibration,
)
from pipeline.trial.process import read_file
from pipeline.trial.subject_body import subject_body
from pipeline.trial.weighing import body_mass

SHORTEST_S = 5.0
SHORTEST_CYCLE_S = 0.8
OFTEN_MISSING = 0.2
UNKNOWN_KG = 70.0
Found = TypeVar("Found")


@dataclass(frozen=True, slots=True)
class Findings:
    """What was found: ``faults`` stop a trial, ``remarks`` do not; one sentence each."""

    faults: tuple[str, ...]
    remarks: tuple[str, ...]


def check_study(study: Study) -> Findings:
    """Look at every recording of a study and say what a run will make of it.

    Parameters
    ----------
    study
        The study; its TOML files are already checked.

    Returns
    -------
    Findings
        All faults of all files, not only the first. A recording is judged by its header, its
        beginning and frames spread over it; a fault is held against all of it before it is told.
    """
    notes = _Notes()
    calibration = _calibration(study, notes)
    seen: dict[Path, str] = {}
    for subject, person in study.subjects.items():
        for condition, trial in person.trials.items():
            if trial.exclude is not None:
                notes.remarks.append(f"{subject} {condition}: excluded: {trial.exclude}")
            elif trial.file is not None:
                path = study.path(trial.file)
                other = seen.setdefault(path.resolve(), f"{subject} {condition}")
                if other != f"{subject} {condition}":
                    said = f"{subject} {condition}: the same recording as {other}"
                    notes.remarks.append(said)
                notes += _look(study, condition, person, trial, calibration)
        missing = [name for name in study.file.conditions if name not in person.trials]
        if missing:
            notes.remarks.append(f"{subject}: no trial for {', '.join(missing)}")
    return Findings(tuple(dict.fromkeys(notes.faults)), tuple(dict.fromkeys(notes.remarks)))


@dataclass(slots=True)
class _Notes:
    """Faults and remarks as they are found."""

    faults: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def __iadd__(self, other: "_Notes") -> "_Notes":
        self.faults += other.faults
        self.remarks += other.remarks
        return self

    def of(self, name: str, what: Callable[[], Found]) -> Found | None:
        """Give what a function finds; where it raises, its reason is a fault of the file."""
        try:
            return what()
        except (ValueError, OSError) as error:
            text = str(error)
            self.faults.append(text if name in text else f"{name}: {text}")
            return None


def _calibration(study: Study, notes: _Notes) -> Calibration | None:
    treadmill = study.file.treadmill
    belt = treadmill.belt
    if belt is not None:
        path = study.path(belt.calibration)
        notes.of(path.name, lambda: read_belts(path, belt, study.file.axes))
    if not treadmill.calibration:
        notes.remarks.append("study.toml: no treadmill.calibration, so nothing will be compensated")
        return None
    path = study.path(treadmill.calibration)
    found = notes.of(path.name, lambda: read_calibration(path, treadmill, study.file.axes))
    if found is not None:
        for plate, model in found.plates.items():
            notes.remarks += [f"{path.name}: {note}" for note in check_calibration(model, plate)]
        notes.remarks.append(f"{path.name}: compensates {', '.join(found.plates)}")
    return found


def _look(
    study: Study,
    condition: str,
    person: SubjectFile,
    trial: Trial,
    calibration: Calibration | None,
) -> _Notes:
    """Look at one trial: at its beginning, and if that has a fault, at all of it."""
    file, rule = study.file, study.file.conditions[condition]
    laboratory = Laboratory(file.treadmill, calibration)
    name, *_ = trial.files
    path = study.path(name)
    forces, record = (study.path(name) if name else None for name in (trial.forces, trial.record))

    def judge(preview: Preview) -> _Notes:
        notes = _Notes()
        pose: Recording | None = preview.beginning
        static = person.static
        if static is not None:
            pose = notes.of(study.path(static).name, lambda: read_file(study, static))
        _recorded(preview, rule, notes)
        if pose is not None:
            _body(study, person, preview, pose, notes)
        _moving(preview.beginning, laboratory, rule, notes)
        return notes

    notes = _Notes()
    preview = notes.of(
        path.name,
        lambda: preview_recording(path, file.axes, forces, record=record, rename=file.rename),
    )
    if preview is not None:
        notes = judge(preview)
        if not notes.faults:
            return notes
    whole = _Notes()
    recording = whole.of(path.name, lambda: read_file(study, name, trial))
    if recording is None:
        return whole
    missing = preview.missing if preview is not None else {}
    return judge(Preview(recording, len(recording.markers.time), missing))


def _recorded(preview: Preview, rule: Condition, notes: _Notes) -> None:
    """Say what a file holds, and whether that is enough."""
    recording = preview.beginning
    name, rate_hz = recording.source.name, recording.markers.rate_hz
    duration = preview.frames / rate_hz
    plates, analog = recording.plates, recording.analog
    said = [f"{duration:.1f} s", f"{len(recording.markers.names)} markers at {rate_hz:g} Hz"]
    if plates:
        said.append(f"{len(plates)} plates at {plates[0].rate_hz:.6g} Hz")
    if analog is not None:
        channels = zip(analog.names, analog.units, strict=True)
        said.append("channels " + " ".join(f"{c} [{unit}]" for c, unit in channels))
    said.append(f"{len(recording.events) or 'no'} gait events")
    notes.remarks.append(f"{name}: {', '.join(said)}")
    notes.remarks += [f"{name}: {note}" for note in recording.notes]
    if not plates:
        notes.faults.append(f"{name}: no force plates")
    if duration < SHORTEST_S:
        said = [f"lasts {duration:.1f} s; a trial needs {SHORTEST_S:g} s at least"]
        notes.faults.append(f"{name}: {said[0]}")
    elif rule.cycles and duration < rule.skip_s + rule.cycles * SHORTEST_CYCLE_S:
        notes.remarks.append(
            f"{name}: too short for {rule.cycles} gait cycles after {rule.skip_s:g} s"
        )
    notes.of(name, lambda: gait_events(recording))


def _body(
    study: Study, person: SubjectFile, preview: Preview, pose: Recording, notes: _Notes
) -> None:
    """Say what body will be built, what of it is locked, and which markers have gaps."""
    settings, name = study.file.settings, preview.beginning.source.name
    weighed = (
        notes.of(name, lambda: body_mass(person.person, pose))
        if pose.plates or person.static
        else None
    )
    if weighed is not None:
        notes.remarks.append(f"{name}: {weighed[1]}")

    def build() -> Body:
        return subject_body(
            pose,
            person.person,
            settings,
            weighed[0] if weighed is not None else UNKNOWN_KG,
            marker_set=study.marker_set,
            hip_trial=read_file(study, person.hip_trial) if person.hip_trial else None,
            segments=read_segments(study.path(person.segments)) if person.segments else None,
        )

    body = notes.of(name, build)
    if body is None:
        return
    _markers(name, body, body.marker_set, preview, notes)
    notes.remarks += [f"{name}: {note}" for note in body.notes]


def _markers(name: str, body: Body, chosen: MarkerSet, preview: Preview, notes: _Notes) -> None:
    present = [marker for marker in chosen.segment if marker in preview.beginning.markers.names]
    absent = [marker for marker in chosen.segment if marker not in present]
    said = f"{len(present)} of the {len(chosen.segment)} markers of {chosen.name}"
    missing = f"; missing: {', '.join(absent)}" if absent else ""
    notes.remarks.append(f"{name}: {said}{missing}")
    used = [s for m, s in zip(body.markers, body.marker_segment, strict=True) if m in present]
    shown = {i for segment in used for i in support(LAST[segment])}
    locked = [c for i, c in enumerate(COORDINATES) if i not in shown]
    if locked:
        notes.remarks.append(f"{name}: will be locked at neutral: {', '.join(locked)}")
    gaps = {m: preview.missing.get(m, 0.0) for m in present}
    often = [f"{m} {100 * share:.0f} %" for m, share in gaps.items() if share > OFTEN_MISSING]
    if any(gaps.values()):
        count = sum(share > 0 for share in gaps.values())
        said = f"{count} markers have gaps, and will be left out of the fit there"
        notes.remarks.append(
            f"{name}: {said}{'; often missing: ' if often else ''}{', '.join(often)}"
        )


def _moving(recording: Recording, laboratory: Laboratory, rule: Condition, notes: _Notes) -> None:
    """Say whether compensation, platform and perturbations will be found."""
    name, treadmill = recording.source.name, laboratory.treadmill
    if laboratory.calibration is not None and recording.plates:
        readings = notes.of(name, lambda: accelerations(recording, treadmill))
        if readings is not None:
            notes.of(name, lambda: models_of(recording, laboratory))
    time, platform = recording.markers.time, treadmill.platform
    pose = notes.of(name, lambda: platform_pose(recording, platform, time))
    if pose is not None:
        notes.remarks += [f"{name}: {note}" for note in pose[1]]
    known = recording.analog.names if recording.analog is not None else ()
    belts = treadmill.belt.speed_channels if treadmill.belt is not None else ()
    for channel in filter(None, (*belts, rule.pulse_channel)):
        if channel not in known:
            hint = did_you_mean(channel, known)
            notes.faults.append(f"{name}: no analog channel {channel!r}{hint}")
