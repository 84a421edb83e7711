"""A study as people state it: one TOML file for the study and one per subject.

``study.toml`` names the laboratory, the settings and the conditions; every other TOML file in the
folder is a subject. File names in them are relative to the folder.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from hbm.coordinates import SEGMENTS
from hbm.markers import MarkerSet, marker_sets, read_marker_set
from hbm.spelling import Table, did_you_mean, shown
from pipeline.config.comparison import comparison_faults
from pipeline.config.input_model import InputModel
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.schema import (
    MAIN,
    Condition,
    Plates,
    Settings,
    StudyFile,
    SubjectFile,
    Treadmill,
    Trial,
    TrialName,
)
from pipeline.config.toml_file import SIMULATED, Around, StudyFaults, check_table, read_table
from pipeline.io.input_file import is_file, read_text
from pipeline.io.read_options import ReadOptions
from pipeline.io.shown import Overview, Shown


@dataclass(frozen=True, slots=True, repr=False)
class Study(Shown):
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
    variants
        Name -> the same study with the settings of a variant.

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
    variants: Mapping[str, "Study"] = field(default_factory=dict)

    def overview(self) -> Overview:
        """Give name and folder; number of recordings by subject and condition."""
        used = Counter(name[:2] for name, trial in self.trials.items() if trial.exclude is None)
        rows = {who: [used[who, what] for what in self.file.conditions] for who in self.subjects}
        excluded = len(self.trials) - used.total()
        title = f"{self.file.name}: {used.total()} recordings, {excluded} excluded"
        return Overview(title, [*self.file.conditions], rows)

    @property
    def options(self) -> ReadOptions:
        """How its recordings are to be read, with the marker set that they are of."""
        shipped = marker_sets().get(self.file.settings.marker_set or "")
        return self.file.options(self.marker_set or shipped)

    def path(self, name: str) -> Path:
        """Give the path of a file of the study."""
        return self.folder / name

    def subject(self, subject: str) -> SubjectFile:
        """Give a subject; a ValueError names those that exist."""
        return _known("subject", subject, self.subjects)

    def condition(self, condition: str) -> Condition:
        """Give a condition; a ValueError names those that exist."""
        return _known("condition", condition, self.file.conditions)

    @property
    def trials(self) -> dict[TrialName, Trial]:
        """All trials by name, excluded ones too."""
        return {
            name: trial
            for person in self.subjects.values()
            for name, trial in person.named_trials.items()
        }

    def __contains__(self, name: TrialName) -> bool:
        """Say whether it has such a trial, excluded ones too."""
        return name.subject in self.subjects and name in self.subjects[name.subject].named_trials

    def alone(self, subject: str) -> "Study":
        """Give the study of one subject, without variants: all that a worker needs."""
        return replace(self, subjects={subject: self.subject(subject)}, variants={})

    @property
    def files(self) -> tuple[str, ...]:
        """Names of all files that it uses besides its own TOML files; of excluded trials none."""
        names = [self.file.plates.calibration, *self.file.treadmill.files]
        names += [name for person in self.subjects.values() for name in person.files]
        used = [trial for trial in self.trials.values() if trial.exclude is None]
        names += [name for trial in used for name in trial.files]
        return tuple(dict.fromkeys(filter(None, names)))

    def to_process(
        self, subjects: Iterable[str] = (), conditions: Iterable[str] = ()
    ) -> list[TrialName]:
        """Give the trials of some subjects and conditions, by default all; StudyFaults if none."""
        subjects, conditions = (
            [names] if isinstance(names, str) else names for names in (subjects, conditions)
        )
        chosen = {self.subject(name).id for name in subjects} or self.subjects
        of = [*conditions] or self.file.conditions
        for condition in of:
            self.condition(condition)
        names = [name for name, trial in self.trials.items() if trial.exclude is None]
        names = [name for name in names if name.subject in chosen and name.condition in of]
        if not names:
            none = "all trials of these subjects and conditions are excluded, or there are none"
            raise StudyFaults([f"{self.folder}: nothing to process: {none}"], self.folder)
        return names

    def stated_of(self, trial: Trial) -> ReadOptions:
        """How the recording of a trial is to be read: as all, and what is stated of it alone."""
        common = self.options
        return replace(
            common,
            mend_plates=(*common.mend_plates, *trial.mend_plates),
            rename={**common.rename, **trial.rename},
        )

    def trial(self, name: TrialName) -> Trial:
        """Give a trial; a ValueError names those that the subject has."""
        return _known("trial", name, self.subject(name.subject).named_trials)

    def rule(self, name: TrialName) -> Condition:
        """Give what counts in a trial: as its condition says or, instead, its own window."""
        return Condition.model_validate(self.stated_rule(name))

    def stated_rule(self, name: TrialName) -> Table:
        """Give that rule as it is stated, before it is checked."""
        condition, window = self.condition(name.condition), self.trial(name).window
        rule = dict(condition)
        if window is not None:
            rule |= {} if condition.perturbed else {"cycles": None, "skip_s": 0.0}
            rule["window"] = window
        return rule


Key = TypeVar("Key", str, TrialName)
Stating = TypeVar("Stating")


def _known(kind: str, name: Key, by_name: Mapping[Key, Stating]) -> Stating:
    if name not in by_name:
        texts = [str(value) for value in by_name]
        hint = did_you_mean(str(name), texts)
        raise ValueError(f"no {kind} {str(name)!r}{hint}; there are {', '.join(texts)}")
    return by_name[name]


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
    _require_study(folder)
    faults: list[str] = []
    file = conditions = None
    table = _table(folder / "study.toml", faults)
    if table is not None:
        named = table.get("conditions")
        conditions = [*named] if isinstance(named, dict) else None
        file = check_table("study.toml", table, StudyFile, faults, Around(folder))
    ways = {} if file is None else {MAIN: file, **_variants(folder, file, faults)}
    hips = {way.settings.hip for way in ways.values()}
    subjects = _subjects(Around(folder, recordings, conditions, hips), faults)
    sets = {name: _own_marker_set(folder, way, faults) for name, way in ways.items()}
    for way in ways.values():
        faults += _laboratory_faults(folder, way)
    if file is not None:
        faults += _alike({f"study.toml: condition {name}": name for name in file.conditions})
        faults += _alike({f"study.toml: variant {name}": name for name in file.variants})
        faults += comparison_faults(file, subjects)
    if faults and (folder / SIMULATED).is_file() and not any(folder.glob("*.c3d")):
        raise StudyFaults([f"{folder}: no recordings yet; 'hbm simulate {folder}' writes them"])
    if faults or file is None:
        raise StudyFaults([*dict.fromkeys(faults)], folder)
    study = Study(folder, file, subjects, sets.pop(MAIN))
    for name in study.trials:
        check_table(f"{name}: window", study.stated_rule(name), Condition, faults, Around(folder))
    if faults:
        raise StudyFaults(faults, folder)
    variants = {v: replace(study, file=ways[v], marker_set=of_v) for v, of_v in sets.items()}
    return replace(study, variants=variants)


def read_laboratory(folder: Path) -> StudyFile:
    """Read a ``study.toml`` alone, whichever of its files are there; StudyFaults if it is wrong."""
    _require_study(folder)
    faults: list[str] = []
    table = read_table(folder / "study.toml")
    file = check_table("study.toml", table, StudyFile, faults, Around(folder))
    if file is None:
        raise StudyFaults(faults, folder)
    return file


def _require_study(folder: Path) -> None:
    if folder.is_file():
        raise StudyFaults([f"{folder}: is a file; a study is a folder with study.toml in it"])
    if not (folder / "study.toml").is_file() and (folder / "trials").is_dir():
        raise StudyFaults([f"{folder}: has results, no study; 'hbm report {folder}' shows them"])
    if not (folder / "study.toml").is_file():
        raise StudyFaults([f"{folder}: no study.toml here; write one with 'hbm init {folder}'"])


def _variants(folder: Path, file: StudyFile, faults: list[str]) -> dict[str, StudyFile]:
    """Give what the study states with the settings of each variant."""
    kinds: dict[str, type[InputModel]]
    kinds = {"settings": Settings, "plates": Plates, "treadmill": Treadmill}
    variants = {}
    for name, changes in file.variants.items():
        where, before = f"study.toml: variants.{name}", len(faults)
        tables = {key: changes[key] for key in kinds if isinstance(changes.get(key), dict)}
        others = {key: value for key, value in changes.items() if key not in tables}
        tables["settings"] = tables.get("settings", {}) | others
        if name.casefold() in (MAIN, "measured", "compensated"):
            faults.append(f"{where}: {name!r} is what a variant differs from; choose another name")
        if not changes:
            faults.append(f"{where}: has no setting that differs")
        models = {}
        for key, values in tables.items():
            table = getattr(file, key).model_dump() | values
            models[key] = check_table(where, table, kinds[key], faults, Around(folder))
        if len(faults) == before:
            variants[name] = file.model_copy(update={**models, "variants": {}})
    return variants


def _table(path: Path, faults: list[str]) -> Table | None:
    """Read a TOML file; None where that is not possible, with the reason among the faults."""
    try:
        return read_table(path)
    except StudyFaults as error:
        faults += error.faults
        return None


def _subjects(around: Around, faults: list[str]) -> dict[str, SubjectFile]:
    subjects: dict[str, SubjectFile] = {}
    folder, before = around.folder, len(faults)
    for path in sorted(folder.glob("*.toml")):
        if path.name == "study.toml" or path.name.startswith("."):
            continue
        table = _table(path, faults)
        # tables of marker sets and of segments stand among the subjects' files
        others = {"markers", "trunk", *SEGMENTS}
        if table is None or ("trials" not in table and not table.keys().isdisjoint(others)):
            continue
        subject = check_table(path.name, table, SubjectFile, faults, around)
        if subject is None:
            continue
        if subject.id in subjects:
            faults.append(f"{path.name}: id: {subject.id!r} is already taken by another file")
        subjects[subject.id] = subject
    if len(faults) == before:
        if not subjects:
            faults.append(f"{folder}: no subject files (one TOML per subject, next to study.toml)")
        elif not any(person.trials for person in subjects.values()):
            faults.append(f"{folder}: no subject has a trial; write them as [trials.CONDITION]")
    faults += _alike({f"subject {subject}": subject for subject in subjects})
    names = [name for person in subjects.values() for name in person.named_trials]
    faults += _alike({f"trial {name}": name.stem for name in names})
    return subjects


def _alike(files: Mapping[str, str]) -> Iterator[str]:
    """Find things whose files of results have one name, on some systems but for the case."""
    taken: dict[str, str] = {}
    for thing, file in files.items():
        if (other := taken.setdefault(file.casefold(), thing)) != thing:
            yield (
                f"{thing}: files of results cannot be told from those of {other} where upper and "
                "lower case are one; rename it"
            )


def _own_marker_set(folder: Path, file: StudyFile, faults: list[str]) -> MarkerSet | None:
    name = file.settings.marker_set
    if name is None or name in marker_sets():
        return None
    path = folder / name
    if not is_file(path):
        names = ", ".join(marker_sets())
        faults.append(
            f"study.toml: settings.marker_set: {shown(name)} is neither a file here nor one of "
            f"{names}"
        )
        return None
    try:
        return read_marker_set(read_text(path), path.stem)
    except ValueError as error:
        faults.append(f"{path.name}: {error}")
        return None


def _laboratory_faults(folder: Path, file: StudyFile) -> list[str]:
    """Check treadmill and plates of ``study.toml`` against the conditions and the settings."""
    platform, faults = file.treadmill.platform, []
    if platform is not None:
        where = "study.toml: treadmill.platform"
        markers = set(platform.markers)
        if markers and platform.channels:
            faults.append(f"{where}: give either markers or channels, not both")
        elif not markers and not platform.channels:
            faults.append(f"{where}: give its markers, or its sway_channel or pitch_channel")
        elif markers and len(markers) < 3:  # fewer do not determine the pose of a rigid body
            faults.append(
                f"{where}.markers: at least 3 different markers are needed, "
                f"got {', '.join(platform.markers)}"
            )
    for name, condition in file.conditions.items():
        if condition.perturbed and condition.pulse_channel is None and platform is None:
            faults.append(
                f"study.toml: conditions.{name}: perturbed needs a pulse_channel, or "
                "treadmill.platform, from whose motion the perturbations are detected"
            )
    plates = file.plates.calibration
    if plates is not None and is_file(folder / plates):
        try:
            read_plate_correction(folder / plates).require_delay(file.settings.plate_delay_s)
        except (ValueError, OSError) as error:
            faults.append(f"study.toml: plates.calibration: {error}")
    return faults
