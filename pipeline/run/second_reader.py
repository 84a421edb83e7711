"""The recordings of a study read a second time by an independent reader."""

from pathlib import Path

from hbm.notes import Note
from pipeline.config.study import Study
from pipeline.io.c3d.second_reader.agreement import compare_readers
from pipeline.io.c3d.second_reader.process import installed
from pipeline.io.c3d.second_reader.reading import Refusal
from pipeline.io.c3d.second_reader.second_reading import LIBRARIES
from pipeline.io.read import file_format
from pipeline.run.check import Fault, Findings, Remark

PLACE = "second reader"
"""Of what is said of all files together."""


def study_recordings(study: Study) -> tuple[Path, ...]:
    """Give every recording that a study uses: trials, poses, hip trials, calibrations."""
    treadmill = study.file.treadmill
    names: list[str | None] = [*treadmill.files.values()]
    for person in study.subjects.values():
        names += [person.static, person.hip_trial]
        for trial in person.trials.values():
            names += trial.files if trial.exclude is None else ()
    return tuple(dict.fromkeys(study.path(name) for name in names if name))


def read_twice(path: Path) -> Findings:
    """Compare our reading of a file with that of an independent reader.

    Parameters
    ----------
    path
        A recording of any format.

    Returns
    -------
    Findings
        Every disagreement as a fault; as a remark which reader it was and why not another, or that
        none could read the file or the file is no C3D file.
    """
    place = path.name
    try:
        if not _is_c3d(path):
            return Findings((), (Remark(place, Note.of("second_reader_not_for_format")),))
        agreement = compare_readers(path)
    except (ValueError, OSError) as error:
        return Findings((Fault(place, str(error)),), ())
    notes = [_refusal_note(refusal) for refusal in agreement.refusals if refusal.installed]
    if agreement.reader is None:
        notes.append(Note.of("second_reader_none"))
    elif not agreement.disagreements:
        notes.append(Note.of("second_reader_agrees", reader=agreement.reader))
    return Findings(
        tuple(Fault(place, line) for line in agreement.lines()),
        tuple(Remark(place, note) for note in notes),
    )


def summarise(found: list[Findings]) -> Findings:
    """Say of all files together how many were read twice, and which reader is not installed."""
    notes = [remark.note for findings in found for remark in findings.remarks]
    agree = sum(note.code == "second_reader_agrees" for note in notes)
    remarks = [Note.of("second_reader_total", files=len(found), agree=agree)]
    first, instead = LIBRARIES
    if not installed(first):
        remarks.append(Note.of("second_reader_not_installed", reader=first, instead=instead))
    return Findings((), tuple(Remark(PLACE, note) for note in remarks))


def _refusal_note(refusal: Refusal) -> Note:
    return Note.of("second_reader_refuses", reader=refusal.reader, reason=refusal.reason)


def _is_c3d(path: Path) -> bool:
    try:
        return file_format(path) == "C3D"
    except ValueError:
        return False
