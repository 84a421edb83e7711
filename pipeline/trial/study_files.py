"""Files of a study, read as the study states it; labels to rename that no file has."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from compensation import Calibration
from hbm.segments import SegmentOverride
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.schema import SubjectFile, Trial
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments, require_file
from pipeline.io.read import read_recording
from pipeline.io.recording import Fact, Recording, saying
from pipeline.trial.ground.calibrations import read_belts, read_calibration, read_check
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.plate_units import reversed_plates


def read_study_file(
    study: Study, name: str, trial: Trial | None = None, static: str | None = None
) -> Recording:
    """Read a recording of a study, with the axes, labels and units that the study states.

    Parameters
    ----------
    study
        The study.
    name
        The file.
    trial
        The trial whose file it is, for the forces or the record beside it.
    static
        The subject's static recording: its axes hold where the file does not show them.

    Returns
    -------
    Recording
        As `read_recording` gives it, with its errors.

    Raises
    ------
    ValueError
        If one of them is missing, with the nearest name that is there.
    """
    trial = trial or Trial()
    for wanted in filter(None, (name, trial.forces, trial.record)):
        require_file(study.folder, wanted)
    return read_recording(
        study.path(name),
        study.stated_of(trial),
        study.path(trial.forces) if trial.forces else None,
        record=study.path(trial.record) if trial.record else None,
        static=study.path(static) if static else None,
    )


def read_body_files(
    study: Study, person: SubjectFile
) -> tuple[Recording | None, dict[str, SegmentOverride] | None]:
    """Read a subject's recording for functional hips, if the settings use one, and segments.

    Errors are those of `read_study_file` and `read_segments`.
    """
    hip_trial = person.hip_trial if study.file.settings.hip == "functional" else None
    return (
        read_study_file(study, hip_trial) if hip_trial else None,
        read_segments(study.path(person.segments)) if person.segments else None,
    )


def read_study_laboratory(study: Study) -> Laboratory:
    """Read a study's treadmill and plates with their calibrations, as far as they are stated.

    Raises
    ------
    ValueError, OSError
        If a calibration cannot be read or fitted, or was fitted to otherwise corrected plates.
    """
    treadmill, stated = study.file.treadmill, study.stated
    file = study.file.plates.calibration
    plates = read_plate_correction(study.path(file)) if file else None
    calibration: Calibration | None = None
    if treadmill.calibration:
        beside = tuple(map(study.path, treadmill.beside))
        path = study.path(treadmill.calibration)
        calibration = read_calibration(path, treadmill, stated, plates, beside)
    laboratory = Laboratory(treadmill, calibration, plates=plates)
    if treadmill.belt is not None:
        belts, notes = read_belts(study.path(treadmill.belt.calibration), laboratory, stated)
        laboratory = replace(laboratory, belts=belts, notes=notes)
    if not treadmill.check or calibration is None:
        return laboratory
    found = read_check(study.path(treadmill.check), laboratory, stated)
    return replace(laboratory, notes=(*laboratory.notes, *found.notes))


def with_unused_renames(recording: Recording, *others: Recording | None) -> Recording:
    """Give a trial with a fact about labels to rename that no file about it has.

    Others are its calibration pose and further files; None where there is none.
    """
    every = [recording, *(other for other in others if other is not None)]
    facts = unused_renames(each.labels_absent for each in every)
    notes = (*recording.notes, *(fact.note for fact in facts))
    return replace(recording, facts=(*recording.facts, *facts), notes=notes)


def unused_renames(labels_absent: Iterable[Iterable[str]]) -> tuple[Fact, ...]:
    """Say which labels to rename none of some files has, from those that each does not have."""
    absent = [*map(set, labels_absent)]
    if not absent or not (labels := ", ".join(sorted(set.intersection(*absent)))):
        return ()
    return (Fact("rename_without_label", "rename", f"no marker {labels} in any file"),)


@contextmanager
def saying_what_was_read(recording: Recording, *others: Recording | None) -> Iterator[None]:
    """Add to an error what was found on reading a trial and the other files about it.

    These are facts, impossible samples, and labels to rename that no file has; the error may follow
    from them.
    """

    def said() -> Iterator[Fact]:
        for file in (file for file in (recording, *others) if file is not None):
            yield from file.facts
            yield from reversed_plates(file).values()

    with saying(said()):  # looked for only where there is an error
        yield
