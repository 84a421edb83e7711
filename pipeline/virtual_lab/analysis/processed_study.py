"""Simulated studies through the whole processing, and their residuals as tables."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.config.study import read_study
from pipeline.run.run import run_study
from pipeline.run.store import read_summary, read_trial
from pipeline.trial.residuals import AXES, reported
from pipeline.virtual_lab.protocol.walking_protocol import ANALYSED_CONDITIONS, Setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

LENGTHS_S: Final = (0.1, 0.2, 0.27, 0.3, 0.4, 0.5, 0.7, 0.9)
"""Windows from the onset of a perturbation that are compared: from less than the platform moves to
nearly a gait cycle."""
PERTURBED: Final = "sway"
KEYS: Final = ["condition", "compensated", "axis"]
CELLS: Final = pd.MultiIndex.from_product([ANALYSED_CONDITIONS, (False, True), AXES], names=KEYS)
"""Keys of the 36 cells of Table III, in the order of arrays of cells."""
Step = Callable[[str], None]


def process(setting: Setting, folder: Path, jobs: int, step: Step) -> list[Path]:
    """Simulate a study into a folder, process it as `hbm run` does, and give its results' files."""
    study = folder / "study"
    simulate_study(study, setting, lambda name, *_: step(name), jobs, keep=True)
    return process_study(study, folder / "results", jobs, step)


def process_study(study: Path, results: Path, jobs: int, step: Step) -> list[Path]:
    """Process a study's files as `hbm run` does; give its results' files."""
    for outcome in run_study(read_study(study), results, jobs=jobs):
        if outcome.failure is not None:
            raise ValueError(f"{outcome}: {outcome.failure}")
        step(str(outcome))
    return sorted((results / "trials").glob("*.parquet"))


def study_residuals(paths: list[Path]) -> pd.DataFrame:
    """Give the residual rows of stored trials."""
    return pd.DataFrame(asdict(row) for path in paths for row in read_summary(path).residuals)


def cell_means(residuals: pd.DataFrame) -> pd.DataFrame:
    """Average the headline windows' RMS over subjects."""
    own = residuals[residuals["headline"]]
    return own.groupby(["condition", "compensated", "axis"])["rms"].mean().reset_index()


def perturbed_cycles(paths: list[Path]) -> list[float]:
    """Give the durations of the gait cycles of stored sway trials [s]."""
    trials = [read_summary(path) for path in paths if path.stem.endswith(f"_{PERTURBED}")]
    spans = [span for trial in trials for own in trial.cycles.values() for span in own]
    return [stop - start for start, stop in spans]


def after_onsets(paths: list[Path]) -> pd.DataFrame:
    """Give RMS residuals of stored sway trials over windows that start at the onsets."""
    rows = []
    for path in paths:
        if not path.stem.endswith(f"_{PERTURBED}"):
            continue
        trial = read_trial(path)
        since = trial.motion.time[:, None] - trial.onsets
        for length_s in LENGTHS_S:
            inside = ((since >= 0) & (since < length_s)).any(axis=1) & trial.counts
            for variant, dynamics in trial.variants.items():
                rms = np.sqrt(np.mean(reported(dynamics.residual[inside]) ** 2, axis=0))
                for axis, value in zip(AXES, rms, strict=True):
                    key = trial.subject.id, variant == "compensated", length_s, axis
                    rows.append((*key, float(value)))
    columns = ["subject", "compensated", "length_s", "axis", "rms"]
    return pd.DataFrame(rows, columns=columns)


def cells_by_subject(residuals: pd.DataFrame, after: pd.DataFrame) -> Array:
    """Lay out the cells of Table III with sway over each of `LENGTHS_S`.

    Parameters
    ----------
    residuals, after
        Of one study, as `study_residuals` and `after_onsets` give them.

    Returns
    -------
    Array
        (subjects, windows, 36) [N, N·m], subjects in alphabetical order, cells as in `CELLS`.
    """
    steady = residuals[residuals["headline"] & (residuals["condition"] != PERTURBED)]
    perturbed = after.assign(condition=PERTURBED)
    return np.stack(
        [
            _by_subject(pd.concat([steady, perturbed[perturbed["length_s"] == length_s]]))
            for length_s in LENGTHS_S
        ],
        axis=1,
    )


def headline_cells(residuals: pd.DataFrame) -> Array:
    """Lay out the headline windows' cells of one study, (subjects, 36), as `cells_by_subject`."""
    return _by_subject(residuals[residuals["headline"]])


def _by_subject(rows: pd.DataFrame) -> Array:
    table = rows.pivot(index="subject", columns=KEYS, values="rms").sort_index()
    return np.asarray(table[CELLS].to_numpy(), float)
