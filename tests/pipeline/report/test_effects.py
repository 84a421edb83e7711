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


def table_of(shown, caption):
    """The columns of the table of a test, by their heads."""
    table = next(table for table in shown[1] if table.caption.startswith(caption))
    return {head: [row[k] for row in table.rows] for k, head in enumerate(table.heads)}


def test_the_analysis_of_variance_is_rs(shown):
    anova, mauchly = table_of(shown, "RM-ANOVA"), table_of(shown, "Mauchly, RM-ANOVA")
    tested = zip(mauchly["Effect"], mauchly["statistic"], mauchly["p"], strict=True)
    of_mauchly = {effect: (w, p) for effect, w, p in tested}
    expected = {row["term"]: row for row in ORACLE["study"]}
    for k, term in enumerate(("a", "b", "a:b")):
        r = expected[term]
        assert anova["statistic"][k] == f"F {r['f']:.3f}"
        assert anova["df"][k] == f"{r['df1']:g}, {r['df2']:g}"
        eta = r["ss"] / (r["ss"] + r["ss_error"])
        assert anova["effect size [95 % CI]"][k].startswith(f"partial eta squared {eta:.2f} [0.")
        if r["epsilon"] is not None:
            assert anova["ε GG"][k] == f"{r['epsilon']:.3f}"
            sphericity = f"W {r['mauchly_w']:.3f}", f"{r['mauchly_p']:.3f}*"
            assert of_mauchly[anova["Effect"][k]] == sphericity
    assert [c == "Greenhouse-Geisser" for c in anova["correction"]] == [False, True, True]


def test_planned_pairs_have_intervals_and_both_wilcoxon_tests(shown):
    estimates = table_of(shown, "Estimate")["effect size [95 % CI]"]
    for name in ("exact", "asymptotic"):
        found = table_of(shown, f"Wilcoxon {name}")["p corrected"]
        for p, r in zip(found, ORACLE["pairs"].values(), strict=True):
            corrected = min(1, 5 * r[f"p_wilcoxon_{name}"])
            assert float(p.rstrip("*")) == pytest.approx(corrected, abs=5e-4)
    for r in ORACLE["pairs"].values():
        low, high = r["mean_ci"]
        interval = f"{r['mean']:+z.1f} [{low:+z.1f}, {high:+z.1f}]".replace("-", "−")
        assert f"mean difference {interval}" in estimates
