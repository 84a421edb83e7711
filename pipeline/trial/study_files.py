"""Files of a study, read as the study states it; labels to rename that no file has."""

from collections.abc import Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from hbm.segments import SegmentOverride
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.schema import SubjectFile, Trial
from pipeline.config.study import Study
from pipeline.config.toml_file import read_segments, require_file
from pipeline.io.input_file import file_digest
from pipeline.io.read import read_recording
from pipeline.io.recording import Fact, Recording, saying
from pipeline.trial.ground.belts import fit_belts
from pipeline.trial.ground.calibrations import (
    belts_alone,
    check_recording,
    read_calibration,
    read_empty,
)
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
    for file in filter(None, (name, trial.forces, trial.record)):
        require_file(study.folder, file)
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


_laboratories: dict[Hashable, Laboratory] = {}


def read_study_laboratory(study: Study) -> Laboratory:
    """Read a study's treadmill and plates with their calibrations, as far as they are stated.

    What is fitted is fitted once in a process, however often it is asked for, until a file changes.

    Raises
    ------
    ValueError, OSError
        If a calibration cannot be read or fitted, or was fitted to otherwise corrected plates.
    """
    treadmill, options = study.file.treadmill, study.options
    plates_file = study.file.plates.calibration
    files = [study.path(name) for name in (*treadmill.files, plates_file) if name]
    contents = tuple((file.name, file_digest(file)) for file in files)
    key = treadmill.model_dump_json(), plates_file, options, contents
    if key in _laboratories:
        return _laboratories[key]
    plates = read_plate_correction(study.path(plates_file)) if plates_file else None
    laboratory = Laboratory(treadmill, plates=plates)

    def read(name: str) -> Recording:
        return read_empty(study.path(name), options, any_forward=plates is None)

    if treadmill.calibration:
        path, beside = study.path(treadmill.calibration), map(study.path, treadmill.beside)
        calibration = read_calibration(path, treadmill, options, plates, tuple(beside))
        laboratory = replace(laboratory, calibration=calibration)
    # belts shake the platform: what accelerometers explain is subtracted first
    if (belt := treadmill.belt) is not None:
        alone, notes = belts_alone(read(belt.calibration), laboratory)
        laboratory = replace(laboratory, belts=fit_belts(alone, belt), notes=notes)
    if treadmill.check:
        notes = check_recording(read(treadmill.check), laboratory).notes
        laboratory = replace(laboratory, notes=(*laboratory.notes, *notes))
    return _laboratories.setdefault(key, laboratory)


def with_unused_renames(recording: Recording, *others: Recording | None) -> Recording:
    """Give a trial with a fact about labels to rename that no file about it has.

    Others are its calibration pose and further files; None where there is none.
    """
    files = [file for file in (recording, *others) if file is not None]
    facts = unused_renames(file.labels_absent for file in files)
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
