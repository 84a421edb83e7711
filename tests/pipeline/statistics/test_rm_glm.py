"""The repeated-measures general linear model against R, SPSS, pingouin and its invariances."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pingouin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.rm_glm import orthonormal_contrasts, repeated_measures_glm

FIXTURES = Path(__file__).parents[1] / "fixtures" / "statistics"
ORACLE = json.loads((FIXTURES / "oracle.json").read_text())


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


def test_covariates_left_as_given_equal_car_and_change_only_the_within_effects():
    table, values = cells("study", slice(3, 9), 2, 3)
    between = {
        "sex_code": (table["sex"] == "male").to_numpy(float),
        "height_m": table["height_m"].to_numpy(),
    }
    raw = repeated_measures_glm(values, "ab", between, centre=False)
    assert_equals_r(raw, "study_uncentred")
    for left, right in zip(raw, repeated_measures_glm(values, "ab", between), strict=True):
        assert (left.f == pytest.approx(right.f)) == bool(left.between)


def test_groups_of_three_and_groups_of_two_equal_r():
    table, values = cells("obrien_kaiser", slice(2, 17), 3, 5)
    between = {name: table[name].to_numpy() for name in ("treatment", "gender")}
    terms = repeated_measures_glm(values, "ab", between)
    assert_equals_r(terms, "obrien_kaiser", mauchly_p=False)


def test_errors_and_epsilons_with_groups_equal_those_that_car_prints():
    """R's car, output of the example in ?Anova: treatment × gender between, phase × hour within."""
    printed = {  # error SS and df, epsilon by Greenhouse and Geisser, by Huynh and Feldt, Mauchly W
        ("a",): (80.278, 20, 0.79953, 0.9278594, 0.74927),
        ("b",): (62.500, 40, 0.46028, 0.5592802, 0.06607),
        ("a", "b"): (96.167, 80, 0.44950, 0.7330608, 0.00478),
    }
    table, values = cells("obrien_kaiser", slice(2, 17), 3, 5)
    groups = (table["treatment"] + table["gender"]).to_numpy()
    for term in repeated_measures_glm(values, "ab", {"group": groups}):
        if term.within:
            own = (term.ss_error, term.df2, term.epsilon, term.epsilon_hf, term.mauchly_w)
            np.testing.assert_allclose(own, printed[term.within], rtol=1e-5, atol=5e-6)


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
@settings(deadline=None, max_examples=10)
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


def test_contrasts_are_orthonormal_and_sum_to_zero():
    contrasts = orthonormal_contrasts((2, 3), (True, True))
    np.testing.assert_allclose(contrasts.T @ contrasts, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(contrasts.sum(axis=0), 0, atol=1e-12)


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
        ({"values": np.full((4, 2, 3), np.nan)}, "a cell is missing"),
        ({"factors": "a"}, "one axis per factor"),
        ({"between": {"height": np.arange(3.0)}}, "one value for each of 4 subjects"),
        ({"between": {"height": np.array([1.0, 2, np.nan, 3])}}, "height: missing"),
        ({"between": {"sex": np.array(["male"] * 4)}}, "sex: the same for all"),
        ({"between": {"height": np.full(4, 1.8)}}, "height: the same for all"),
        ({"between": {"x": np.arange(4.0), "y": -np.arange(4.0)}}, "linearly dependent"),
        ({"between": {"id": np.array(list("abcd"))}}, "at least 5"),
    ],
)
def test_a_model_that_cannot_be_fitted_is_refused_with_a_reason(change, message):
    values = np.random.default_rng(4).normal(size=(4, 2, 3))
    arguments = {"values": values, "factors": "ab"} | change
    with pytest.raises(ValueError, match=message):
        repeated_measures_glm(**arguments)
