"""The tests on the page are those of the table of statistics, each in words."""

import pytest

from pipeline.report.effects import residual_tests
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3
from tests.pipeline.statistics.fixtures import ORACLE, STUDY, long_table


@pytest.fixture(scope="module")
def shown():
    found = statistics(long_table(), STUDY[["subject", "sex", "height_m"]])
    (only,) = residual_tests(found, EXPERIMENT_3)
    return only


def columns(table):
    return {head: [row[k] for row in table.rows] for k, head in enumerate(table.heads)}


def test_the_analysis_of_variance_is_rs(shown):
    anova = columns(shown[1][0])
    expected = {row["term"]: row for row in ORACLE["study"]}
    for k, term in enumerate(("a", "b", "a:b")):
        r = expected[term]
        assert anova["F"][k] == f"{r['f']:.2f}"
        assert anova["df"][k] == f"{r['df1']:g}, {r['df2']:g}"
        eta = r["ss"] / (r["ss"] + r["ss_error"])
        assert anova["partial η² [95 % CI]"][k].startswith(f"{eta:.2f} [0.")
        if r["epsilon"] is not None:
            assert anova["ε GG"][k] == f"{r['epsilon']:.3f}"
            assert anova["Mauchly's W"][k] == f"{r['mauchly_w']:.3f}"
            assert anova["its p"][k] == f"{r['mauchly_p']:.3f}*"
    assert [p.endswith("GG") for p in anova["p corrected"]] == [False, True, True]


def test_planned_pairs_have_intervals_and_both_wilcoxon_tests_side_by_side(shown):
    table = shown[1][3]
    k = table.heads.index("p, Wilcoxon exact")
    assert table.heads[k + 1] == "p, Wilcoxon asymptotic"
    for row, r in zip(table.rows, ORACLE["pairs"].values(), strict=True):
        for p, name in zip(row[k : k + 2], ("exact", "asymptotic"), strict=True):
            corrected = min(1, 5 * r[f"p_wilcoxon_{name}"])
            assert float(p.rstrip("*")) == pytest.approx(corrected, abs=5e-4)
        low, high = r["mean_ci"]
        written = f"{r['mean']:+z.1f} [{low:+z.1f}, {high:+z.1f}]".replace("-", "−")
        assert row[2] == written
