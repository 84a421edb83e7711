"""Statistics hold for any design, with renamed conditions, one factor, two levels or groups."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pingouin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3, design_of, unstated_design
from pipeline.statistics.table_3 import table_3, table_3_markdown
from pipeline.statistics.verdict import verdicts
from tests.pipeline.statistics.fixtures import FIXTURES, ORACLE

NEW_NAMES = {"baseline": "still", "sway": "tilt", "pitch": "shake"}


def long_table(values, design, axis="Fx"):
    """Lay out values of (subjects, variants, conditions) as a long table."""
    index = pd.MultiIndex.from_product(
        [[f"s{k:02}" for k in range(len(values))], design.variants, design.conditions],
        names=["subject", "compensated", "condition"],
    )
    table = pd.DataFrame({"rms": np.asarray(values, float).ravel()}, index=index).reset_index()
    return table.assign(axis=axis, unit="N")


def rows(table, test):
    return table[table["test"] == test].set_index("effect")


def renamed(table, columns):
    """Give the table with the conditions' new names in texts."""
    table = table.copy()
    for column in columns:
        for old, new in NEW_NAMES.items():
            table[column] = table[column].str.replace(old, new)
    return table


@pytest.fixture(scope="module")
def walked():
    """Nine subjects in experiment 3, one of them without pitch."""
    values = np.random.default_rng(5).lognormal(3.5, 0.4, (9, 2, 3))
    values[:, 0, 1:] += 200
    values[4, :, 2] = np.nan
    table = pd.concat(
        [long_table(values, EXPERIMENT_3), long_table(2 * values, EXPERIMENT_3, "My")]
    )
    heights = np.random.default_rng(6).normal(1.75, 0.1, 9)
    subjects = pd.DataFrame(
        {
            "subject": sorted(set(table["subject"])),
            "sex": ["male", "female", "male"] * 3,
            "height_m": heights,
        }
    )
    return table, subjects


def test_conditions_of_other_names_give_the_same_statistics_bit_for_bit(walked):
    table, subjects = walked
    other = table.assign(condition=table["condition"].map(NEW_NAMES))
    design = unstated_design(NEW_NAMES.values(), compensated=True)
    own, known = statistics(other, subjects, design), statistics(table, subjects)
    pd.testing.assert_frame_equal(own, renamed(known, ["effect", "note"]), check_exact=True)
    third = table_3(other, own, design)
    pd.testing.assert_frame_equal(
        third, renamed(table_3(table, known), ["condition"]), check_exact=True
    )
    assert [(v.axis, NEW_NAMES[v.condition], v.answer, v.low, v.high) for v in verdicts(table)] == [
        (v.axis, v.condition, v.answer, v.low, v.high) for v in verdicts(other, design)
    ]


@pytest.mark.parametrize(
    ("conditions", "compared"),
    [
        (["pitch", "familiarisation", "sway", "baseline"], ("baseline", "sway", "pitch")),
        (["shod", "baseline", "braced"], ("baseline", "shod", "braced")),
        (["before", "after"], ("before", "after")),
        (["normal", "sway"], ("normal", "sway")),
    ],
)
def test_the_reference_of_experiment_3_is_first_and_else_the_order_is_that_of_the_study(
    conditions, compared
):
    assert unstated_design(conditions, compensated=True).conditions == compared


PINGOUINS_OWN = pytest.mark.filterwarnings("ignore:The inplace keyword in DataFrame.dropna")


@PINGOUINS_OWN
@given(st.integers(0, 10_000), st.integers(4, 12), st.integers(3, 5))
@settings(max_examples=10)
def test_one_factor_is_pingouins_repeated_measures_anova(seed, n, levels):
    names = [f"shoe{k}" for k in range(levels)]
    design = replace(design_of(names, compensated=False), factor="shoes")
    table = long_table(np.random.default_rng(seed).lognormal(3, 0.3, (n, 1, levels)), design)
    found = statistics(table, design=design)
    row = rows(found, "RM-ANOVA").loc["shoes"]
    theirs = pingouin.rm_anova(table, "rms", "condition", "subject", effsize="np2", correction=True)
    theirs = theirs.iloc[0]
    own = row[["statistic", "df1", "df2", "p_uncorrected", "epsilon", "effect_size"]]
    expected = theirs[["F", "ddof1", "ddof2", "p_unc", "eps", "np2"]]
    np.testing.assert_allclose(own.astype(float), expected.astype(float), rtol=1e-8)


def test_two_levels_are_compared_by_t_and_wilcoxon_and_their_f_is_t_squared():
    design = design_of(["before", "after"], compensated=False)
    before, after = np.random.default_rng(1).lognormal(3, 0.2, (2, 9))
    found = statistics(long_table(np.stack([before, after], axis=1), design), design=design)
    t, f = rows(found, "paired t"), rows(found, "RM-ANOVA").loc["condition"]
    oracle = stats.ttest_rel(after, before)
    assert t.index.tolist() == ["after - before"] * 2  # Bonferroni and Holm
    np.testing.assert_allclose(t["p_corrected"], oracle.pvalue)
    assert (f["statistic"], f["df1"], f["df2"]) == pytest.approx((oracle.statistic**2, 1, 8))
    assert f["epsilon"] == 1
    wilcoxon = rows(found, "Wilcoxon exact")["p_uncorrected"].iloc[0]
    assert wilcoxon == pytest.approx(stats.wilcoxon(after, before, mode="exact").pvalue)


@pytest.fixture(scope="module")
def therapy():
    """O'Brien & Kaiser (1985): three treatments, two genders, phases; means over the hours."""
    table = pd.read_csv(FIXTURES / "obrien_kaiser.csv")
    phases = table.iloc[:, 2:].to_numpy(float).reshape(-1, 3, 5).mean(axis=2)
    design = replace(
        design_of(["pre", "post", "fup"], compensated=False),
        factor="a",
        group="treatment",
        covariates=("gender",),
    )
    long = long_table(phases[:, None], design)
    subjects = table[["treatment", "gender"]].assign(subject=sorted(set(long["subject"])))
    return long, subjects, design


def test_the_mixed_anova_of_o_brien_and_kaiser_equals_car(therapy):
    long, subjects, design = therapy
    found = rows(statistics(long, subjects, design), "mixed ANOVA with gender")
    expected = {row["term"]: row for row in ORACLE["obrien_kaiser"]}
    tested = {"treatment", "gender", "a", "a:treatment", "a:gender"}
    assert set(found.index) == tested
    for effect in tested:
        row = found.loc[effect]
        r = expected[":".join(reversed(effect.split(":")))]
        own = row[["statistic", "df1", "df2", "p_uncorrected"]].astype(float)
        np.testing.assert_allclose(own, [r["f"], r["df1"], r["df2"], r["p"]], rtol=1e-9)
        assert row["effect_size"] == pytest.approx(r["ss"] / (r["ss"] + r["ss_error"]))
        if "a" in effect.split(":"):
            assert row["epsilon"] == pytest.approx(r["epsilon"], rel=1e-9)


def test_a_subject_without_a_group_is_left_out(therapy):
    long, subjects, design = therapy
    subjects = subjects.assign(treatment=subjects["treatment"].where(subjects["subject"] != "s03"))
    found = statistics(long, subjects, replace(design, covariates=()))
    anova = rows(found, "mixed ANOVA")
    assert (anova["n"] == 15).all()
    assert (rows(found, "paired t")["n"] == 16).all()


def test_planned_pairs_margin_and_correction_are_those_of_the_design(walked):
    table, _ = walked
    pairs = (("sway IC", "baseline no IC"), ("pitch IC", "baseline no IC"))
    design = replace(EXPERIMENT_3, pairs=pairs, correction="holm", margin=0.5)
    found = statistics(table, design=design)
    third = table_3(table, found, design)
    holm = rows(found[(found["axis"] == "Fx") & (found["correction"] == "Holm x2")], "paired t")
    sway = third[(third["axis"] == "Fx") & (third["condition"] == "sway")].iloc[0]
    assert sway["p_t_baseline"] == holm.loc["sway IC - baseline no IC", "p_corrected"]
    assert np.isnan(sway["p_t"])
    judged = verdicts(table, design)
    assert {v.condition for v in judged} == {"sway", "pitch"}
    for verdict in judged:
        assert (verdict.answer == "within margin") == (verdict.high <= 0.5 * verdict.baseline)


def test_table_3_of_one_factor_shows_the_difference_from_the_reference():
    design = design_of(["own", "boots"], compensated=False)
    values = np.stack([np.arange(10.0, 19), np.arange(12.0, 21) + [0, 1, 0] * 3], axis=1)
    table = long_table(values[:, None], design)
    text = table_3_markdown(table_3(table, statistics(table, design=design), design), design)
    assert "| boots | 9 | 16.3 ± 2.8 | +2.3 |" in text
    assert "IC" not in text
