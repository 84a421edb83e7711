"""The page states how well residuals repeat, in every condition."""

import re

import numpy as np
import pandas as pd
import pytest

from pipeline.report.tables import reliability_tables
from pipeline.statistics.design import unstated_design
from pipeline.statistics.reliability import reliability
from pipeline.trial.residuals import AXES


@pytest.fixture(scope="module")
def repeated():
    """Six residuals and a joint of five subjects, who walked three times in two conditions."""
    rng = np.random.default_rng(3)
    cells = [
        {"subject": f"s{k}", "session": "", "recording": f"{j}", "condition": condition}
        | {"compensated": False, "name": name, "unit": "N", "value": 10 + k + rng.normal()}
        for condition in ("level", "slope")
        for name in (*AXES, "left_ankle z, moment")
        for k in range(5)
        for j in range(3)
    ]
    return reliability(pd.DataFrame(cells))


def test_a_table_per_condition_has_the_six_residuals_and_says_where_joints_are(repeated):
    assert "left_ankle z, moment" in set(repeated["name"])
    tables = reliability_tables(repeated, unstated_design(("level", "slope"), compensated=False))
    for condition, table in zip(("level", "slope"), tables, strict=True):
        assert re.search(f"{condition}: 3 recordings .*5 subjects", table.caption)
        assert "reliability.csv" in table.caption
        assert [row[0] for row in table.rows] == [f"{axis} (N)" for axis in AXES]
