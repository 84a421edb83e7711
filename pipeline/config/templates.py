"""A study to start from: commented TOML files."""

from importlib.resources import files
from pathlib import Path


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
    """
    study, subject = folder / "study.toml", folder / "sub01.toml"
    for path in (study, subject):
        if path.exists():
            raise ValueError(f"{path} is already there; nothing was written")
    folder.mkdir(parents=True, exist_ok=True)
    for path, template in ((study, "study_template.toml"), (subject, "subject_template.toml")):
        path.write_text(template_text(template), encoding="utf-8")
    return study, subject


def template_text(name: str) -> str:
    """Give the text of a template of this package."""
    return files("pipeline.config").joinpath(name).read_text(encoding="utf-8")
