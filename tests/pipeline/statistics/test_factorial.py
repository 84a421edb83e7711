"""Factorial analysis of variance and marginal means are those of R's car and emmeans."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pipeline.statistics.factorial import anova, compare_levels, residuals
from tests.pipeline.statistics.fixtures import FIXTURES, ORACLE

FACTORS = ["speed_m_s", "position", "weight_kg"]
IN_R = {"speed": "speed_m_s", "position": "position", "weight": "weight_kg"}


@pytest.fixture
def plates():
    """Three factors, one to three trials in a cell."""
    table = pd.read_csv(FIXTURES / "plates.csv")
    return table.assign(log_rmse=np.log(table["rmse"]))


def test_an_unbalanced_three_way_design_equals_car_anova_type_3(plates):
    found = anova(plates, "log_rmse", FACTORS).set_index("effect")
    rows = {row["term"]: row for row in ORACLE["anova_main"]}
    assert len(found) == len(rows) - 1  # R tests the intercept too
    for term, row in rows.items():
        if term in ("(Intercept)", "Residuals"):
            continue
        own = found.loc[":".join(IN_R[name] for name in term.split(":"))]
        for name in ("ss", "df", "f", "p"):
            np.testing.assert_allclose(own[name], row[name], rtol=1e-9, err_msg=f"{term} {name}")
    assert found.loc["residual", "ss"] == pytest.approx(rows["Residuals"]["ss"])
    assert found.loc["residual", "df"] == rows["Residuals"]["df"]


@pytest.mark.parametrize("factor", ["speed", "position", "weight"])
def test_marginal_means_and_their_bonferroni_pairs_equal_emmeans(plates, factor):
    found = compare_levels(plates, "log_rmse", FACTORS, IN_R[factor])
    found = found.set_index(["first", "second"])
    levels = [str(level) for level in plates[IN_R[factor]].unique()]
    names = {"difference": "difference", "standard_error": "se", "t": "t", "df": "df"}
    names |= {"p_bonferroni": "p", "p_uncorrected": "p_uncorrected"}
    for row in ORACLE["marginal_main"][factor]["pairs"]:
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
        means = dict(zip(levels, ORACLE["marginal_main"][factor]["means"], strict=True))
        first_mean = own["mean_first"] if sign == 1 else own["mean_second"]
        expected = means[str(labels[first])]["emmean"]
        assert first_mean == pytest.approx(expected, rel=1e-9)


def test_the_order_of_the_factors_does_not_matter(plates):
    one = anova(plates, "rmse", FACTORS).set_index("effect")
    other = anova(plates, "rmse", FACTORS[::-1]).set_index("effect")
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


def test_adding_a_constant_to_one_level_moves_only_its_marginal_mean(plates):
    before = compare_levels(plates, "rmse", FACTORS, "position")
    plates["rmse"] += 3.0 * (plates["position"] == "back")
    after = compare_levels(plates, "rmse", FACTORS, "position")
    shift = (after["difference"] - before["difference"]).to_list()
    assert shift == pytest.approx([3, 3, 0])  # back - front, back - middle, front - middle
    np.testing.assert_allclose(after["standard_error"], before["standard_error"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[t["position"] == "back"], "'position' has one"),
        (lambda t: t.assign(position=t["speed_m_s"].map("at {} m/s".format)), "never measured"),
        (lambda t: t.assign(rmse=t["speed_m_s"]), "no error"),
    ],
)
def test_a_design_that_cannot_be_analysed_is_refused_with_a_reason(plates, change, message):
    with pytest.raises(ValueError, match=message):
        anova(change(plates), "rmse", FACTORS)
