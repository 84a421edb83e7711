"""Residuals of one condition are compared with those of healthy adults."""

import re

import numpy as np
import pandas as pd
import pytest

from pipeline.report.tables import means
from pipeline.report.verdict import verdict_values
from pipeline.statistics.design import design_of
from pipeline.trial.residuals import AXES, HEALTHY_RMS, UNITS

WALKING = design_of(("walking",), compensated=False)
NO_TESTS = pd.DataFrame()


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
    for factor, named in ((0.1, "No residual"), (0.5, "Fz (94.7, healthy 63.1 N)")):
        values = verdict_values([], residuals(factor), NO_TESTS, [], WALKING, planned=False)
        assert values["headline"][0].startswith(named)


def partly_unseen(compensated=False):
    """The trunk of the second subject, whose residuals are larger, has no markers."""
    table = residuals(1.0)
    second = table["subject"] == "S02"
    of_second = np.where(second, 0.5 * table["rms"], np.nan)
    table = table.assign(expected=of_second, rms_percent=np.where(second, 4.0, 1.0))
    return table.assign(compensated=compensated)


@pytest.mark.parametrize("design", [WALKING, design_of(("walking",), compensated=True)])
def test_where_markers_miss_segments_the_table_has_what_is_expected(design):
    rows = partly_unseen()
    if design.compensated:
        rows = pd.concat([rows, partly_unseen(compensated=True)])
    table = means(rows, design)
    assert table.heads[-1] == "Expected"
    assert all(len(row) == len(table.heads) for row in table.rows)
    assert float(table.rows[0][-1]) == pytest.approx(HEALTHY_RMS[0] / 2, abs=0.051)


def test_what_is_expected_is_compared_with_the_recordings_that_lack_markers_alone():
    first, *_ = verdict_values([], partly_unseen(), NO_TESTS, [], WALKING, planned=False)[
        "headline"
    ]
    expected, measured = first.split("; measured ")
    assert re.findall(r"[FM][xyz] [\d.]+", expected) == [
        *("Fx 2.0", "Fy 2.0", "Fz 2.0", "Mx 2.00", "My 2.00", "Mz 2.00")
    ]
    assert re.findall(r"\d\.\d+", measured) == ["4.0"] * 3 + ["4.00"] * 3
