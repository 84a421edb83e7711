"""Residuals of one condition are compared with those of healthy adults."""

import numpy as np
import pandas as pd

from pipeline.report.tables import means
from pipeline.report.verdict import verdict_values
from pipeline.statistics.design import design_of
from pipeline.trial.residuals import AXES, HEALTHY_RMS, UNITS

WALKING = design_of(("walking",), compensated=False)


def residuals(factor):
    """Of two subjects, as a share of the healthy RMS; Fz is three times as large."""
    rows = [
        (subject, "walking", False, axis, unit, factor * healthy * (3 if axis == "Fz" else 1))
        for subject in ("S01", "S02")
        for axis, unit, healthy in zip(AXES, UNITS, HEALTHY_RMS, strict=True)
    ]
    columns = ["subject", "condition", "compensated", "axis", "unit", "rms"]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(window="cycle", n_cycles=3, expected=np.nan, rms_percent=1.0)


def test_the_table_has_the_healthy_rms_and_no_columns_of_compensation():
    table = means(residuals(0.5), WALKING)
    assert [*table.heads[-2:]] == ["RMS", "Healthy"]
    assert [row[-1] for row in table.rows] == [f"{value:.1f}" for value in HEALTHY_RMS]


def test_the_verdict_names_what_is_above_the_healthy_rms():
    for factor, named in ((0.1, "No residual is above"), (0.5, "Fz (94.7, healthy 63.1 N): above")):
        values = verdict_values([], residuals(factor), WALKING, stated=False)
        assert values["headline"][0].startswith(f"{named} the RMS of healthy adults")
