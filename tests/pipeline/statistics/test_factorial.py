"""Factorial analysis of variance, marginal means and Box–Cox against R's car and emmeans."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special, stats

from pipeline.statistics.factorial import anova, box_cox, compare_levels, residuals

FIXTURES = Path(__file__).parents[1] / "fixtures" / "statistics"
ORACLE = json.loads((FIXTURES / "oracle.json").read_text())
FACTORS = ["speed_m_s", "position", "weight_kg"]
IN_R = {"speed": "speed_m_s", "position": "position", "weight": "weight_kg"}


@pytest.fixture
def plates():
    """Three factors, one to three trials in a cell."""
    table = pd.read_csv(FIXTURES / "plates.csv")
    return table.assign(log_rmse=np.log(table["rmse"]))


@pytest.mark.parametrize(("interactions", "key"), [(False, "anova_main"), (True, "anova_full")])
def test_an_unbalanced_three_way_design_equals_car_anova_type_3(plates, interactions, key):
    found = anova(plates, "log_rmse", FACTORS, interactions=interactions).set_index("effect")
    rows = {row["term"]: row for row in ORACLE[key]}
    assert len(found) == len(rows) - 1  # R tests the intercept too
    for term, row in rows.items():
        if term in ("(Intercept)", "Residuals"):
            continue
        own = found.loc[":".join(IN_R[name] for name in term.split(":"))]
        for name in ("ss", "df", "f", "p"):
            np.testing.assert_allclose(own[name], row[name], rtol=1e-9, err_msg=f"{term} {name}")
    assert found.loc["residual", "ss"] == pytest.approx(rows["Residuals"]["ss"])
    assert found.loc["residual", "df"] == rows["Residuals"]["df"]


@pytest.mark.parametrize(
    ("factor", "interactions", "key"),
    [
        ("speed", False, "marginal_main"),
        ("position", False, "marginal_main"),
        ("weight", False, "marginal_main"),
        ("position", True, "marginal_full"),
    ],
)
def test_marginal_means_and_their_bonferroni_pairs_equal_emmeans(plates, factor, interactions, key):
    found = compare_levels(
        plates, "log_rmse", FACTORS, IN_R[factor], interactions=interactions
    ).set_index(["first", "second"])
    levels = [str(level) for level in plates[IN_R[factor]].unique()]
    names = {"difference": "difference", "standard_error": "se", "t": "t", "df": "df"}
    names |= {"p_bonferroni": "p", "p_uncorrected": "p_uncorrected"}
    for row in ORACLE[key][factor]["pairs"]:
        first, second = (part.removeprefix(factor) for part in row["contrast"].split(" - "))
        labels = {str(level).removesuffix(".0"): level for level in plates[IN_R[factor]].unique()}
        pair, sign = (labels[first], labels[second]), 1
        if pair not in found.index:
            pair, sign = pair[::-1], -1
        own = found.loc[pair]
        for name, in_r in names.items():
            factor_sign = sign if name in ("difference", "t") else 1
            np.testing.assert_allclose(own[name] * factor_sign, row[in_r], rtol=1e-9, err_msg=name)
        interval = sorted(sign * own[["ci_low", "ci_high"]].to_numpy(float))
        np.testing.assert_allclose(interval, (row["low"], row["high"]), rtol=1e-9)
        means = dict(zip(levels, ORACLE[key][factor]["means"], strict=True))
        first_mean = own["mean_first"] if sign == 1 else own["mean_second"]
        expected = means[str(labels[first])]["emmean"]
        assert first_mean == pytest.approx(expected, rel=1e-9)


def test_box_cox_finds_the_exponent_that_r_finds(plates):
    found = box_cox(plates["rmse"].to_numpy())
    # R's optimiser stops at about 1e-6; the likelihood is flat there
    assert found.exponent == pytest.approx(ORACLE["box_cox_lambda"], abs=1e-5)
    best = stats.boxcox_llf(found.exponent, plates["rmse"])
    for end in (found.exponent_low, found.exponent_high):
        drop = best - stats.boxcox_llf(end, plates["rmse"])
        assert drop == pytest.approx(stats.chi2.ppf(0.95, 1) / 2, rel=1e-4)


@given(seed=st.integers(0, 10**6), count=st.integers(4, 60), spread=st.floats(0.2, 2.0))
@settings(deadline=None, max_examples=15)
def test_box_cox_of_any_values_equals_scipys(seed, count, spread):
    values = np.exp(np.random.default_rng(seed).normal(1, spread, count))
    found = box_cox(values)
    transformed, exponent, ends = stats.boxcox(values, alpha=0.05)
    own = (found.exponent, found.exponent_low, found.exponent_high)
    np.testing.assert_allclose(own, (exponent, *ends), atol=1e-5 * np.ptp(ends))
    np.testing.assert_allclose(found.values, special.boxcox(values, found.exponent))
    np.testing.assert_allclose(
        found.values, transformed, rtol=1e-4, atol=1e-4 * np.std(transformed)
    )


def test_box_cox_of_values_that_are_symmetric_about_their_product_is_the_logarithm():
    found = box_cox(np.array([0.25, 0.5, 1, 2, 4]))
    assert found.exponent == pytest.approx(0, abs=1e-6)
    assert found.exponent_low == pytest.approx(-found.exponent_high)


@pytest.mark.parametrize("spread", [1e-2, 1e-4, 1e-6])
def test_values_that_hardly_vary_have_an_exponent_and_a_wide_interval(spread):
    """About 1, yᵡ is exp(λ ln y): the interval is as wide as the logarithms are narrow."""
    drawn = np.random.default_rng(4).normal(size=40)
    wide, narrow = (box_cox(np.exp(size * drawn)) for size in (1.0, spread))
    for name in ("exponent", "exponent_low", "exponent_high"):
        assert getattr(narrow, name) == pytest.approx(getattr(wide, name) / spread, rel=1e-4)


def test_box_cox_of_a_log_normal_sample_is_close_to_the_logarithm():
    values = np.exp(np.random.default_rng(0).normal(1, 0.6, 2000))
    found = box_cox(values)
    assert found.exponent_low < 0 < found.exponent_high
    assert stats.skew(found.values) == pytest.approx(0, abs=0.1)


def test_the_order_of_the_factors_does_not_matter(plates):
    one = anova(plates, "rmse", FACTORS, interactions=False).set_index("effect")
    other = anova(plates, "rmse", FACTORS[::-1], interactions=False).set_index("effect")
    pd.testing.assert_frame_equal(one, other.loc[one.index])


def test_two_groups_are_the_two_sample_t_test():
    rng = np.random.default_rng(1)
    data = pd.DataFrame({"duration_s": [60] * 6 + [300] * 9, "rms": rng.normal(size=15)})
    expected = stats.ttest_ind(data["rms"][:6], data["rms"][6:])
    (pair,) = compare_levels(data, "rms", ["duration_s"], "duration_s").to_dict("records")
    assert (pair["t"], pair["p_bonferroni"]) == pytest.approx(tuple(expected))
    assert anova(data, "rms", ["duration_s"])["p"][0] == pytest.approx(expected.pvalue)


def test_a_factor_within_blocks_is_tested_as_in_a_randomised_block_design():
    """Sums of squares by their definition; what blocks differ by is not in the error."""
    rng = np.random.default_rng(2)
    y = rng.normal(size=(9, 3)) + 100 * rng.normal(size=(9, 1)) + [0.0, 0.5, 1.0]
    block, place = np.indices(y.shape).reshape(2, -1)
    data = pd.DataFrame({"block": block, "place": place, "y": y.ravel()})
    fitted = y.mean(axis=1, keepdims=True) + y.mean(axis=0) - y.mean()
    error = np.sum((y - fitted) ** 2)
    f = 9 * np.sum((y.mean(axis=0) - y.mean()) ** 2) / 2 / (error / 16)
    found = anova(data, "y", ["block", "place"]).set_index("effect")
    assert found["f"]["place"] == pytest.approx(f)
    assert found["p"]["place"] == pytest.approx(stats.f.sf(f, 2, 16))
    np.testing.assert_allclose(
        residuals(data, "y", ["block", "place"]), (y - fitted).ravel(), atol=1e-10
    )


def test_two_places_within_blocks_are_the_paired_t_test():
    rng = np.random.default_rng(3)
    y = rng.normal(size=(12, 2)) + rng.normal(size=(12, 1))
    block, place = np.indices(y.shape).reshape(2, -1)
    data = pd.DataFrame({"block": block, "place": place, "y": y.ravel()})
    found = anova(data, "y", ["block", "place"]).set_index("effect")
    assert found["p"]["place"] == pytest.approx(stats.ttest_rel(y[:, 0], y[:, 1]).pvalue)


def test_adding_a_constant_to_one_level_moves_only_its_marginal_mean(plates):
    before = compare_levels(plates, "rmse", FACTORS, "position")
    plates["rmse"] += 3.0 * (plates["position"] == "back")
    after = compare_levels(plates, "rmse", FACTORS, "position")
    shift = (after["difference"] - before["difference"]).to_list()
    assert shift == pytest.approx([3, 3, 0])  # back - front, back - middle, front - middle
    np.testing.assert_allclose(after["standard_error"], before["standard_error"])


@pytest.mark.parametrize("values", [[1.0, 0, 2], [1.0, -1, 2], [1.0, np.nan, 2], [2.0, 2, 2]])
def test_box_cox_refuses_values_without_a_power_transform(values):
    with pytest.raises(ValueError, match="needs"):
        box_cox(np.array(values))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[t["position"] == "back"], "'position' has one level only"),
        (lambda t: t.assign(rmse=t["rmse"].where(t["rmse"] > 2)), "'rmse' is missing at"),
        (lambda t: t.assign(position=t["position"].where(t["rmse"] > 2)), "a level is missing"),
        (
            lambda t: t[(t["position"] != "back") | (t["speed_m_s"] != 0.3)],
            "combination of levels was never measured",
        ),
        (lambda t: t.drop_duplicates(FACTORS), "too few"),
        (lambda t: t.assign(rmse=t["speed_m_s"]), "no error"),
    ],
)
def test_a_design_that_cannot_be_analysed_is_refused_with_a_reason(plates, change, message):
    with pytest.raises(ValueError, match=message):
        anova(change(plates), "rmse", FACTORS, interactions=True)


def test_a_comparison_of_levels_names_a_factor_of_the_model(plates):
    with pytest.raises(ValueError, match="'support' is not one of the factors"):
        compare_levels(plates, "rmse", FACTORS, "support")
