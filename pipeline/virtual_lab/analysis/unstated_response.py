"""Simulated studies that show how Table III depends on what the thesis does not state."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.io.write import write_text
from pipeline.virtual_lab.analysis.processed_study import (
    LENGTHS_S,
    Step,
    after_onsets,
    cells_by_subject,
    process,
    process_study,
    study_residuals,
)
from pipeline.virtual_lab.analysis.unstated import (
    DESIGN,
    POSES,
    REFERENCE,
    Pose,
    Response,
    fit_response,
    unstated_at,
)
from pipeline.virtual_lab.protocol.study_text import study_texts
from pipeline.virtual_lab.protocol.walking_protocol import SHORT, Setting

PROTOCOL: Final = SHORT.model_copy(update={"calibration": "square_sway_60s_3mps"})
"""Three subjects' short trials, and a short calibration: what counts are differences."""


def respond(setting: Setting, reference: Array, jobs: int, step: Step) -> dict[Pose, Response]:
    """Simulate a short study for every point of `DESIGN`; process each with and without the pose.

    Parameters
    ----------
    setting
        The laboratory with what is documented; its protocol is replaced by `PROTOCOL`, but for how
        it filters.
    reference
        Cells by subject of this laboratory with its whole protocol, (subjects, windows, 36).
    jobs
        Number of processes.
    step
        Called with the name of every recording and every trial.

    Returns
    -------
    dict
        Pose -> response.
    """
    protocol = PROTOCOL.model_copy(update={"filter": setting.protocol.filter})
    short = setting.model_copy(update={"protocol": protocol})
    logs: dict[Pose, list[Array]] = {pose: [] for pose in POSES}
    for z in DESIGN:
        x = np.append(z, np.log(LENGTHS_S[0]))
        with TemporaryDirectory(prefix="hbm_") as folder:
            for pose in POSES:
                own = unstated_at(x, pose).apply(short)
                paths = process_with(own, Path(folder), pose, jobs, step)
                cells = cells_by_subject(study_residuals(paths), after_onsets(paths))
                logs[pose].append(np.log(cells.mean(axis=0)))
    level = reference.mean(axis=0)
    shift = np.log(level) - logs[POSES[0]][REFERENCE]
    spread = (reference.std(axis=0, ddof=1) / np.sqrt(len(reference)) / level).max(axis=0)
    return {pose: fit_response(np.stack(own), shift, spread) for pose, own in logs.items()}


def response_steps() -> int:
    """Count the recordings and trials of `respond`."""
    trials = PROTOCOL.subjects * len(PROTOCOL.conditions)
    return len(DESIGN) * (1 + (1 + len(POSES)) * trials)


def process_with(setting: Setting, folder: Path, pose: Pose, jobs: int, step: Step) -> list[Path]:
    """Simulate a study for the first of `POSES`, and process its recordings for each."""
    study = folder / "study"
    if pose == POSES[0]:
        return process(setting, folder, jobs, step)
    write_text(study_texts(setting)["study.toml"], study / "study.toml")
    return process_study(study, folder / pose, jobs, step)
