"""The tests on the page are those of the table of statistics, as R computes them."""

import re

import pytest

from pipeline.report.effects import tests_table as table_of_tests
from pipeline.statistics.comparison import statistics
from tests.pipeline.statistics.fixtures import ORACLE, STUDY, long_table


@pytest.fixture(scope="module")
def shown():
    """The only residual's cell of each test and effect."""
    table = table_of_tests(statistics(long_table(), STUDY[["subject", "sex", "height_m"]]))
    return {row[0]: next(cell for cell in row[1:] if cell != "–") for row in table.rows}


def test_the_analysis_of_variance_is_rs(shown):
    """F, with the degrees of freedom of its p-value, and the effect size."""
    cells = [cell for name, cell in shown.items() if name.startswith("RM-ANOVA: ")]
    expected = {row["term"]: row for row in ORACLE["study"]}
    for cell, term in zip(cells, ("a", "b", "a:b"), strict=True):
        r = expected[term]
        factor = 1.0 if r["epsilon"] is None else r["epsilon"]
        found = re.match(r"F\(([\d.]+), ([\d.]+)\) = ([\d.]+), p .*?, ηp² = ([\d.]+) \[", cell)
        df1, df2, f, eta = map(float, found.groups())
        assert (df1, df2) == pytest.approx((factor * r["df1"], factor * r["df2"]), abs=0.0051)
        assert f == pytest.approx(r["f"], abs=0.0051)
        assert eta == pytest.approx(r["ss"] / (r["ss"] + r["ss_error"]), abs=0.0051)


def test_what_was_not_computed_is_said_once():
    one = long_table()
    table = table_of_tests(statistics(one[one["subject"] == one["subject"].iloc[0]]))
    assert table.rows == []
    assert table.legend.count("not computed") == 1
