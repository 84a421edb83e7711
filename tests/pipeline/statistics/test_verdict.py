"""A verdict says whether residuals are within the margin, above it, or neither is shown."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3
from pipeline.statistics.mixed import judging_comparison
from pipeline.statistics.verdict import (
    Verdict,
    headlines,
    noninferiority_power,
    subjects_needed,
    verdicts,
)
from tests.pipeline.statistics.shared_errors import covariances

CONDITIONS = ("baseline", "sway", "pitch")


def residuals(cells, axis="Fx"):
    """Lay out {(condition, compensated): values of the subjects} as a long table."""
    return pd.DataFrame(
        {
            "subject": f"s{k}",
            "condition": condition,
            "compensated": compensated,
            "axis": axis,
            "unit": "N",
            "rms": float(value),
        }
        for (condition, compensated), values in cells.items()
        for k, value in enumerate(values)
        if value is not None
    )


def study(excess, spread, n=9, seed=0):
    """Nine subjects whose compensated sway is above baseline by `excess` ± `spread`."""
    rng = np.random.default_rng(seed)
    baseline = rng.normal(40, 5, n)
    cells = {(c, ic): baseline + rng.normal(0, 1, n) for c in CONDITIONS for ic in (False, True)}
    cells["baseline", False] = baseline
    cells["sway", False] = baseline + 400
    cells["sway", True] = np.abs(baseline + excess + rng.normal(0, spread, n))
    return residuals(cells)


def sway(table):
    return next(v for v in verdicts(table) if v.condition == "sway")


def test_a_residual_that_returns_to_baseline_is_within_the_margin():
    assert sway(study(excess=0.5, spread=1)).answer == "within margin"


def test_a_residual_that_stays_far_above_baseline_is_above():
    verdict = sway(study(excess=30, spread=2))
    assert verdict.answer == "above"
    assert verdict.difference == pytest.approx(30, abs=2)
    assert verdict.percent(verdict.difference) == pytest.approx(75, abs=12)


def test_a_difference_that_is_not_significant_does_not_show_equality():
    table = study(excess=3, spread=25)
    tests = statistics(table)
    pair = tests[(tests["effect"] == "sway IC - baseline no IC") & (tests["test"] == "paired t")]
    assert (pair["p_corrected"] > 0.05).all()
    assert sway(table).answer == "inconclusive"


def test_a_residual_below_baseline_is_within_the_margin():
    verdict = sway(study(excess=-15, spread=1))
    assert verdict.answer == "within margin"
    assert verdict.high < 0


def test_a_significant_increase_below_the_margin_is_within_the_margin():
    verdict = sway(study(excess=3, spread=0.5))
    assert verdict.low > 0
    assert verdict.answer == "within margin"


@settings(max_examples=25)
@given(
    excess=st.floats(-20, 40), spread=st.floats(0.5, 30), n=st.integers(2, 12), seed=st.integers(0)
)
def test_the_interval_agrees_with_the_corrected_tests(excess, spread, n, seed):
    table = study(excess, spread, n, seed)
    verdict = sway(table)
    cells = table.pivot(index="subject", columns=["condition", "compensated"], values="rms")
    difference = cells["sway", True] - cells["baseline", False]
    p = stats.ttest_1samp(difference, 0).pvalue
    assert (verdict.low > 0 or verdict.high < 0) == (5 * p < 0.05)
    excess = cells["sway", True] - (1 + EXPERIMENT_3.margin) * cells["baseline", False]
    one_sided = stats.ttest_1samp(excess, 0, alternative="less").pvalue
    bounded = np.isfinite(verdict.high_percent)
    assert (verdict.answer == "within margin") == (one_sided <= 0.05 / 5 / 2 and bounded)


def test_one_subject_has_means_but_no_interval():
    verdict = sway(study(excess=1, spread=1, n=1))
    assert verdict.answer == "no interval"
    assert np.isnan(verdict.high)
    assert verdict.difference == pytest.approx(verdict.ic - verdict.baseline)


def test_only_subjects_with_both_cells_are_compared():
    cells = {
        ("baseline", False): [40, 41, 42, None],
        ("sway", True): [44, 44, None, 90],
        ("sway", False): [400, None, 420, 430],
    }
    verdict = sway(residuals(cells))
    assert verdict.n == 2
    assert verdict.baseline == pytest.approx(40.5)
    assert verdict.difference == pytest.approx(3.5)
    assert np.isnan(verdict.no_ic)  # one of the two lacks it: no mean over other people


def test_missing_cells_give_no_verdict():
    cells = {("baseline", False): [40, 41], ("sway", False): [400, 410]}
    assert {v.answer for v in verdicts(residuals(cells))} == {"no data"}


def ratio_interval(first, second, alpha):
    """The interval of the ratio of the means of paired values."""
    cells = [("a", first), ("b", second)]
    rows = [
        {"subject": f"s{k}", "recording": cell, "cell": cell, "value": value}
        for cell, values in cells
        for k, value in enumerate(values)
    ]
    return judging_comparison(pd.DataFrame(rows), "a", "b").ratio_interval(alpha)


@given(seed=st.integers(0, 10_000), n=st.integers(3, 12), alpha=st.sampled_from([0.01, 0.05]))
@settings(max_examples=25)
def test_a_ratio_is_in_its_interval_where_a_paired_t_test_does_not_refuse_it(seed, n, alpha):
    rng = np.random.default_rng(seed)
    second = rng.normal(40, 4, n)
    first = 0.5 * second + rng.normal(20, 4, n)
    low, high = ratio_interval(first, second, alpha)
    for ratio in np.linspace(0.6, 1.6, 21):
        p = stats.ttest_1samp(first - ratio * second, 0).pvalue
        if np.isfinite(low) and min(abs(ratio - low), abs(ratio - high)) > 1e-9:
            assert (low < ratio < high) == (p > alpha)


def test_the_interval_of_a_ratio_is_fiellers():
    first, second = np.array([11.0, 12, 13]), np.array([10.0, 11, 12])
    critical = stats.t.isf(0.025, 2) ** 2 * np.cov(first, second) / 3
    a, b = second.mean() ** 2 - critical[1, 1], first.mean() * second.mean() - critical[0, 1]
    c = first.mean() ** 2 - critical[0, 0]
    expected = np.sort(np.roots([a, -2 * b, c]))
    assert ratio_interval(first, second, 0.05) == pytest.approx(expected)


def test_a_ratio_to_what_may_be_zero_has_no_bounds():
    bounds = ratio_interval(np.array([1.0, 2, 3]), np.array([-4.0, 1, 5]), 0.05)
    assert bounds == (-np.inf, np.inf)


def with_errors(table, level, of_sway, of_others):
    """The verdict on sway with an error that changes each value by so much."""
    change = np.where(table["condition"] == "sway", of_sway, of_others)
    found = verdicts(table, measurement=covariances(table, level, change))
    return next(v for v in found if v.condition == "sway")


def test_an_error_of_the_laboratory_is_as_large_in_the_difference_as_its_changes_differ():
    verdict = with_errors(study(excess=8, spread=1), "laboratory", 3.0, 1.0)
    half = (verdict.measurement[1] - verdict.measurement[0]) / 2
    assert half == pytest.approx(1.96 * 2, rel=1e-3)
    assert verdict.measurement[1] - half == pytest.approx(verdict.difference)


def test_no_answer_depends_on_errors_of_measurement():
    for excess in (0.5, 7, 30):
        table = study(excess, spread=2)
        assert with_errors(table, "laboratory", 20.0, 0.0).answer == sway(table).answer
        assert sway(table).measurement is None


@pytest.mark.parametrize(
    ("excess", "contained"), [(0, False), (6, True), (8, True), (10, True), (18, False)]
)
def test_the_margin_is_in_the_interval_where_errors_move_the_mean_beyond_it(excess, contained):
    verdict = with_errors(study(excess, spread=0.5), "laboratory", 2.0, 0.0)
    moved = [verdict.ic + sign * 1.96 * 2.0 for sign in (-1, 1)]
    beyond = [value > 1.2 * verdict.baseline for value in moved]
    assert verdict.open_margin == (beyond == [False, True])
    assert verdict.open_margin == contained


def test_an_error_that_scales_all_values_never_turns_a_verdict():
    table = study(excess=8, spread=1)
    found = verdicts(table, measurement=covariances(table, "laboratory", 0.2 * table["rms"]))
    own = next(v for v in found if v.condition == "sway")
    assert not own.open_margin
    assert own.measurement[0] < own.difference < own.measurement[1]


def test_one_subject_has_an_interval_of_measurement():
    verdict = with_errors(study(excess=1, spread=1, n=1), "trial", 3.0, 4.0)
    assert verdict.answer == "no interval"
    half = (verdict.measurement[1] - verdict.measurement[0]) / 2
    assert half == pytest.approx(1.96 * 5, rel=1e-3)


def test_no_residual_is_within_the_margin_where_its_ratio_to_baseline_is_unbounded():
    """The excess over 120 % of baseline is −5 N in both subjects, but baseline may be zero."""
    baseline = np.array([10.0, 22.0])
    cells = {(c, ic): 1.2 * baseline - 5 for c in CONDITIONS for ic in (False, True)}
    verdict = sway(residuals(cells | {("baseline", False): baseline}))
    assert verdict.answer == "inconclusive"
    assert verdict.written_percent().endswith("[unbounded]")


@pytest.mark.parametrize(("subjects", "few"), [(9, False), (2, True)])
def test_the_headline_gives_every_residual_its_interval_in_percent(subjects, few):
    answers = {"Fx": "within margin", "Fy": "above", "Fz": "above", "Mx": "inconclusive"}
    sizes = {"baseline": 10.0, "difference": -1.26, "low_percent": -30.4, "high_percent": 5.2}
    found = [
        Verdict(axis, "N", "sway", answer, n=subjects, **sizes) for axis, answer in answers.items()
    ]
    compared, sway, *demonstration = headlines(found)
    assert "baseline" in compared
    size = re.escape("(−13 % [−30, +5], −1.3 N)")
    within, above, unclear = sway.split("; ")
    assert re.match(rf"In sway, Fx {size} .*not more .*20 %", within)
    assert re.match(rf"Fy {size} and Fz {size} .*above", above)
    assert re.match(rf"Mx {size} .*inconclusive", unclear)
    assert bool(demonstration) == few


ALPHA = 0.05 / 5 / 2
"""One side of a simultaneous interval over five pairs."""


def simulated_power(n, sd, mean, margin, alpha, studies=20_000):
    """Share of simulated studies whose upper confidence bound is at most the margin."""
    differences = np.random.default_rng(n).normal(mean, sd, (studies, n))
    half = stats.t.ppf(1 - alpha, n - 1) * stats.sem(differences, axis=1)
    return float(np.mean(differences.mean(axis=1) + half <= margin))


@pytest.mark.parametrize(("sd", "mean"), [(3.0, 0.0), (6.0, 3.0), (12.0, -2.0)])
def test_the_number_has_80_percent_power_in_simulated_studies_and_one_less_has_not(sd, mean):
    margin = 8.0
    n = subjects_needed(sd, margin - mean, ALPHA)
    error = 3 * np.sqrt(0.8 * 0.2 / 20_000)
    assert simulated_power(n, sd, mean, margin, ALPHA) >= 0.8 - error
    assert simulated_power(n - 1, sd, mean, margin, ALPHA) < 0.8 + error
    assert noninferiority_power(np.array([n - 1]), sd, margin - mean, ALPHA) < 0.8


@given(
    st.integers(2, 60),
    st.floats(0.5, 20),
    st.floats(0.5, 20),
)
@settings(max_examples=50)
def test_power_grows_with_subjects_and_room_and_falls_with_variance(n, sd, room):
    power = noninferiority_power(np.array(n), sd, room, ALPHA)
    assert 0 <= power <= 1
    rounding = 1e-9
    assert noninferiority_power(np.array(n + 1), sd, room, ALPHA) >= power - rounding
    assert noninferiority_power(np.array(n), sd, 1.1 * room, ALPHA) >= power - rounding
    assert noninferiority_power(np.array(n), 1.1 * sd, room, ALPHA) <= power + rounding


@given(st.floats(0.05, 20), st.floats(0.05, 20), st.floats(1, 1000))
@settings(max_examples=50)
def test_the_unit_is_irrelevant(sd, room, unit):
    assert subjects_needed(sd, room, ALPHA) == subjects_needed(unit * sd, unit * room, ALPHA)


def test_no_number_shows_a_difference_that_exceeds_the_margin():
    assert subjects_needed(1.0, 0.0, ALPHA) is None
    assert subjects_needed(1.0, -1.0, ALPHA) is None
    assert subjects_needed(100.0, 1.0, ALPHA) is None  # more than a thousand


@pytest.mark.parametrize("sd", [0.0, 1e-300, 1e-4])
def test_subjects_who_all_agree_need_two(sd):
    assert subjects_needed(sd, 1.0, ALPHA) == 2
