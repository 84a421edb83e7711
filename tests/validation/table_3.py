"""The thesis' Table III in the virtual laboratory (docs/table_3.md).

As it is, with what the thesis documents, and with estimates of what it does not state.
"""

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array
from pipeline.config.study import read_study
from pipeline.run.load import collect
from pipeline.run.run import run_study
from pipeline.run.store import read_trial
from pipeline.trial.residuals import AXES, reported
from pipeline.virtual_lab.protocol.walking_protocol import CONDITIONS, Setting, find_setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study

AS_IS: Final = "as it is"
DOCUMENTED: Final = "documented"
ESTIMATED: Final = "estimated"
"""The given laboratory; with what the thesis documents; and with what it does not state as
estimated from the cells without compensation."""
THESIS_SUBJECTS: Final = 9
MAX_LEFT: Final = 0.5
"""Share of a residual that compensation leaves where it is said to have removed something: in the
thesis 4 to 22 % are left where the treadmill's inertia acts, 82 % or more elsewhere."""
LENGTHS_S: Final = (0.1, 0.2, 0.27, 0.3, 0.4, 0.5, 0.7, 0.9)
"""Windows from the onset of a perturbation that are compared: from less than the platform moves to
nearly a gait cycle."""
PERTURBED: Final = "sway"
KEYS: Final = ["condition", "compensated", "axis"]
CELLS: Final = pd.MultiIndex.from_product([CONDITIONS, (False, True), AXES], names=KEYS)
"""Keys of the 36 cells of Table III, in the order of arrays of cells."""


def printed_cells() -> pd.DataFrame:
    """Give the 36 cells as the thesis prints them: axis, unit, condition, compensated, mean, sd."""
    return pd.read_csv(Path(__file__).with_name("printed_table_3.csv"))


def removed(printed: pd.DataFrame) -> list[tuple[str, str]]:
    """Name condition and axis where the mean with compensation is below `MAX_LEFT` of the other."""
    means = printed.pivot(index=["condition", "axis"], columns="compensated", values="mean")
    found = means.index[means[True] < MAX_LEFT * means[False]]
    return sorted(found, key=lambda cell: (CONDITIONS.index(cell[0]), cell[1]))


def process(setting: Setting, folder: Path, jobs: int) -> Path:
    """Simulate a study into a folder and process it as `hbm run` does; give its results' folder."""
    simulate_study(folder / "study", setting, jobs=jobs, keep=True)
    return process_study(folder / "study", folder / "results", jobs)


def process_study(study: Path, results: Path, jobs: int) -> Path:
    """Process a study's files as `hbm run` does; a trial that fails ends it with the reason."""
    for outcome in run_study(read_study(study), results, jobs=jobs):
        if outcome.failure is not None:
            raise ValueError(f"{outcome}: {outcome.failure}")
    return results


def after_onsets(results: Path) -> pd.DataFrame:
    """Give RMS residuals of sway trials over windows that start at the onsets."""
    rows = []
    for path in sorted((results / "trials").glob(f"*_{PERTURBED}.parquet")):
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
    """Lay out the cells of a study with sway over each of `LENGTHS_S`, (subjects, windows, 36)."""
    steady = residuals[residuals["headline"] & (residuals["condition"] != PERTURBED)]
    perturbed = after.assign(condition=PERTURBED)
    own = [pd.concat([steady, perturbed[perturbed["length_s"] == s]]) for s in LENGTHS_S]
    return np.stack([_by_subject(rows) for rows in own], axis=1)


def headline_cells(residuals: pd.DataFrame) -> Array:
    """Lay out the headline windows' cells of one study, (subjects, 36)."""
    return _by_subject(residuals[residuals["headline"]])


def _by_subject(rows: pd.DataFrame) -> Array:
    table = rows.pivot(index="subject", columns=KEYS, values="rms").sort_index()
    return np.asarray(table[CELLS].to_numpy(), float)


def documented(setting: Setting) -> Setting:
    """Give a laboratory with what the thesis documents, the values of the setting ``thesis``."""
    thesis = find_setting(Path("thesis"))
    stated = {key: getattr(thesis.protocol, key) for key in ("filter", "pose")}
    return setting.model_copy(
        update={
            "protocol": setting.protocol.model_copy(update=stated),
            "faults": setting.faults.model_copy(
                update={"plates": thesis.faults.plates, "platform": thesis.faults.platform}
            ),
        }
    )


def reproduce(setting: Setting, jobs: int) -> dict[str, pd.DataFrame]:
    """Simulate and process the studies that Table III is compared with; name -> table.

    Every trial is simulated, written to a file, and processed as `hbm run` does; one study at a
    time is in the folder for temporary files, 5 GB for the thesis' protocol. The tables: the
    ``table_3``; ``windows`` of sway; the ``estimates`` of what the thesis does not state; the cells
    with compensation as ``judged``; and an empty plate beside a ``runner``.
    """
    from tests.validation.empty_plate import beside_a_runner
    from tests.validation.unstated import estimate, estimates_table, judge, respond

    lab, printed = documented(setting), printed_cells()
    simulate = partial(_simulated, jobs=jobs)
    studies = {AS_IS: simulate(setting), DOCUMENTED: simulate(lab)}
    responses = respond(lab, cells_by_subject(*studies[DOCUMENTED]), jobs)
    unstated = estimate(responses, printed)
    studies[ESTIMATED] = simulate(unstated.value.apply(lab))
    judged = {
        DOCUMENTED: judge(headline_cells(studies[DOCUMENTED][0]), printed),
        ESTIMATED: judge(
            headline_cells(studies[ESTIMATED][0]), printed, unstated.error, unstated.freedom
        ),
    }
    ends = {1.0, 4.0, unstated.low.flexibility, unstated.value.flexibility}
    return {
        "table_3": compared(_joined({name: own for name, (own, _) in studies.items()})),
        "windows": _joined({name: after for name, (_, after) in studies.items()}),
        "estimates": estimates_table(unstated),
        "judged": _joined(judged),
        "runner": beside_a_runner(sorted(ends)),
    }


def _simulated(setting: Setting, jobs: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Give a processed study's residuals, and those of windows after the onsets."""
    with TemporaryDirectory(prefix="hbm_") as folder:
        results = process(setting, Path(folder), jobs)
        return collect(results).residuals, after_onsets(results)


def _joined(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    named = [table.assign(laboratory=laboratory) for laboratory, table in tables.items()]
    return pd.concat(named, ignore_index=True)


def compared(residuals: pd.DataFrame) -> pd.DataFrame:
    """Put the cells of Table III beside those of the virtual laboratory, (mean, SD over subjects).

    ``within`` says whether the mean is within the thesis' mean ± SD, ``fitted`` whether the cell
    served the estimate. Where a condition has two windows, both are there.
    """
    keys = ["laboratory", "axis", "unit", "condition", "compensated", "window", "headline"]
    cells = residuals.groupby(keys, sort=False)["rms"]
    table = cells.agg(n="count", mean="mean", sd="std").reset_index()
    keys = ["axis", "unit", "condition", "compensated"]
    table = table.merge(printed_cells(), on=keys, suffixes=("", "_thesis"), validate="many_to_one")
    off = (table["mean"] - table["mean_thesis"]).abs()
    fitted = (table["laboratory"] == ESTIMATED) & ~table["compensated"]
    return table.assign(within=off <= table["sd_thesis"], fitted=fitted)
