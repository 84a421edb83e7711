"""The thesis' Table III in the virtual laboratory: as it is, and with what the thesis documents."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import reduce
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, TypeVar

import numpy as np
import pandas as pd
from pydantic import BaseModel

from pipeline.config.study import read_study
from pipeline.run.run import run_study
from pipeline.run.store import read_summary, read_trial
from pipeline.trial.residuals import AXES, reported, variants
from pipeline.virtual_lab.protocol.people_beside import beside_names
from pipeline.virtual_lab.protocol.setting_file import find_setting
from pipeline.virtual_lab.protocol.walking_protocol import (
    ANALYSED_CONDITIONS,
    SHORT,
    THESIS,
    Setting,
)
from pipeline.virtual_lab.protocol.walking_study import ProgressCallback, simulate_study

AS_IS: Final = "as it is"
DOCUMENTED: Final = "documented"
"""The two laboratories: the given one, and with what the thesis documents."""
ITEMS: Final = {
    "real-time filter": ("protocol.filter",),
    "plates late by 4 and 2 ms": ("faults.plates.delay_s", "faults.plates.right_later_s"),
    "plates turned and shifted": (
        "faults.plates.placement_deg",
        "faults.plates.placement_forward_m",
        "faults.plates.placement_left_m",
    ),
    "pose from channels, 3 frames late": ("protocol.pose", "faults.platform.delay_s"),
    "pose from channels, replayed ± 2 frames": ("protocol.pose", "faults.platform.replay_frames"),
}
"""What the thesis documents, one by one -> the keys of the setting `thesis` that state it."""
LENGTHS_S: Final = (0.1, 0.2, 0.27, 0.3, 0.4, 0.5, 0.7, 0.9)
"""Windows from the onset of a perturbation that are compared: from less than the platform moves to
nearly a gait cycle."""
PERTURBED: Final = "sway"
PRINTED: Final = "printed_table_3.csv"
"""The 36 cells as the thesis prints them: mean and standard deviation of nine subjects."""
Model = TypeVar("Model", bound=BaseModel)
Step = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Residuals of simulated studies that went through the whole processing.

    Attributes
    ----------
    setting
        What was simulated as the laboratory as it is.
    residuals
        laboratory, and the columns of `pipeline.trial.residuals.ResidualRow`: one row per subject.
    windows
        laboratory, subject, compensated, length_s, axis, rms: sway, over the first ``length_s``
        after each onset.
    single
        item, condition, compensated, axis, rms: of shorter studies with one of `ITEMS` each, mean
        over their subjects; item "none" for the laboratory as it is.
    cycle_s
        Mean duration of the perturbed gait cycles [s].
    """

    setting: Setting
    residuals: pd.DataFrame
    windows: pd.DataFrame
    single: pd.DataFrame
    cycle_s: float


def documented(setting: Setting, *items: str) -> Setting:
    """Give a laboratory with what the thesis documents.

    Parameters
    ----------
    setting
        The laboratory.
    items
        Names in `ITEMS`; all by default.

    Returns
    -------
    Setting
        The same with the values of the shipped setting ``thesis``.

    Examples
    --------
    >>> documented(Setting(protocol=THESIS)) == find_setting(Path("thesis"))
    True
    """
    thesis = find_setting(Path("thesis"))
    keys = [key for item in items or ITEMS for key in ITEMS[item]]
    return reduce(lambda own, key: _taken(own, thesis, key), keys, setting)


def _taken(setting: Model, other: Model, key: str) -> Model:
    """Take the value of a dotted key from another model."""
    name, _, rest = key.partition(".")
    value = getattr(other, name)
    if rest:
        value = _taken(getattr(setting, name), value, rest)
    return setting.model_copy(update={name: value})


def reproduce(
    setting: Setting | None = None, progress: ProgressCallback | None = None, jobs: int = 1
) -> Reproduction:
    """Simulate and process the studies that Table III is compared with.

    Parameters
    ----------
    setting
        The laboratory as it is, with seed and protocol; by default nine subjects and the thesis'
        protocol. Studies with a single item have the protocol `SHORT`.
    progress
        Called after every recording and every trial with its name, how many are done, and how many
        there are.
    jobs
        Number of processes.

    Returns
    -------
    Reproduction
        Every trial was simulated, written to a file, and processed as `hbm run` does.

    Raises
    ------
    ValueError
        If the protocol lacks a condition of Table III, or a trial fails.

    Notes
    -----
    One study at a time is in the folder for temporary files: 5 GB for the thesis' protocol.
    """
    setting = setting or Setting(protocol=THESIS)
    lacking = [name for name in ANALYSED_CONDITIONS if name not in setting.protocol.conditions]
    if lacking:
        raise ValueError(f"protocol: conditions lacks {', '.join(lacking)}, which Table III has")
    short = setting.model_copy(update={"protocol": SHORT})
    whole = {AS_IS: setting, DOCUMENTED: documented(setting)}
    single = {"none": short} | {item: documented(short, item) for item in ITEMS}
    total = sum(map(_steps, (*whole.values(), *single.values())))
    done = 0

    def step(name: str) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(name, done, total)

    residuals, windows, durations, means = [], [], [], []
    for laboratory, own in whole.items():
        with TemporaryDirectory(prefix="hbm_") as folder:
            paths = process(own, Path(folder), jobs, step)
            residuals.append(study_residuals(paths).assign(laboratory=laboratory))
            windows.append(after_onsets(paths).assign(laboratory=laboratory))
            durations += perturbed_cycles(paths)
    for item, own in single.items():
        with TemporaryDirectory(prefix="hbm_") as folder:
            paths = process(own, Path(folder), jobs, step)
            means.append(cell_means(study_residuals(paths)).assign(item=item))
    return Reproduction(
        setting,
        pd.concat(residuals, ignore_index=True),
        pd.concat(windows, ignore_index=True),
        pd.concat(means, ignore_index=True),
        cycle_s=float(np.mean(durations)),
    )


def _steps(setting: Setting) -> int:
    """Count the recordings and trials of a study, with its calibration."""
    trials = setting.protocol.subjects * len(setting.protocol.conditions)
    return 1 + len(beside_names(setting)) + 2 * trials


def compared(reproduction: Reproduction) -> pd.DataFrame:
    """Put the cells of Table III beside those of the virtual laboratory.

    Parameters
    ----------
    reproduction
        What `reproduce` gave.

    Returns
    -------
    pandas.DataFrame
        Long: ``laboratory, axis, unit, condition, compensated, window, headline, n, mean, sd``
        over subjects, ``mean_thesis, sd_thesis`` as printed, and ``within``, whether the mean is
        within the thesis' mean ± SD. Where a condition has two windows, both are there.
    """
    keys = ["laboratory", "axis", "unit", "condition", "compensated", "window", "headline"]
    cells = reproduction.residuals.groupby(keys, sort=False)["rms"]
    table = cells.agg(n="count", mean="mean", sd="std").reset_index()
    keys = ["axis", "unit", "condition", "compensated"]
    table = table.merge(printed_cells(), on=keys, suffixes=("", "_thesis"), validate="many_to_one")
    off = (table["mean"] - table["mean_thesis"]).abs()
    return table.assign(within=off <= table["sd_thesis"])


def printed_cells() -> pd.DataFrame:
    """Give the 36 cells as the thesis prints them: axis, unit, condition, compensated, mean, sd."""
    with (files(__package__) / PRINTED).open(encoding="utf-8") as file:
        return pd.read_csv(file)


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
            inside = ((since >= 0) & (since < length_s)).any(axis=1) & trial.validity.counts
            for variant, dynamics in variants(trial).items():
                rms = np.sqrt(np.mean(reported(dynamics.residual[inside]) ** 2, axis=0))
                for axis, value in zip(AXES, rms, strict=True):
                    key = trial.subject.id, variant == "compensated", length_s, axis
                    rows.append((*key, float(value)))
    columns = ["subject", "compensated", "length_s", "axis", "rms"]
    return pd.DataFrame(rows, columns=columns)
