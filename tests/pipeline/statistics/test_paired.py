"""Paired comparisons are those of R, of SPSS in the thesis, and of pingouin."""

import numpy as np
import pingouin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.paired import compare_paired
from tests.pipeline.statistics.fixtures import ORACLE, STUDY

COLUMNS = {
    "IC - no IC, baseline": ("ic_baseline", "no_ic_baseline"),
    "IC - no IC, sway": ("ic_sway", "no_ic_sway"),
    "IC - no IC, pitch": ("ic_pitch", "no_ic_pitch"),
    "sway IC - baseline no IC": ("ic_sway", "no_ic_baseline"),
    "pitch IC - baseline no IC": ("ic_pitch", "no_ic_baseline"),
}


def ranks_with_sum(w, n=9):
    """Give differences whose smaller sum of signed ranks is w."""
    ranks, signs = np.arange(n, 0, -1), np.ones(n)
    for index, rank in enumerate(ranks):
        if rank <= w:
            signs[index], w = -1, w - rank
    assert w == 0
    return ranks * signs


@pytest.mark.parametrize("pair", COLUMNS)
def test_a_planned_pair_equals_r(pair):
    first, second = COLUMNS[pair]
    found, expected = compare_paired(STUDY[first] - STUDY[second]), ORACLE["pairs"][pair]
    assert found.t == pytest.approx(expected["t"], rel=1e-9)
    assert found.p_t == pytest.approx(expected["p_t"], rel=1e-9)
    assert found.p_exact == pytest.approx(expected["p_wilcoxon_exact"], rel=1e-9)
    assert found.p_asymptotic == pytest.approx(expected["p_wilcoxon_asymptotic"], rel=1e-9)
    mean = (found.mean.value, found.mean.low, found.mean.high)
    np.testing.assert_allclose(mean, (expected["mean"], *expected["mean_ci"]), rtol=1e-9)
    dz = (found.dz.value, found.dz.low, found.dz.high)
    np.testing.assert_allclose(dz, list(expected["dz"].values()), rtol=1e-9)  # R stops at 1e-12


@pytest.mark.parametrize(
    ("w", "printed"),
    [(0, 0.040), (7, 0.330), (11, 0.865)],
)
def test_the_thesis_column_is_five_times_the_asymptotic_p_to_three_decimals(w, printed):
    found = compare_paired(ranks_with_sum(w))
    assert found.w == w
    assert 5 * round(found.p_asymptotic, 3) == pytest.approx(printed, abs=1e-12)


@pytest.mark.parametrize(("w", "corrected"), [(0, 0.0195), (1, 0.0391)])
def test_exact_p_makes_the_near_misses_of_the_thesis_significant(w, corrected):
    assert 5 * compare_paired(ranks_with_sum(w)).p_exact == pytest.approx(corrected, abs=5e-5)


@given(st.integers(0, 10_000), st.integers(4, 30))
@settings(max_examples=20)
def test_scipy_and_pingouin_agree(seed, n):
    differences = np.random.default_rng(seed).normal(0.4, size=n)
    found = compare_paired(differences)
    t = stats.ttest_1samp(differences, 0)
    exact = stats.wilcoxon(differences, method="exact")
    asymptotic = stats.wilcoxon(differences, method="asymptotic", correction=False)
    assert (found.t, found.p_t) == pytest.approx((t.statistic, t.pvalue))
    assert (found.w, found.p_exact) == pytest.approx((exact.statistic, exact.pvalue))
    assert found.p_asymptotic == pytest.approx(asymptotic.pvalue)
    biserial = pingouin.wilcoxon(differences)["RBC"].iloc[0]
    assert found.rank_biserial == pytest.approx(biserial)


def test_with_ties_the_exact_p_is_the_share_of_all_sign_patterns():
    differences = np.array([1.0, 1, -1, 2, 2, -3, 0])
    ranks = stats.rankdata(np.abs(differences[differences != 0]))
    signs = 1 - 2 * (np.arange(64)[:, None] >> np.arange(6) & 1)
    sums = np.abs(signs @ ranks)
    observed = abs(np.sign(differences[differences != 0]) @ ranks)
    assert compare_paired(differences).p_exact == pytest.approx(np.mean(sums >= observed - 1e-9))


def test_differences_equal_but_for_rounding_are_ties():
    first, second = np.array([0.3, 0.5, 0.9, 0.8]), np.array([0.1, 0.3, 0.2, 0.8])
    assert len(set(np.abs(first - second))) == 4  # 0.2 twice, to the last bit not
    exact = compare_paired(np.array([2.0, 2, 7, 0]))
    assert compare_paired(first - second).p_asymptotic == pytest.approx(exact.p_asymptotic)


@given(st.integers(0, 10_000), st.floats(0.01, 1000))
@settings(max_examples=10)
def test_changing_the_unit_scales_the_estimates_and_nothing_else(seed, unit):
    differences = np.random.default_rng(seed).normal(0.4, size=9)
    one, other = compare_paired(differences), compare_paired(unit * differences)
    assert (other.p_t, other.p_exact, other.dz.low) == pytest.approx(
        (one.p_t, one.p_exact, one.dz.low)
    )
    assert other.mean.low == pytest.approx(unit * one.mean.low)


def test_reversing_the_comparison_reverses_every_sign():
    differences = np.random.default_rng(0).normal(1, size=9)
    one, other = compare_paired(differences), compare_paired(-differences)
    for name in ("mean", "dz", "g"):
        left, right = getattr(one, name), getattr(other, name)
        assert (left.value, left.low, left.high) == pytest.approx(
            (-right.value, -right.high, -right.low)
        )
    assert one.rank_biserial == pytest.approx(-other.rank_biserial)


@pytest.mark.campaign
@pytest.mark.parametrize("mean", [0.0, -3.0])
def test_the_interval_of_dz_covers_the_true_value_at_its_nominal_rate(mean):
    rng = np.random.default_rng(1)
    covered = sum(
        found.dz.low < mean < found.dz.high
        for found in (compare_paired(rng.normal(mean, 1, 9)) for _ in range(400))
    )
    assert stats.binomtest(covered, 400, 0.95).pvalue > 0.001


def test_hedges_g_has_no_bias_where_dz_has():
    rng = np.random.default_rng(2)
    samples = rng.normal(1, 1, (20_000, 9))
    dz = samples.mean(axis=1) / samples.std(axis=1, ddof=1)
    one = compare_paired(samples[0])
    bias = one.g.value / one.dz.value
    assert bias * dz.mean() == pytest.approx(1, abs=0.02)
    assert dz.mean() > 1.08


@pytest.mark.parametrize("mean", [1e2, -1e8])
def test_enormous_effects_give_numbers_or_nan_but_no_error(mean):
    found = compare_paired(np.random.default_rng(3).normal(mean, 1, 9))
    assert np.sign(found.dz.value) == np.sign(mean)
    assert not found.dz.low > found.dz.value


def test_differences_that_are_all_the_same_have_no_t():
    found = compare_paired(np.full(4, 0.1) + 0.2)
    assert np.isnan([found.t, found.p_t, found.dz.value, found.g.value]).all()
    assert found.p_exact == 2 / 2**4


def test_differences_that_are_all_zero_have_no_test_at_all():
    found = compare_paired(np.zeros(4))
    assert np.isnan([found.t, found.w, found.p_exact, found.rank_biserial]).all()
    assert found.mean.value == 0
