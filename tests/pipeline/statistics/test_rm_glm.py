"""The repeated-measures general linear model is that of R, SPSS and pingouin."""

import numpy as np
import pandas as pd
import pingouin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.rm_glm import (
    observed_power,
    partial_eta_squared_interval,
    repeated_measures_glm,
)
from tests.pipeline.statistics.fixtures import FIXTURES, ORACLE


def cells(name, columns, *levels):
    table = pd.read_csv(FIXTURES / f"{name}.csv")
    return table, table.iloc[:, columns].to_numpy(float).reshape(-1, *levels)


def by_name(terms):
    return {frozenset(filter(None, (*term.within, term.between))): term for term in terms}


def assert_equals_r(terms, key, *, mauchly_p=True):
    own = by_name(terms)
    rows = [row for row in ORACLE[key] if row["term"] != "(Intercept)"]
    assert len(own) == len(rows)
    for row in rows:
        term = own[frozenset(row["term"].split(":"))]
        for name in ("ss", "ss_error", "df1", "df2", "f", "p"):
            np.testing.assert_allclose(getattr(term, name), row[name], rtol=1e-9, err_msg=name)
        for name in ("epsilon", "p_gg", "mauchly_w", "mauchly_p")[: 4 if mauchly_p else 3]:
            if row[name] is not None:
                np.testing.assert_allclose(getattr(term, name), row[name], rtol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("name", "columns", "levels"),
    [("toothgrowth", slice(0, 6), (2, 3)), ("study", slice(3, 9), (2, 3))],
)
def test_a_two_by_three_design_equals_r(name, columns, levels):
    _, values = cells(name, columns, *levels)
    key = {"toothgrowth": "tooth"}.get(name, name)
    assert_equals_r(repeated_measures_glm(values, "ab"), key)


def test_sex_and_height_together_equal_car_anova_type_3():
    table, values = cells("study", slice(3, 9), 2, 3)
    between = {"sex": table["sex"].to_numpy(), "height": table["height_m"].to_numpy()}
    terms = repeated_measures_glm(values, "ab", between)
    assert_equals_r(terms, "study_covariates")
    assert by_name(terms)[frozenset({"a", "height"})].df2 == 6


def test_groups_of_three_and_groups_of_two_equal_r():
    table, values = cells("obrien_kaiser", slice(2, 17), 3, 5)
    between = {name: table[name].to_numpy() for name in ("treatment", "gender")}
    terms = repeated_measures_glm(values, "ab", between)
    assert_equals_r(terms, "obrien_kaiser", mauchly_p=False)


def test_the_attitude_data_equal_the_table_that_spss_printed():
    _, values = cells("attitude", slice(0, 9), 3, 3)
    means = [21.05, 4.45, 10.00, 25.35, -12.00, 11.65, 17.40, -9.20, 2.35]  # published
    np.testing.assert_allclose(values.mean(axis=0).ravel(), means)
    printed = {  # F, W, its p, epsilon
        "drink": (5.106, 0.267, 0.000, 0.577),
        "imagery": (122.565, 0.662, 0.024, 0.747),
        "drink imagery": (17.155, 0.595, 0.436, 0.798),
    }
    assert_equals_r(repeated_measures_glm(values, "ab"), "attitude", mauchly_p=False)
    terms = repeated_measures_glm(values, ("drink", "imagery"))
    for term in terms:
        numbers = (term.f, term.mauchly_w, term.mauchly_p, term.epsilon)
        assert tuple(round(number, 3) for number in numbers) == printed[" ".join(term.within)]
    assert round(terms[0].p_gg, 3) == 0.030


def test_mauchly_p_with_four_contrasts_is_what_r_gives_for_the_contrasts_alone():
    _, values = cells("attitude", slice(0, 9), 3, 3)
    interaction = repeated_measures_glm(values, "ab")[-1]
    assert interaction.mauchly_p == pytest.approx(ORACLE["mauchly_of_contrasts"], rel=1e-9)


@given(st.integers(0, 10_000), st.integers(3, 12))
@settings(max_examples=10)
def test_without_covariates_pingouin_agrees(seed, n):
    values = np.random.default_rng(seed).normal(size=(n, 2, 3)) + 0.3
    index = pd.MultiIndex.from_product([range(n), range(2), range(3)], names=["s", "a", "b"])
    data = pd.DataFrame({"y": values.ravel()}, index=index).reset_index()
    table = pingouin.rm_anova(data, "y", ["a", "b"], "s", effsize="np2")
    for term, (_, row) in zip(repeated_measures_glm(values, "ab"), table.iterrows(), strict=True):
        own = (term.f, term.p, term.p_gg, term.epsilon, term.partial_eta_squared)
        names = ["F", "p_unc", "p_GG_corr", "eps", "np2"]
        np.testing.assert_allclose(own, row[names].astype(float), rtol=1e-8)
        if "b" in term.within:
            spherical = row[["W_spher", "p_spher"]].astype(float)
            np.testing.assert_allclose((term.mauchly_w, term.mauchly_p), spherical, rtol=1e-8)


def test_one_two_level_factor_is_the_paired_t_test():
    values = np.random.default_rng(0).normal(size=(9, 2))
    (term,) = repeated_measures_glm(values, ["IC"])
    t = stats.ttest_rel(values[:, 0], values[:, 1])
    assert (term.f, term.p) == pytest.approx((t.statistic**2, t.pvalue))
    assert (term.epsilon, term.p_gg) == pytest.approx((1, term.p))


def test_shifting_a_subject_or_changing_the_unit_changes_no_within_effect():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(9, 2, 3))
    moved = 1000 * (values + rng.normal(size=(9, 1, 1)))
    for left, right in zip(
        repeated_measures_glm(values, "ab"), repeated_measures_glm(moved, "ab"), strict=True
    ):
        assert (right.f, right.epsilon) == pytest.approx((left.f, left.epsilon))


def test_the_unit_of_a_covariate_is_irrelevant():
    table, values = cells("study", slice(3, 9), 2, 3)
    metres = repeated_measures_glm(values, "ab", {"height": table["height_m"].to_numpy()})
    feet = repeated_measures_glm(values, "ab", {"height": table["height_m"].to_numpy() / 0.3048})
    np.testing.assert_allclose([t.f for t in feet], [t.f for t in metres])


def test_an_effect_that_is_the_same_for_every_subject_has_no_f():
    values = np.random.default_rng(2).normal(size=(5, 1, 3)).repeat(2, axis=1)
    values[:, 1] += 0.1
    compensation, condition, interaction = repeated_measures_glm(values, "ab")
    assert np.isnan([compensation.f, compensation.p, interaction.f, interaction.p]).all()
    assert np.isfinite(condition.f)


def test_two_subjects_leave_sphericity_untested():
    terms = repeated_measures_glm(np.random.default_rng(3).normal(size=(2, 2, 3)), "ab")
    assert np.isnan([term.mauchly_w for term in terms]).all()
    assert terms[1].epsilon == pytest.approx(0.5)  # its lower bound


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"between": {"sex": np.array(["male"] * 4)}}, "sex: the same"),
        ({"between": {"x": np.arange(4.0), "y": -np.arange(4.0)}}, "linearly dependent"),
        ({"between": {"id": np.array(list("abcd"))}}, "at least 5"),
    ],
)
def test_a_model_that_cannot_be_fitted_is_refused_with_a_reason(change, message):
    values = np.random.default_rng(4).normal(size=(4, 2, 3))
    arguments = {"values": values, "factors": "ab"} | change
    with pytest.raises(ValueError, match=message):
        repeated_measures_glm(**arguments)


@pytest.mark.parametrize(("p", "printed"), [(0.259, 0.184), (0.467, 0.101)])
def test_observed_power_gives_what_the_thesis_printed_for_sex_and_length(p, printed):
    power = observed_power(stats.f.isf(p, 1, 6), 1, 6)
    assert round(power, 3) == printed
    assert round(observed_power(stats.f.isf(p, 1, 7), 1, 7), 3) != printed


def test_observed_power_of_no_effect_is_the_level_of_significance():
    assert observed_power(0.0, 2, 16, 0.01) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("f", "df", "low", "high"),
    [(40.72, (2, 18), 0.66, 0.89), (33.77, (1, 9), 0.49, 0.89)],
)
def test_the_interval_of_partial_eta_squared_is_that_of_rs_effectsize(f, df, low, high):
    found = partial_eta_squared_interval(f, *df, confidence=0.9)
    assert tuple(round(bound, 2) for bound in found) == (low, high)


@given(
    st.floats(0, 20) | st.floats(0, 1e30, allow_subnormal=False),
    st.integers(1, 8),
    st.integers(1, 100),
)
@example(7.000641807206912e16, 8, 65)  # both bounds are 1 but for rounding
@settings(max_examples=60)
def test_the_interval_of_partial_eta_squared_excludes_zero_where_f_is_significant(f, df1, df2):
    low, high = partial_eta_squared_interval(f, df1, df2)
    assert 0 <= low <= high <= 1
    assert (low > 0) == (stats.f.sf(f, df1, df2) < 0.025)


@pytest.mark.parametrize("df", [(1, 8), (0.5, 3.2)])
def test_the_interval_of_a_very_large_effect_continues_that_of_a_large_one(df):
    below, above = (partial_eta_squared_interval(f / df[0], *df) for f in (0.999e6, 1.001e6))
    np.testing.assert_allclose(1 - np.array(below), 1 - np.array(above), rtol=0.01)


def test_a_very_large_f_has_a_power_of_one():
    for f in np.geomspace(200, 1e5, 30):
        assert observed_power(f, 1, 8) > 1 - 1e-9
