"""Experiment 1 on the command line."""

from pathlib import Path

from rich.console import Console

from pipeline.plates import check_plates
from pipeline.plates_report import said, write_report
from pipeline.plates_study import read_plates_study


def run(folder: Path, out: Path) -> None:
    """Check plates against known weights; write tables, figures and the verdict.

    Parameters
    ----------
    folder
        With ``plates.toml`` and its recordings.
    out
        Folder to write to.

    Raises
    ------
    StudyFaults, ValueError, OSError
        If the file or a recording is at fault.
    """
    console = Console(highlight=False, markup=False)
    study = read_plates_study(folder)
    console.print(f"{len(study.file.weights)} recordings of known weights", style="dim")
    found = check_plates(study)
    sentence = write_report(found, out)
    for one in found.estimates:
        if one.found:
            console.print(f"- {said(one)}", soft_wrap=True)
    console.print(sentence, soft_wrap=True)
    console.print(f"written to {out}: verdict.md, table_1, figures", soft_wrap=True)
