"""The thesis' Table III in the virtual laboratory (table_3.md).

As it is, and with what the thesis documents.
"""

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import pandas as pd

from pipeline.config.study import read_study
from pipeline.run.load import collect
from pipeline.run.run import run_study
from pipeline.run.store import read_trial
from pipeline.trial.residuals import AXES, reported
from pipeline.virtual_lab.protocol.walking_protocol import CONDITIONS, Setting, find_setting
from pipeline.virtual_lab.protocol.walking_study import simulate_study
from tests.validation.empty_plate import beside_a_runner

AS_IS: Final = "as it is"
DOCUMENTED: Final = "documented"
"""The given laboratory, and with what the thesis documents."""
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


def process(setting: Setting, folder: Path, jobs: int) -> Path:
    """Simulate a study into a folder and process it as `hbm run` does; give its results' folder."""
    study, results = simulate_study(folder / "study", setting, jobs=jobs), folder / "results"
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
    ``table_3``; ``windows`` of sway; and an empty plate beside a ``runner``.
    """
    simulate = partial(_simulated, jobs=jobs)
    studies = {AS_IS: simulate(setting), DOCUMENTED: simulate(documented(setting))}
    return {
        "table_3": compared(_joined({name: own for name, (own, _) in studies.items()})),
        "windows": _joined({name: after for name, (_, after) in studies.items()}),
        "runner": beside_a_runner([1.0, 4.0, 13.9]),
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

    ``within`` says whether the mean is within the thesis' mean ± SD. Where a condition has two
    windows, both are there.
    """
    keys = ["laboratory", "axis", "unit", "condition", "compensated", "window", "headline"]
    cells = residuals.groupby(keys, sort=False)["rms"]
    table = cells.agg(n="count", mean="mean", sd="std").reset_index()
    keys = ["axis", "unit", "condition", "compensated"]
    table = table.merge(printed_cells(), on=keys, suffixes=("", "_thesis"), validate="many_to_one")
    off = (table["mean"] - table["mean_thesis"]).abs()
    return table.assign(within=off <= table["sd_thesis"])
