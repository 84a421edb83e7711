"""The thesis' Table III in the virtual laboratory.

As it is, with what the thesis documents, and with estimates of what it does not state.
"""

from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, TypeVar

import numpy as np
import pandas as pd
from pydantic import BaseModel

from hbm.spatial import Array
from pipeline.virtual_lab.analysis.empty_plate import beside_a_runner, flexibilities
from pipeline.virtual_lab.analysis.judgement import judge
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells
from pipeline.virtual_lab.analysis.processed_study import (
    Step,
    after_onsets,
    cell_means,
    cells_by_subject,
    headline_cells,
    perturbed_cycles,
    process,
    study_residuals,
)
from pipeline.virtual_lab.analysis.unstated_estimate import Estimate, estimate
from pipeline.virtual_lab.analysis.unstated_response import respond, response_steps
from pipeline.virtual_lab.protocol.people_beside import beside_names
from pipeline.virtual_lab.protocol.setting_file import find_setting
from pipeline.virtual_lab.protocol.walking_protocol import (
    ANALYSED_CONDITIONS,
    SHORT,
    THESIS,
    Setting,
)
from pipeline.virtual_lab.protocol.walking_study import ProgressCallback

AS_IS: Final = "as it is"
DOCUMENTED: Final = "documented"
ESTIMATED: Final = "estimated"
ADDED: Final = "with a constant residual per axis"
LABORATORIES: Final = (AS_IS, DOCUMENTED, ESTIMATED)
"""The given one; with what the thesis documents; and with what it does not state as estimated from
the cells without compensation. `ADDED` is no laboratory but a fit with a constant residual per
axis."""
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
MIN_SUBJECTS: Final = 2
Model = TypeVar("Model", bound=BaseModel)


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
    unstated
        The estimates of what the thesis does not state.
    unstated_adding
        The same with a constant residual per axis.
    judged
        Cells with compensation of the documented and the estimated laboratory, and of the fit with
        a constant residual per axis: laboratory, and the columns of
        `pipeline.virtual_lab.analysis.judgement.judge`.
    single
        item, condition, compensated, axis, rms: of shorter studies with one of `ITEMS` each, mean
        over their subjects; item "none" for the laboratory as it is.
    cycle_s
        Mean duration of the perturbed gait cycles [s].
    running
        As `pipeline.virtual_lab.analysis.empty_plate.beside_a_runner` gives it, for the default,
        for four times that, and for the lower end and the value of the estimate.
    """

    setting: Setting
    residuals: pd.DataFrame
    windows: pd.DataFrame
    unstated: Estimate
    unstated_adding: Estimate
    judged: pd.DataFrame
    single: pd.DataFrame
    cycle_s: float
    running: pd.DataFrame


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
        protocol. Studies with a single item have the protocol `SHORT`, those for the estimate
        three subjects as well.
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
        If the protocol lacks a condition of Table III or has one subject, or a trial fails.

    Notes
    -----
    One study at a time is in the folder for temporary files: 5 GB for the thesis' protocol.
    """
    setting = setting or Setting(protocol=THESIS)
    lacking = [name for name in ANALYSED_CONDITIONS if name not in setting.protocol.conditions]
    if lacking:
        raise ValueError(f"protocol: conditions lacks {', '.join(lacking)}, which Table III has")
    if setting.protocol.subjects < MIN_SUBJECTS:
        raise ValueError(f"protocol: subjects is below {MIN_SUBJECTS}; Table III has their SD")
    short = setting.model_copy(update={"protocol": SHORT})
    single = {"none": short} | {item: documented(short, item) for item in ITEMS}
    total = len(LABORATORIES) * _steps(setting) + len(single) * _steps(short) + response_steps()
    done = 0

    def step(name: str) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(name, done, total)

    studies, means = {}, []
    for laboratory, own in ((AS_IS, setting), (DOCUMENTED, documented(setting))):
        studies[laboratory] = _simulated(own, jobs, step)
    level = cells_by_subject(studies[DOCUMENTED].residuals, studies[DOCUMENTED].windows)
    responses = respond(documented(setting), level, jobs, step)
    unstated = estimate(responses, printed_cells())
    unstated_adding = estimate(responses, printed_cells(), adding=True)
    studies[ESTIMATED] = _simulated(unstated.value.apply(documented(setting)), jobs, step)
    for item, own in single.items():
        with TemporaryDirectory(prefix="hbm_") as folder:
            paths = process(own, Path(folder), jobs, step)
            means.append(cell_means(study_residuals(paths)).assign(item=item))
    return Reproduction(
        setting,
        _joined({name: study.residuals for name, study in studies.items()}),
        _joined({name: study.windows for name, study in studies.items()}),
        unstated,
        unstated_adding,
        judgements(
            headline_cells(studies[DOCUMENTED].residuals),
            headline_cells(studies[ESTIMATED].residuals),
            unstated,
            unstated_adding,
        ),
        pd.concat(means, ignore_index=True),
        cycle_s=float(np.mean([span for study in studies.values() for span in study.cycles])),
        running=beside_a_runner(flexibilities(unstated)),
    )


def judgements(
    documented_cells: Array, estimated_cells: Array, unstated: Estimate, adding: Estimate
) -> pd.DataFrame:
    """Judge the laboratories by the cells with compensation.

    Parameters
    ----------
    documented_cells, estimated_cells
        Of the two laboratories by subject, (subjects, 36) [N, N·m].
    unstated, adding
        The estimates of the second one, and those with a constant residual per axis: of these,
        people differ as in the documented laboratory, and as nothing is simulated with them, the
        error of the interpolation is added.

    Returns
    -------
    pandas.DataFrame
        As `Reproduction.judged`.
    """
    printed = printed_cells()
    interpolated = adding.predicted[adding.value.pose] * (
        documented_cells / documented_cells.mean(axis=0)
    )
    interpolated_error = np.hypot(adding.error, adding.interpolation)
    return _joined(
        {
            DOCUMENTED: judge(documented_cells, printed),
            ESTIMATED: judge(estimated_cells, printed, unstated.error, unstated.freedom),
            ADDED: judge(interpolated, printed, interpolated_error, adding.freedom),
        }
    )


@dataclass(frozen=True, slots=True)
class _Study:
    """What a processed study gives: `Reproduction` says what the tables hold."""

    residuals: pd.DataFrame
    windows: pd.DataFrame
    cycles: list[float]


def _simulated(setting: Setting, jobs: int, step: Step) -> _Study:
    with TemporaryDirectory(prefix="hbm_") as folder:
        paths = process(setting, Path(folder), jobs, step)
        return _Study(study_residuals(paths), after_onsets(paths), perturbed_cycles(paths))


def _joined(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    named = [table.assign(laboratory=laboratory) for laboratory, table in tables.items()]
    return pd.concat(named, ignore_index=True)


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
        over subjects, ``mean_thesis, sd_thesis`` as printed, ``within``, whether the mean is
        within the thesis' mean ± SD, and ``fitted``, whether the cell served the estimate of the
        laboratory's values. Where a condition has two windows, both are there.
    """
    keys = ["laboratory", "axis", "unit", "condition", "compensated", "window", "headline"]
    cells = reproduction.residuals.groupby(keys, sort=False)["rms"]
    table = cells.agg(n="count", mean="mean", sd="std").reset_index()
    keys = ["axis", "unit", "condition", "compensated"]
    table = table.merge(printed_cells(), on=keys, suffixes=("", "_thesis"), validate="many_to_one")
    off = (table["mean"] - table["mean_thesis"]).abs()
    fitted = (table["laboratory"] == ESTIMATED) & ~table["compensated"]
    return table.assign(within=off <= table["sd_thesis"], fitted=fitted)
