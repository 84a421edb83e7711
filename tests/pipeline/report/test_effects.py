"""The tests on the page are those of the table of statistics, each in words."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.report.effects import residual_tests
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3, design_of

FIXTURES = Path(__file__).parents[1] / "fixtures" / "statistics"
ORACLE = json.loads((FIXTURES / "oracle.json").read_text())
STUDY = pd.read_csv(FIXTURES / "study.csv")


def long_table(study=STUDY):
    cells = study.drop(columns=["sex", "height_m"]).melt("subject", value_name="rms")
    compensation, condition = zip(*cells["variable"].str.rsplit("_", n=1), strict=True)
    return cells.assign(
        condition=condition, compensated=[c == "ic" for c in compensation], axis="Fx", unit="N"
    )


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
    assert anova["Effect"] == ["IC", "condition", "IC × condition"]
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


def test_friedman_shows_kendalls_w(shown):
    friedman = columns(shown[1][2])
    r = ORACLE["friedman_cells"]
    assert (friedman["χ²"][0], friedman["Kendall's W"][0]) == (f"{r['chi2']:.2f}", f"{r['w']:.2f}")


def test_planned_pairs_have_intervals_and_both_wilcoxon_tests_side_by_side(shown):
    table = shown[1][3]
    k = table.heads.index("p, Wilcoxon exact")
    assert table.heads[k + 1] == "p, Wilcoxon asymptotic"
    assert (
        table.caption
        == "Planned pairs, p Bonferroni-corrected for 5; each interval is of one pair alone"
    )
    for row, r in zip(table.rows, ORACLE["pairs"].values(), strict=True):
        for p, name in zip(row[k : k + 2], ("exact", "asymptotic"), strict=True):
            corrected = min(1, 5 * r[f"p_wilcoxon_{name}"])
            assert float(p.rstrip("*")) == pytest.approx(corrected, abs=5e-4)
        low, high = r["mean_ci"]
        written = f"{r['mean']:+z.1f} [{low:+z.1f}, {high:+z.1f}]".replace("-", "−")
        assert row[2] == written


def test_effects_are_shown_or_not_by_their_corrected_p(shown):
    (line,) = shown[0].lines
    assert line.startswith("Shown at 0.05: IC, p <0.001; condition, p ")
    assert "IC × condition, p " in line
    assert "all cells by ranks (Friedman), p <0.001" in line


def test_an_effect_that_is_not_significant_is_said_to_be_not_shown():
    same = STUDY.copy()
    rng = np.random.default_rng(0)
    for condition in ("baseline", "sway", "pitch"):
        same[f"ic_{condition}"] = same[f"no_ic_{condition}"] + rng.normal(0, 5, 9)
    (only,) = residual_tests(statistics(long_table(same)), EXPERIMENT_3)
    assert only[0].lines[1].startswith("Not shown: IC, p 0.")


def test_one_reason_why_nothing_was_tested_is_said_once():
    table = long_table(STUDY[:1])
    both = pd.concat([table, table.assign(axis="Mz")])
    (only,) = residual_tests(statistics(both), EXPERIMENT_3)
    assert only[0].lead == "All residuals"
    (line,) = only[0].lines
    assert line.startswith("Not computed: needs at least 2 complete subjects, got 1")
    assert only[1] == []


def test_a_covariate_that_cannot_be_used_is_said():
    same_sex = STUDY[["subject", "sex", "height_m"]].assign(sex="f")
    (only,) = residual_tests(statistics(long_table(), same_sex), EXPERIMENT_3)
    assert "RM-ANOVA with height_m: sex left out: the same for all subjects." in only[0].lines
    neither = same_sex.assign(height_m=1.7)
    (only,) = residual_tests(statistics(long_table(), neither), EXPERIMENT_3)
    (said,) = (s for s in only[0].lines if s.startswith("RM-ANOVA with"))
    assert "not computed" in said
    assert "height_m left out: the same for all subjects" in said


def test_groups_are_said_to_be_groups():
    values = np.random.default_rng(1).lognormal(3, 0.1, (8, 3)) * np.repeat([1, 3], 4)[:, None]
    names = [f"s{k}" for k in range(8)]
    table = pd.DataFrame(values, columns=["a", "b", "c"]).assign(subject=names)
    table = table.melt("subject", var_name="condition", value_name="rms")
    table = table.assign(compensated=False, axis="Mz", unit="N·m")
    subjects = pd.DataFrame({"subject": names, "group": ["before"] * 4 + ["after"] * 4})
    design = replace(
        design_of(["a", "b", "c"], compensated=False),
        factor="shoes",
        group="group",
        covariates=(),
    )
    (only,) = residual_tests(statistics(table, subjects, design), design)
    assert only[0].lead == "Mz about up"
    assert only[0].lines[0].startswith("Shown at 0.05: group, p ")
