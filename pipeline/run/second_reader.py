"""The recordings of a study read a second time by an independent reader."""

from collections.abc import Callable
from pathlib import Path

from pipeline.config.study import Study
from pipeline.io.c3d.second_reader import compare_readers
from pipeline.io.read import file_format
from pipeline.run.check import Findings

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
    place, found = path.name, Findings()
    try:
        if file_format(path) != "C3D":
            found.remark(place, "second_reader_not_for_format")
            return found
        second = compare_readers(path)
    except (ValueError, OSError) as error:
        found.fault(place, str(error))
        return found
    for line in second.disagreements:
        found.fault(place, line)
    if second.refusal and not found.faults:
        reason = second.refusal
        found.remark(place, "second_reader_refuses", reader=second.reader, reason=reason)
    elif not found.faults:
        found.remark(place, "second_reader_agrees", reader=second.reader)
    return found


def read_study_twice(study: Study, progress: Callable[[str, int, int], None]) -> Findings:
    """Read every recording of a study twice; say in how many files both readings are the same."""
    every, paths = Findings(), study_recordings(study)
    for done, path in enumerate(paths, 1):
        every.add(read_twice(path))
        progress(path.name, done, len(paths))
    agree = sum(remark.note.code == "second_reader_agrees" for remark in every.remarks)
    every.remark(PLACE, "second_reader_total", files=len(paths), agree=agree)
    return every
