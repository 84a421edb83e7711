"""Sign flips, aligned ranks and concordance against R and their invariances."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pingouin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.nonparametric import aligned_ranks, kendalls_w, sign_flip
from pipeline.statistics.rm_glm import repeated_measures_glm

FIXTURES = Path(__file__).parents[1] / "fixtures" / "statistics"
ORACLE = json.loads((FIXTURES / "oracle.json").read_text())
EFFECTS = {"a": (True, False), "b": (False, True), "a:b": (True, True)}


def paired(differences):
    return np.column_stack([differences, np.zeros(len(differences))])


@pytest.fixture
def tooth():
    return pd.read_csv(FIXTURES / "toothgrowth.csv").to_numpy().reshape(10, 2, 3)


@pytest.mark.parametrize("effect", EFFECTS)
def test_sign_flips_give_the_share_that_r_counts_over_all_patterns(tooth, effect):
    found = sign_flip(tooth, EFFECTS[effect])
    assert found.p == ORACLE["flips"][effect]
    assert (found.patterns, found.exact) == (512, True)


def test_nine_subjects_who_all_agree_give_the_smallest_p_there_is():
    differences = np.arange(1.0, 10)
    assert sign_flip(paired(differences), (True,)).p == 2 / 2**9


def test_sign_flips_of_one_contrast_are_scipys_permutation_test():
    differences = np.random.default_rng(0).normal(0.5, size=8)
    expected = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", n_resamples=np.inf
    )
    assert sign_flip(paired(differences), (True,)).p == pytest.approx(expected.pvalue)


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=10)
def test_sign_flips_do_not_depend_on_the_unit_or_the_order_of_levels_or_subjects(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(7, 2, 3))
    other = 1000 * values[rng.permutation(7)][:, ::-1][:, :, rng.permutation(3)]
    for tested in EFFECTS.values():
        assert sign_flip(other, tested).p == sign_flip(values, tested).p


def test_an_effect_that_is_zero_but_for_rounding_is_not_significant():
    values = np.tile(0.1 + np.arange(9.0)[:, None, None], (1, 2, 3))
    for tested in EFFECTS.values():
        assert sign_flip(values, tested).p == 1


def test_more_subjects_than_can_be_listed_are_sampled_with_the_same_answer():
    differences = np.random.default_rng(1).normal(0.35, size=25)
    sampled = sign_flip(paired(differences), (True,))
    assert not sampled.exact
    assert sampled.p == pytest.approx(stats.ttest_1samp(differences, 0).pvalue, abs=0.02)
    assert sampled == sign_flip(paired(differences), (True,))


def test_sign_flips_reject_at_the_nominal_rate_where_there_is_no_effect():
    rng = np.random.default_rng(2)
    p = [sign_flip(rng.standard_t(3, size=(7, 3)), (True,)).p for _ in range(400)]
    rejected = np.count_nonzero(np.array(p) <= 0.05)
    assert stats.binomtest(rejected, 400, 0.05).pvalue > 0.001


def test_a_sign_flip_needs_two_subjects():
    with pytest.raises(ValueError, match="at least 2 subjects, got 1"):
        sign_flip(np.ones((1, 2)), (True,))


@pytest.mark.parametrize("effect", EFFECTS)
def test_aligned_ranks_give_the_f_of_an_independent_analysis_in_r(tooth, effect):
    ranks = aligned_ranks(tooth, EFFECTS[effect])
    terms = repeated_measures_glm(ranks, "ab")
    term = next(term for term in terms if ":".join(term.within) == effect)
    np.testing.assert_allclose((term.f, term.p), ORACLE["aligned"][effect], rtol=1e-9)


def test_other_effects_do_not_reach_the_aligned_ranks(tooth):
    shifted = tooth + np.array([0.0, 40.0])[:, None] + np.array([0.0, 5.0, -20.0])
    np.testing.assert_array_equal(
        aligned_ranks(shifted, (True, True)), aligned_ranks(tooth, (True, True))
    )


def test_kendalls_w_corrects_for_ties_as_r():
    ratings = pd.read_csv(FIXTURES / "ratings.csv").to_numpy()
    expected = ORACLE["ratings"]
    found = kendalls_w(ratings)
    np.testing.assert_allclose(found, (expected["w"], expected["chi2"], expected["p"]), rtol=1e-9)
    assert found[0] == pytest.approx(pingouin.friedman(pd.DataFrame(ratings))["W"].iloc[0])


def test_judges_who_agree_are_concordant_and_judges_without_preference_have_no_concordance():
    assert kendalls_w(np.tile([1.0, 2, 3, 4], (5, 1)))[0] == pytest.approx(1)
    assert np.isnan(kendalls_w(np.ones((5, 4)))).all()


@pytest.mark.parametrize("shape", [(1, 4), (4, 2)])
def test_concordance_needs_judges_and_items(shape):
    with pytest.raises(ValueError, match="at least 2 judges and 3 items"):
        kendalls_w(np.ones(shape))
