"""A study to start from: commented TOML files."""

from importlib.resources import files
from pathlib import Path

from pipeline.io.write import whole_file


def write_template(folder: Path) -> tuple[Path, Path]:
    """Write a commented ``study.toml`` and a subject's file.

    Parameters
    ----------
    folder
        Where; made if it does not exist.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    ValueError
        If there already is a study; nothing is overwritten.
    OSError
        If the folder cannot be written to; neither file is there then.
    """
    study, subject = folder / "study.toml", folder / "sub01.toml"
    for path in (study, subject):
        if path.exists():
            raise ValueError(f"{path} is already there; nothing was written")
    with whole_file(study) as new_study, whole_file(subject) as new_subject:
        new_study.write_text(template_text("study_template.toml"), encoding="utf-8")
        new_subject.write_text(template_text("subject_template.toml"), encoding="utf-8")
    return study, subject


def template_text(name: str) -> str:
    """Give the text of a template of this package."""
    return files("pipeline.config").joinpath(name).read_text(encoding="utf-8")
