"""A study as people state it: one TOML file for the study and one per subject.

``study.toml`` names the laboratory, the settings and the conditions; every other TOML file in the
folder is a subject. File names in them are relative to the folder.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hbm.coordinates import SEGMENTS
from hbm.markers import MarkerSet, marker_sets, read_marker_set
from hbm.spelling import Table, did_you_mean, shown
from pipeline.config.comparison import comparison_faults
from pipeline.config.consistency import (
    body_faults,
    plate_faults,
    result_name_faults,
    treadmill_faults,
    trial_faults,
)
from pipeline.config.schema import Condition, StudyFile, SubjectFile
from pipeline.config.simulated import SIMULATED
from pipeline.config.toml_file import check_table, read_table
from pipeline.config.validation import StudyFaults
from pipeline.io.input_file import is_file, read_text
from pipeline.io.stated import Stated


@dataclass(frozen=True, slots=True)
class Study:
    """A whole study, checked.

    Attributes
    ----------
    folder
        Where its files are.
    file
        The contents of ``study.toml``.
    subjects
        Subject id -> contents of the subject's file, in order of the file names.
    marker_set
        The study's own marker set; None for a shipped one.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.config.schema import StudyFile
    >>> walking = StudyFile.model_validate({"conditions": {"walking": {"cycles": 20}}})
    >>> study = pipeline.Study(Path("subjects"), walking, subjects={}, marker_set=None)
    >>> study.condition("walking").cycles
    20
    """

    folder: Path
    file: StudyFile
    subjects: Mapping[str, SubjectFile]
    marker_set: MarkerSet | None

    @property
    def stated(self) -> Stated:
        """How its recordings are to be read, with the marker set that they are of."""
        shipped = marker_sets().get(self.file.settings.marker_set or "")
        return self.file.stated(self.marker_set or shipped)

    def path(self, name: str) -> Path:
        """Give the path of a file of the study."""
        return self.folder / name

    def subject(self, subject: str) -> SubjectFile:
        """Give a subject; a ValueError names those that exist."""
        if subject not in self.subjects:
            hint = did_you_mean(subject, self.subjects)
            raise ValueError(f"no subject {subject!r}{hint}; there are {', '.join(self.subjects)}")
        return self.subjects[subject]

    def condition(self, condition: str) -> Condition:
        """Give a condition; a ValueError names those that exist."""
        known = self.file.conditions
        if condition not in known:
            hint = did_you_mean(condition, known)
            raise ValueError(f"no condition {condition!r}{hint}; there are {', '.join(known)}")
        return known[condition]


def read_study(folder: str | Path, *, recordings: bool = True) -> Study:
    """Read a study's TOML files.

    Parameters
    ----------
    folder
        Folder with ``study.toml`` and one TOML file per subject, or ``study.toml`` itself.
    recordings
        Whether a file of a subject or trial that is not there is a fault; without, only the trials
        that need it cannot be processed.

    Returns
    -------
    Study
        Everything that the files state, checked.

    Raises
    ------
    StudyFaults
        If anything is wrong: all faults of all files, one line each with file, key, value, what is
        allowed and, for a misspelt word, the nearest known one.

    Examples
    --------
    >>> import pipeline, tempfile
    >>> from pipeline.config.templates import write_template
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = write_template(Path(folder))
    ...     for recording in ("sub01_baseline.c3d", "sub01_sway.c3d"):
    ...         Path(folder, recording).touch()
    ...     study = pipeline.read_study(folder)
    >>> study.subjects["sub01"].height_m, study.condition("sway").perturbed
    (1.7, True)
    """
    folder = Path(folder)
    if folder.name == "study.toml":
        folder = folder.parent
    if folder.is_file():
        raise StudyFaults([f"{folder}: is a file; a study is a folder with study.toml in it"])
    if not (folder / "study.toml").is_file():
        raise StudyFaults([f"{folder}: no study.toml here; write one with 'hbm init {folder}'"])
    faults: list[str] = []
    file, conditions = _study_file(folder / "study.toml", faults)
    subjects = _subjects(folder, file, conditions, faults, recordings)
    marker_set = None
    if file is not None:
        marker_set = _own_marker_set(folder, file, faults)
        faults += treadmill_faults(folder, file)
        faults += plate_faults(folder, file)
        faults += comparison_faults(file, subjects)
    if faults and (folder / SIMULATED).is_file() and not any(folder.glob("*.c3d")):
        raise StudyFaults([f"{folder}: no recordings yet; 'hbm simulate {folder}' writes them"])
    if faults or file is None:
        raise StudyFaults(faults)
    return Study(folder, file, subjects, marker_set)


def _study_file(path: Path, faults: list[str]) -> tuple[StudyFile | None, list[str] | None]:
    """Read ``study.toml`` and, even if it is at fault elsewhere, the names of its conditions."""
    conditions = None
    try:
        table = read_table(path)
        stated = table.get("conditions")
        conditions = list(stated) if isinstance(stated, dict) else None
        return check_table(path.name, table, StudyFile), conditions
    except StudyFaults as error:
        faults += error.faults
        return None, conditions


def _subjects(
    folder: Path,
    file: StudyFile | None,
    conditions: list[str] | None,
    faults: list[str],
    recordings: bool,
) -> dict[str, SubjectFile]:
    subjects: dict[str, SubjectFile] = {}
    before = len(faults)
    for path in _subject_paths(folder):
        try:
            table = read_table(path)
            if _is_not_a_subject(table):
                continue
            faults += trial_faults(folder, path.name, table, conditions, recordings=recordings)
            subject = check_table(path.name, table, SubjectFile)
        except StudyFaults as error:
            faults += error.faults
            continue
        faults += body_faults(folder, path.name, subject, file)
        if subject.id in subjects:
            faults.append(f"{path.name}: id: {subject.id!r} is already taken by another file")
        subjects[subject.id] = subject
    if len(faults) == before:
        if not subjects:
            faults.append(f"{folder}: no subject files (one TOML per subject, next to study.toml)")
        elif not any(person.trials for person in subjects.values()):
            faults.append(f"{folder}: no subject has a trial; state them as [trials.CONDITION]")
    faults += result_name_faults(subjects)
    return subjects


def _subject_paths(folder: Path) -> list[Path]:
    paths = sorted(folder.glob("*.toml"))
    return [path for path in paths if path.name != "study.toml" and path.name[0] != "."]


def _is_not_a_subject(table: Table) -> bool:
    """Recognise a marker set or a table of segments, old or new, among the subjects' files."""
    words = ("markers", "trunk", *SEGMENTS)
    return "trials" not in table and not table.keys().isdisjoint(words)


def _own_marker_set(folder: Path, file: StudyFile, faults: list[str]) -> MarkerSet | None:
    name = file.settings.marker_set
    if name is None or name in marker_sets():
        return None
    path = folder / name
    if not is_file(path):
        known = ", ".join(marker_sets())
        faults.append(
            f"study.toml: settings.marker_set: {shown(name)} is neither a file here nor one of "
            f"{known}"
        )
        return None
    try:
        return read_marker_set(read_text(path), path.stem)
    except ValueError as error:
        faults.append(f"{path.name}: {error}")
        return None
