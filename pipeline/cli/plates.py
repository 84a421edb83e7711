"""Experiment 1 on the command line."""

import math
from pathlib import Path

from rich.console import Console

from pipeline.config.plate_study import read_plates_study
from pipeline.plate_accuracy.accuracy import check_plates
from pipeline.plate_accuracy.report import write_report
from pipeline.plate_accuracy.verdict import said


def run(folder: Path, out: Path, *, simulate: bool = False, seed: int = 0) -> None:
    """Check plates against known weights; write tables, figures and the verdict.

    Parameters
    ----------
    folder
        With ``plates.toml`` and its recordings.
    out
        Folder to write to.
    simulate
        True to fill the folder from the virtual laboratory first: the 144 recordings of van de
        Loosdrecht (2018), with supports and without, of plates as wrong as that work found its own.
    seed
        Of the simulation.

    Raises
    ------
    StudyFaults, ValueError, OSError
        If the file or a recording is at fault, or the folder to simulate into is not empty.
    """
    console = Console(highlight=False, markup=False)
    if simulate:
        console.print("simulating recordings of known weights", style="dim")
        _simulate(folder, seed)
    study = read_plates_study(folder)
    console.print(f"reading {len(study.file.weights)} recordings of known weights", style="dim")
    found = check_plates(study)
    sentence = write_report(found, out)
    for one in found.estimates:
        if one.found:
            console.print(f"- {said(one)}", soft_wrap=True)
    console.print(sentence, soft_wrap=True)
    console.print(f"written to {out}: verdict.md, table_1, figures", soft_wrap=True)


def _simulate(folder: Path, seed: int) -> None:
    from pipeline.virtual_lab.protocol.known_weights import PlateErrors, simulate_plates

    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty; simulate into a new folder")
    found_there = PlateErrors(
        angle_rad=math.radians(0.19),
        offset_m=(0.0015, -0.0018),
        delay_s=0.004,
        vibration_m=0.015,
        vibration_hz=3.0,
    )
    simulate_plates(folder, found_there, seed=seed)
