"""The folder of a simulated study: its files, what is missing, and what it was simulated with."""

from pathlib import Path

from pipeline.config.toml_file import SIMULATED, read_table
from pipeline.virtual_lab.person.subject import Person
from pipeline.virtual_lab.protocol.people_beside import beside_names
from pipeline.virtual_lab.protocol.setting_file import read_setting, setting_toml
from pipeline.virtual_lab.protocol.study_text import CALIBRATION, study_texts
from pipeline.virtual_lab.protocol.walking_protocol import (
    PERSONS,
    ConditionName,
    Setting,
    recording_name,
)


def study_files(setting: Setting) -> tuple[str, ...]:
    """Name all files of a simulated study, relative to its folder."""
    protocol = setting.protocol
    return (
        *study_texts(setting),
        CALIBRATION,
        *beside_names(setting),
        *(
            name
            for person in PERSONS[: protocol.subjects]
            for condition in protocol.conditions
            for name in trial_names(person, condition)
        ),
    )


def trial_names(person: Person, condition: ConditionName) -> tuple[str, str, str]:
    """Name the files of one trial: the recording, what really happened, and its gait events."""
    recording = recording_name(person, condition)
    truth = Path(SIMULATED).with_name(recording).with_suffix(".parquet")
    return recording, truth.as_posix(), truth.with_name(f"{truth.stem}_events.csv").as_posix()


def missing_files(folder: Path, setting: Setting) -> tuple[str, ...]:
    """Name the files of a simulated study that are not in a folder."""
    return tuple(name for name in study_files(setting) if not (folder / name).is_file())


def folder_setting(folder: Path) -> Setting | None:
    """Give the setting that the study in a folder was simulated with.

    Parameters
    ----------
    folder
        The folder, in which recordings may be missing.

    Returns
    -------
    Setting or None
        None for a folder that is empty or not there.

    Raises
    ------
    ValueError
        If the folder holds other files, a study that was not simulated, or other subjects than
        those that would be simulated.
    """
    if not folder.is_dir() or not any(folder.iterdir()):
        return None
    if not (folder / SIMULATED).is_file():
        if (folder / "study.toml").is_file():
            raise ValueError(
                f"{folder}: its study is not a simulated one (it has no {SIMULATED}), and "
                "simulated recordings would not be of its subjects; name a new folder"
            )
        raise ValueError(f"{folder}: is not empty; name a new folder, nothing is overwritten")
    try:
        setting = read_setting((folder / SIMULATED).read_text(encoding="utf-8-sig"))
    except ValueError as error:
        raise ValueError(f"{folder / SIMULATED}: {error}") from error
    for person in PERSONS[: setting.protocol.subjects]:
        _require_person(folder / f"{person.name}.toml", person)
    return setting


def require_setting(folder: Path, there: Setting, wanted: Setting) -> None:
    """Refuse another setting than that of the recordings which may be in a folder already."""
    lines = zip(setting_toml(there).splitlines(), setting_toml(wanted).splitlines(), strict=True)
    different = [f"{old} (not {new})" for old, new in lines if old != new]
    if different:
        raise ValueError(
            f"{folder}: its study is simulated with {', '.join(different)}; leave out --setting, "
            "--subjects and --seed, or name a new folder"
        )


def _require_person(path: Path, person: Person) -> None:
    """Refuse a subject's file, where there is one, that describes another person."""
    if not path.is_file():
        return
    stated = read_table(path)
    for key, value in (("id", person.name), ("sex", person.sex), ("height_m", person.height_m)):
        if stated.get(key, value) not in (value, "unspecified"):
            raise ValueError(
                f"{path}: {key} is {stated[key]!r}, that of the simulated subject is {value!r}; "
                "correct the file or delete it, or name a new folder"
            )
