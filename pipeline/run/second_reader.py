"""The recordings of a study read a second time by an independent reader."""

from pathlib import Path

from hbm.notes import Note
from pipeline.config.study import Study
from pipeline.io.c3d.second_reader import compare_readers
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
    """Compare our reading of a recording with ezc3d's: each disagreement is a fault.

    A remark says that the readings agree, why ezc3d does not read the file, or that it is no C3D.
    """
    place = path.name
    try:
        if file_format(path) != "C3D":
            return Findings((), (Remark(place, Note.of("second_reader_not_for_format")),))
        second = compare_readers(path)
    except (ValueError, OSError) as error:
        return Findings((Fault(place, str(error)),), ())
    if second.disagreements:
        return Findings(tuple(Fault(place, line) for line in second.disagreements), ())
    if second.refusal:
        note = Note.of("second_reader_refuses", reader=second.reader, reason=second.refusal)
    else:
        note = Note.of("second_reader_agrees", reader=second.reader)
    return Findings((), (Remark(place, note),))


def summarise(found: list[Findings]) -> Findings:
    """Say of all files together in how many both readers read the same."""
    notes = [remark.note for findings in found for remark in findings.remarks]
    agree = sum(note.code == "second_reader_agrees" for note in notes)
    note = Note.of("second_reader_total", files=len(found), agree=agree)
    return Findings((), (Remark(PLACE, note),))
