"""Where curves differ has an exact p and as many false alarms as stated, within bands that hold."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from pipeline.statistics.curves import compare_conditions, compare_groups
from pipeline.statistics.mixed import compare_cells

BUMP = np.exp(-(((np.arange(101) - 50) / 12) ** 2))


def smooth(rng, *shape, sigma=6):
    """Noise over the gait cycle that varies as residuals do, of unit variance."""
    margin = 4 * sigma
    noise = gaussian_filter1d(rng.normal(size=(*shape, 101 + 2 * margin)), sigma, axis=-1)
    return noise[..., margin : margin + 101] * np.sqrt(2 * np.sqrt(np.pi) * sigma)


def paired(differences):
    """Curves of which the first minus the second condition are given, a subject each."""
    count = len(differences)
    of_subjects = smooth(np.random.default_rng(99), count)
    rows = pd.DataFrame({"subject": [f"s{k:02}" for k in range(count)] * 2})
    rows["cell"] = ["boots"] * count + ["barefoot"] * count
    return np.vstack([of_subjects + differences, of_subjects]), rows.assign(recording=rows["cell"])


def study(rng, people, *, missing=0.0, most=1, deviations=1.0, sigma=6):
    """Recordings of two conditions without a difference, some of them missing.

    Errors of the subject, of the subject's condition and, of several, of the recording.
    """
    count = rng.integers(1, most + 1, size=(people, 2, 1))
    kept = (np.arange(3) < count) & (rng.random((people, 2, 1)) >= missing)
    curves = smooth(rng, people, 1, 1, sigma=sigma) + 0.7 * smooth(rng, people, 2, 1, sigma=sigma)
    curves = curves + 0.7 * (most > 1) * smooth(rng, people, 2, 3, sigma=sigma)
    curves = curves * np.broadcast_to(deviations, people)[:, None, None, None]
    subject, cell, recording = np.nonzero(kept)
    rows = pd.DataFrame({"subject": subject.astype(str), "cell": np.array(["a", "b"])[cell]})
    return curves[kept], rows.assign(recording=3 * cell + recording)


def by_hand(differences):
    """p of every instant by the definition, one change of signs after the other."""
    count = len(differences)

    def t(values):
        return np.abs(values.mean(axis=0)) / values.std(axis=0, ddof=1) * np.sqrt(count)

    observed = t(differences)
    reached = np.zeros(len(observed))
    for signs in product((1, -1), repeat=count):
        reached += t(differences * np.array(signs)[:, None]).max() >= observed - 1e-9
    return reached / 2**count


def test_of_complete_pairs_p_is_the_share_of_changes_of_signs_that_reach_it():
    differences = smooth(np.random.default_rng(1), 7) + np.linspace(0, 3, 101)
    compared = compare_conditions(*paired(differences))
    np.testing.assert_allclose(compared.p, by_hand(differences), atol=1e-12)
    np.testing.assert_allclose(compared.difference, differences.mean(axis=0), atol=1e-12)
    shown = [percent for part in compared.parts for percent in range(part.start, part.stop + 1)]
    np.testing.assert_array_equal(shown, np.flatnonzero(by_hand(differences) < 0.05))


def test_of_equally_many_recordings_p_is_that_of_the_means_of_subjects():
    differences = smooth(np.random.default_rng(2), 8, 2) + BUMP
    first, second = (paired(differences[:, k]) for k in range(2))
    curves = np.vstack([first[0], second[0]])
    rows = pd.concat([first[1], second[1].assign(recording=second[1]["recording"] + "2")])
    compared = compare_conditions(curves, rows.reset_index(drop=True))
    np.testing.assert_allclose(compared.p, by_hand(differences.mean(axis=1)), atol=1e-12)
    assert (compared.subjects, compared.recordings) == (8, 32)


def test_groups_and_covariates_of_complete_pairs_change_nothing():
    curves, rows = paired(smooth(np.random.default_rng(3), 9) + BUMP)
    people = pd.DataFrame(
        {"group": [*"aabbbbaab"], "height_m": np.linspace(1.5, 2, 9)}, index=rows["subject"][:9]
    )
    alone, adjusted = compare_conditions(curves, rows), compare_conditions(curves, rows, people)
    for name in ("difference", "low", "high", "p"):
        np.testing.assert_allclose(getattr(adjusted, name), getattr(alone, name), atol=1e-9)


def test_who_enters_and_the_difference_are_those_of_the_mixed_model_of_peaks():
    """Curves that are level: their value is a peak."""
    rng = np.random.default_rng(4)
    curves, rows = study(rng, 12, missing=0.25, most=3)
    level = curves[:, :1] + np.where(rows["cell"] == "a", 2.0, 0.0)[:, None]
    of_peaks = compare_cells(rows.assign(value=level[:, 0]), rows["cell"].iloc[0], "b")
    compared = compare_conditions(np.tile(level, 101), rows)
    assert (compared.subjects, compared.recordings) == (of_peaks.subjects, of_peaks.recordings)
    error = of_peaks.difference / of_peaks.t
    assert compared.difference[0] == pytest.approx(of_peaks.difference, abs=0.3 * error)
    low, high = of_peaks.interval()
    assert compared.high[0] - compared.low[0] == pytest.approx(high - low, rel=0.3)


def test_a_subject_with_one_condition_shifts_the_estimate_only_as_far_as_subjects_are_alike():
    """Where subjects differ much more than their conditions, such a curve says nothing."""
    rng = np.random.default_rng(5)
    curves, rows = study(rng, 9)
    far = curves + 100 * rng.normal(size=9)[rows["subject"].astype(int)][:, None]
    without = (rows["subject"] != "0") | (rows["cell"] == "a")
    complete = rows["subject"] != "0"
    some = compare_conditions(far[without], rows[without].reset_index(drop=True))
    pairs = compare_conditions(far[complete], rows[complete].reset_index(drop=True))
    np.testing.assert_allclose(some.difference, pairs.difference, atol=0.1)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-6, 1.0, 1e6]))
def test_scale_order_of_rows_and_which_condition_is_first_do_not_matter(seed, scale):
    rng = np.random.default_rng(seed)
    curves, rows = study(rng, 8, missing=0.15, most=2)
    curves = curves + np.where(rows["cell"] == "a", 1.0, 0.0)[:, None] * BUMP
    found = compare_conditions(curves, rows)
    order = rng.permutation(len(rows))
    shuffled = rows.iloc[order].reset_index(drop=True)
    other = compare_conditions(scale * curves[order], shuffled)
    if found is None:
        assert other is None
        return
    sign = 1 if shuffled["cell"].iloc[0] == rows["cell"].iloc[0] else -1
    np.testing.assert_allclose(other.difference, sign * scale * found.difference, rtol=1e-6)
    np.testing.assert_allclose(other.p, found.p, atol=1e-9)


def test_few_subjects_show_nothing_and_unknown_instants_are_left_out():
    rng = np.random.default_rng(6)
    few, rows = paired(np.ones((5, 101)) + 0.01 * smooth(rng, 5))
    assert compare_conditions(few, rows) is None
    curves, rows = paired(np.ones((10, 101)) + 0.01 * smooth(rng, 10))
    curves[:, 20:40] = np.nan
    compared = compare_conditions(curves, rows)
    assert [(part.start, part.stop) for part in compared.parts] == [(0, 19), (40, 100)]
    assert np.isnan(compared.difference[20:40]).all()


def test_an_instant_that_one_subject_lacks_is_tested_over_the_others():
    curves, rows = paired(np.ones((8, 101)) + 0.01 * smooth(np.random.default_rng(7), 8))
    curves[3, 20:40] = np.nan
    compared = compare_conditions(curves, rows)
    assert [(part.start, part.stop) for part in compared.parts] == [(0, 100)]
    others = np.delete(curves[:8] - curves[8:], 3, axis=0)[:, 20:40]
    np.testing.assert_allclose(compared.difference[20:40], others.mean(axis=0), rtol=0.01)


def test_curves_that_do_not_vary_are_not_compared():
    curves, rows = paired(np.zeros((8, 101)))
    assert compare_conditions(curves, rows) is None


def test_groups_are_compared_as_by_welch():
    """Level curves of one condition: Welch's t, whose p has no multiplicity to correct for."""
    rng = np.random.default_rng(8)
    values = np.concatenate([rng.normal(0, 1, 12), rng.normal(1.2, 2, 12)])
    rows = pd.DataFrame({"subject": np.arange(24), "cell": "walk", "recording": 0})
    group = pd.Series(["control"] * 12 + ["patient"] * 12)
    compared = compare_groups(np.tile(values[:, None], 101), rows, group)
    welch = scipy.stats.ttest_ind(values[12:], values[:12], equal_var=False)
    assert compared.difference[0] == pytest.approx(values[12:].mean() - values[:12].mean())
    assert compared.p[0] == pytest.approx(welch.pvalue, abs=0.02)
    interval = welch.confidence_interval()
    assert compared.high[0] - compared.low[0] == pytest.approx(interval[1] - interval[0], rel=0.1)


def test_groups_whose_conditions_differ_differently_are_found_and_small_groups_are_not_tested():
    rng = np.random.default_rng(9)
    curves, rows = study(rng, 16)
    group = pd.Series(["x", "y"] * 8, index=np.arange(16).astype(str))
    more = (rows["subject"].map(group) == "y") & (rows["cell"] == rows["cell"].iloc[0])
    compared = compare_groups(curves + 4 * more.to_numpy()[:, None] * BUMP, rows, group)
    assert any(part.start <= 50 <= part.stop for part in compared.parts)
    assert compared.difference[50] == pytest.approx(4, abs=1.5)
    few = pd.Series(["x"] * 4 + ["y"] * 12, index=group.index)
    assert compare_groups(curves, rows, few) is None


def test_subjects_of_whom_group_or_covariate_is_unknown_enter_pairs():
    """Those with both conditions tell as much as without covariates; the others tell nothing."""
    curves, rows = paired(smooth(np.random.default_rng(10), 9) + BUMP)
    subjects = rows["subject"][:9].tolist()
    people = pd.DataFrame({"group": [*"abababab", None], "age": [np.nan, *range(8)]}, subjects)
    people["unknown"] = None
    alone, adjusted = compare_conditions(curves, rows), compare_conditions(curves, rows, people)
    np.testing.assert_allclose(adjusted.p, alone.p, atol=1e-9)
    lacking = (rows["subject"] != subjects[0]) | (rows["cell"] == "boots")
    some = compare_conditions(curves[lacking], rows[lacking].reset_index(drop=True), people)
    pairs = (rows["subject"] != subjects[0]).to_numpy()
    others = compare_conditions(curves[pairs], rows[pairs].reset_index(drop=True))
    np.testing.assert_allclose(some.difference, others.difference, atol=1e-6)


def test_of_one_condition_subjects_with_an_unknown_covariate_are_in_no_group():
    rng = np.random.default_rng(11)
    rows = pd.DataFrame({"subject": np.arange(16), "cell": "walk", "recording": 0})
    group, curves = pd.Series([*"xy"] * 7 + ["x", None]), smooth(rng, 16)
    people = pd.DataFrame({"age": [np.nan, *rng.normal(size=15)]})
    compared = compare_groups(curves, rows, group, people)
    fewer = slice(1, 15)
    known = compare_groups(curves[fewer], rows[fewer].reset_index(drop=True), group, people)
    assert compared.subjects == known.subjects == 14
    np.testing.assert_allclose(compared.difference, known.difference, atol=1e-12)


def test_groups_that_a_covariate_tells_apart_as_well_are_not_compared():
    rows = pd.DataFrame({"subject": np.arange(12), "cell": "walk", "recording": 0})
    group, curves = pd.Series([*"xy"] * 6), smooth(np.random.default_rng(12), 12)
    assert compare_groups(curves, rows, group, pd.DataFrame({"age": [20.0, 60.0] * 6})) is None
    ages = pd.DataFrame({"age": [20.0, 60.0] * 5 + [60.0, 20.0]})
    assert compare_groups(curves, rows, group, ages) is not None


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_units_of_covariates_and_covariates_that_tell_the_same_change_nothing(unit):
    rng = np.random.default_rng(13)
    curves, rows = study(rng, 12, missing=0.3, most=2)
    people = pd.DataFrame({"age": rng.normal(size=12)}, index=np.arange(12).astype(str))
    twice = people.assign(again=people["age"], same=1.7, text="m", age=unit * people["age"])
    found, other = (compare_conditions(curves, rows, of) for of in (people, twice))
    np.testing.assert_allclose(other.difference, found.difference, atol=1e-9)
    np.testing.assert_allclose(other.p, found.p, atol=1e-9)


def test_without_a_second_condition_nothing_is_compared():
    curves, rows = paired(smooth(np.random.default_rng(14), 9))
    one = (rows["cell"] == "boots").to_numpy()
    assert compare_conditions(curves[one], rows[one]) is None
    assert compare_conditions(curves[:0], rows[:0]) is None


def test_those_who_are_counted_are_known_at_an_instant_that_is_tested():
    curves, rows = paired(smooth(np.random.default_rng(15), 9))
    curves[rows["subject"] == "s00"] = np.nan
    curves[1:4, :20] = np.nan
    curves[1, 20:], curves[10, 20:] = np.nan, np.nan  # of a part where too few have both
    curves[5:8, :20] = np.nan
    compared = compare_conditions(curves, rows)
    assert np.isnan(compared.difference[:20]).all()
    assert (compared.subjects, compared.recordings) == (7, 14)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_odd_studies_give_p_above_zero_and_bands_around_the_difference(seed):
    """Gaps, levels, covariates that are unknown or alike, groups of one."""
    rng = np.random.default_rng(seed)
    people = int(rng.choice([2, 3, 6, 8, 13]))
    curves, rows = study(rng, people, missing=rng.choice([0.0, 0.4]), most=int(rng.integers(1, 4)))
    names = pd.Index(np.arange(people).astype(str))
    curves = (np.round(curves), np.ones_like(curves), curves)[rng.integers(3)]
    curves[rng.random(len(curves)) < 0.1, : rng.integers(101)] = np.nan
    curves[:, ::25][rng.random(curves[:, ::25].shape) < 0.1] = np.nan
    columns = {
        "number": rng.choice([np.nan, 1.0, 2.0, 3.0], people),
        "text": rng.choice(np.array(["m", "f", None]), people),
        "same": 1.7,
        "unknown": None,
    }
    between = pd.DataFrame(columns, names)[rng.permutation([*columns])[: rng.integers(5)]]
    group = pd.Series(rng.choice(["x", "y"], people), names)
    results = [compare_conditions(curves, rows, between)]
    for of in (rows["cell"] == "a", rows["cell"] != ""):
        results.append(compare_groups(curves[of], rows[of], group, between))
    for of in filter(None, results):
        assert np.all((of.p > 0) & (of.p <= 1))
        assert np.all(of.p[np.isnan(of.difference)] == 1)
        banded = np.isfinite(of.low)
        assert np.all((of.low <= of.difference) & (of.difference <= of.high) | ~banded)
        assert 6 <= of.subjects <= people


def test_on_measured_arch_angles_it_agrees_with_statistical_parametric_mapping():
    """The paired example of spm1d (Caravaggi et al. 2010): the same regions within two instants."""
    spm1d = pytest.importorskip("spm1d", reason="spm1d is not installed")
    normal, fast = spm1d.data.uv1d.tpaired.PlantarArchAngle().get_data()
    _, rows = paired(normal)
    compared = compare_conditions(np.vstack([fast, normal]), rows)
    field = spm1d.stats.ttest_paired(fast, normal).inference(0.05, two_tailed=True)
    ends = np.array([cluster.endpoints for cluster in field.clusters])
    found = np.array([(part.start, part.stop) for part in compared.parts])
    assert len(ends) >= 1
    np.testing.assert_allclose(found, ends, atol=2)


NULL_STUDIES = {
    "pairs": {},
    "several recordings": {"most": 3},
    "a covariate": {"covariate": True},
    "unequal groups": {"groups": True},
}


def alarms_and_coverage(studies, people, missing, *, seed, most=1, covariate=False, groups=False):
    """Share of null studies with a part that differs, and with a band that holds zero throughout.

    Of those that are tested; groups of a third and two thirds, the smaller with twice the SD.
    """
    rng, alarms, held, tested = np.random.default_rng(seed), 0, 0, 0
    names = pd.Index(np.arange(people).astype(str))
    for k in range(studies):
        sigma, few = (3, 10)[k % 2], np.arange(people) < people // 3
        deviations = np.where(few, 2.0, 1.0) if groups else 1.0
        curves, rows = study(
            rng, people, missing=missing, most=most, deviations=deviations, sigma=sigma
        )
        between = None
        if covariate or groups:  # whose effect is as large as the scatter of people
            value = rng.normal(size=people) if covariate else few.astype(float)
            effect = pd.Series(value, names)[rows["subject"]].to_numpy()[:, None]
            curves = curves + effect * smooth(rng, sigma=sigma)
            between = pd.DataFrame({"x": value if covariate else few.astype(str)}, names)
        compared = compare_conditions(curves, rows, between) if rows["cell"].nunique() > 1 else None
        if compared is not None:
            tested += 1
            alarms += bool(compared.parts)
            held += bool(np.all((compared.low <= 0) & (compared.high >= 0)))
    return alarms / tested, held / tested, tested


@pytest.mark.campaign
@pytest.mark.parametrize("missing", [0.0, 0.1, 0.25])
@pytest.mark.parametrize("people", [6, 9, 15])
@pytest.mark.parametrize("kind", NULL_STUDIES)
def test_false_alarms_and_bands_are_as_stated(kind, people, missing):
    """5 ± 1 % and 95 ± 1.5 % of 2,000; of six people, no p lies between 0.031 and 0.062: fewer."""
    options = NULL_STUDIES[kind]
    alarms, held, tested = alarms_and_coverage(2000, people, missing, seed=people, **options)
    print(f"{kind}, {people} people, {missing:.0%} missing: {alarms:.1%}, {held:.1%} of {tested}")
    assert (0.0 if people == 6 else 0.035) < alarms < 0.065
    assert 0.92 < held < 0.975


def test_false_alarms_and_bands_of_a_few_studies_are_as_stated():
    """200 studies of nine people, a quarter of the conditions missing: within 3 SD of 5, 95 %."""
    alarms, held, _ = alarms_and_coverage(200, 9, 0.25, seed=1, most=2)
    assert alarms < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 200)
    assert held > 0.95 - 3 * np.sqrt(0.05 * 0.95 / 200)


def alarms_with_covariates(studies, people, covariates):
    """Share of null studies of two equal groups in which a part differs."""
    rng, names = np.random.default_rng([people, covariates]), np.arange(people).astype(str)
    group, alarms = pd.Series([*"xy"] * (people // 2), names), 0
    rows = pd.DataFrame({"subject": names, "cell": "walk", "recording": 0})
    for k in range(studies):
        between = pd.DataFrame(rng.normal(size=(people, covariates)), names)
        curves = smooth(rng, people, sigma=(3, 10)[k % 2])
        alarms += bool(compare_groups(curves, rows, group, between).parts)
    return alarms / studies


@pytest.mark.campaign
@pytest.mark.parametrize("people", [12, 14])
@pytest.mark.parametrize("covariates", [1, 3, 4])
def test_false_alarms_between_groups_with_covariates_are_as_stated(people, covariates):
    alarms = alarms_with_covariates(1000, people, covariates)
    print(f"{people} people, {covariates} covariates: {alarms:.1%}")
    assert 0.025 < alarms < 0.075


@pytest.mark.campaign
@pytest.mark.parametrize("sizes", [(6, 6), (6, 12), (10, 20)])
@pytest.mark.parametrize("deviation", [0.5, 1.0, 2.0])
def test_false_alarms_between_groups_of_unequal_variance_are_as_stated(sizes, deviation):
    rng, first = np.random.default_rng(sum(sizes)), sizes[0]
    deviations = np.repeat([deviation, 1.0], sizes)
    group = pd.Series(np.repeat(["x", "y"], sizes), np.arange(sum(sizes)).astype(str))
    results = []
    for k in range(1000):
        curves, rows = study(rng, sum(sizes), deviations=deviations, sigma=(3, 10)[k % 2])
        compared = compare_groups(curves, rows, group)
        results.append((bool(compared.parts), bool(np.all(compared.low * compared.high <= 0))))
    alarms, held = np.mean(results, axis=0)
    print(f"{first} and {sizes[1]} people, SD {deviation:g} to 1: {alarms:.1%}, {held:.1%}")
    assert 0.025 < alarms < 0.075
    assert 0.925 < held < 0.98


@pytest.mark.campaign
@pytest.mark.parametrize("people", [8, 12])
def test_power_on_complete_pairs_is_not_below_statistical_parametric_mapping(people):
    spm1d = pytest.importorskip("spm1d", reason="spm1d is not installed")
    rng, found = np.random.default_rng(people), []
    for k in range(1000):
        differences = smooth(rng, people, sigma=(3, 10)[k % 2]) + 1.5 * BUMP
        field = spm1d.stats.ttest(differences).inference(0.05, two_tailed=True)
        found.append((bool(compare_conditions(*paired(differences)).parts), field.h0reject))
    ours, theirs = np.mean(found, axis=0)
    print(f"{people} people: power {ours:.1%}, spm1d {theirs:.1%}")
    # of pairs of decisions that differ, no more are theirs than by chance
    apart = np.array(found, int)[np.ptp(np.array(found, int), axis=1) > 0].sum(axis=0)
    assert scipy.stats.binomtest(int(apart[0]), int(apart.sum()), 0.5, "less").pvalue > 0.01
