"""Published tables, the study of nine subjects, and what R says of them all."""

import json
from pathlib import Path

import pandas as pd

FIXTURES = Path(__file__).parents[1] / "fixtures" / "statistics"
ORACLE = json.loads((FIXTURES / "oracle.json").read_text())
STUDY = pd.read_csv(FIXTURES / "study.csv")


def long_table(study=STUDY, axes=("Fx",)):
    """Lay out the columns of a study, such as ``no_ic_sway``, as a long table."""
    cells = study.drop(columns=["sex", "height_m"]).melt("subject", value_name="rms")
    compensation, condition = zip(*cells["variable"].str.rsplit("_", n=1), strict=True)
    cells["condition"] = condition
    cells["compensated"] = [name == "ic" for name in compensation]
    tables = [cells.assign(axis=axis, unit="N", n_cycles=50) for axis in axes]
    return pd.concat(tables, ignore_index=True).drop(columns="variable")
