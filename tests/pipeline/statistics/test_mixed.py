"""Mixed models give the numbers of lme4 and pbkrtest, and find true differences."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import design_of
from pipeline.statistics.mixed import compare_cells, effects_of_factors, fit_mixed
from pipeline.statistics.recordings import pool_recordings
from pipeline.statistics.verdict import PLANNED_RECORDINGS, subjects_needed, verdicts
from tests.pipeline.statistics.mixed_models.designs import COLUMNS, studies

SLEEP = Path(__file__).with_name("sleepstudy.csv")
"""Reaction times [ms] of 18 people over days of little sleep: Belenky et al. 2003, J Sleep Res
12:1, as `sleepstudy` of the R package lme4."""
LME4 = Path(__file__).parent / "mixed_models" / "lme4.csv"
"""Numbers of lme4 1.1-31 and pbkrtest 0.5.2 for the studies of ``designs.py``, by ``lme4.R``."""
DESIGN = design_of(["walk", "ramp"], compensated=False)


def test_a_published_model_is_reproduced():
    """Reaction ~ Days + (1|Subject) of lme4: 251.405 ± 9.747, 10.467 ± 0.804; SD 37.12, 30.99."""
    sleep = pd.read_csv(SLEEP)
    days = np.column_stack([np.ones(len(sleep)), sleep["days"]])
    model = fit_mixed(sleep["reaction"].to_numpy(float), days, [sleep["subject"].to_numpy()])
    assert model.coefficients == pytest.approx([251.405, 10.467], abs=5e-4)
    assert np.sqrt(np.diag(model.covariance)) == pytest.approx([9.747, 0.804], abs=5e-4)
    assert np.sqrt(model.variances) == pytest.approx([37.12, 30.99], abs=5e-3)


def as_values(rows):
    """A study of ``designs.py`` as the statistics take it, with its pair and its design."""
    table = pd.DataFrame(rows, columns=COLUMNS).astype({"value": float})
    both = table["compensated"].nunique() > 1
    table["compensated"] = table["compensated"] == "yes"
    design = design_of(["a", "b", "c"], compensated=both)
    table["cell"] = [
        design.cell(*key) for key in zip(table["condition"], table["compensated"], strict=True)
    ]
    table["recording"] = table["condition"] + " " + table["recording"]
    if table["group"].nunique() > 1:
        return table, ("b", "a"), replace(design, group="group")
    return table.drop(columns="group"), ("a IC", "a no IC") if both else ("b", "a"), design


def error_of(compared):
    """Standard error of the difference, without the correction for few subjects."""
    return np.sqrt([1, -1] @ compared.model.covariance @ [1, -1])


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.campaign)])
def test_estimates_errors_and_tests_are_those_of_lme4_and_pbkrtest_in_240_studies(every):
    """With missing cells, groups, sessions; variances of zero, and of 250,000 times the error."""
    expected = pd.read_csv(LME4).set_index(["study", "effect"])
    chosen = [*studies()][::every]
    assert len(chosen) == 240 / every
    for name, rows in chosen:
        values, pair, design = as_values(rows)
        known = expected.loc[(name, "pair")]
        compared_cells = compare_cells(values, *pair)
        assert error_of(compared_cells) == pytest.approx(known["error"], rel=1e-5), name
        tolerance = 1e-5 * known["error"]
        assert compared_cells.difference == pytest.approx(known["estimate"], abs=tolerance), name
        for effect, test in effects_of_factors(values, design):
            key = name, effect.replace("IC", "compensated")
            if key in expected.index:  # pbkrtest needs a random effect
                known = expected.loc[key]
                assert (test.f, test.df2) == pytest.approx((known["f"], known["df2"]), rel=1e-5)
                assert test.p == pytest.approx(known["p"], rel=1e-5, abs=1e-12), key


def test_no_other_variances_are_likelier(monkeypatch):
    """The restricted likelihood, with dense matrices, around the variances that were found."""
    names = {"unbalanced 00", "missing cells 01", "singular 02", "no variance 03"}
    for _, rows in (study for study in studies() if study[0] in names):
        values, pair, _ = as_values(rows)
        cells = values[values["cell"].isin(pair)]
        y, x = cells["value"].to_numpy(), pd.get_dummies(cells["cell"]).to_numpy(float)
        labels = [cells["subject"], cells["subject"] + cells["cell"]]
        alike = [(one.to_numpy()[:, None] == one.to_numpy()).astype(float) for one in labels]

        def criterion(of_subject, of_cell, error, y=y, x=x, alike=alike):
            covariance = error * np.eye(len(y)) + of_subject * alike[0] + of_cell * alike[1]
            weight = np.linalg.inv(covariance)
            precision = x.T @ weight @ x
            rest = y - x @ np.linalg.solve(precision, x.T @ weight @ y)
            determinants = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(precision)[1]
            return determinants + rest @ weight @ rest

        best = compare_cells(values, *pair).model.variances[[0, 1, 3]]
        for k in range(3):
            for step in (-0.03, 0.03):
                other = best.copy()
                other[k] += step * best.sum()
                if other[k] >= 0:
                    assert criterion(*other) > criterion(*best)


def recordings(rng, subjects=9, repeats=1, difference=0.0, missing=(), sizes=(1.0, 0.5, 0.7)):
    """Values of people: 4 ± 1 of the subject, ± 0.5 of its cell, ± 0.7 of each recording."""
    rows = []
    for k in range(subjects):
        of_subject = 4 + sizes[0] * rng.normal()
        for condition in ("walk", "ramp"):
            of_cell = sizes[1] * rng.normal() + difference * (condition == "ramp")
            for repeat in range(repeats):
                name = {"subject": f"s{k}", "condition": condition, "recording": f"{repeat:02d}"}
                value = of_subject + of_cell + sizes[2] * rng.normal()
                if (f"s{k}", condition) not in missing:
                    rows.append({**name, "value": value})
    return pd.DataFrame(rows)


def values(table):
    key = table["condition"] + " " + table["recording"]
    return table.assign(cell=table["condition"], recording=key)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("repeats", [1, 3])
def test_of_complete_recordings_it_is_the_paired_t_test_of_means(seed, repeats):
    table = recordings(np.random.default_rng(seed), repeats=repeats, sizes=(2, 1, 0.5))
    compared = compare_cells(values(table), "ramp", "walk")
    cells = table.groupby(["subject", "condition"])["value"].mean().unstack()
    paired = stats.ttest_rel(cells["ramp"], cells["walk"])
    assert compared.interval() == pytest.approx(paired.confidence_interval(), rel=1e-4)
    assert compared.p == pytest.approx(paired.pvalue, rel=1e-4)


def test_subjects_with_one_cell_take_part():
    missing = {("s0", "ramp"), ("s1", "walk"), ("s2", "ramp")}
    table = recordings(np.random.default_rng(4), difference=1.0, missing=missing)
    compared = compare_cells(values(table), "ramp", "walk")
    assert (compared.subjects, compared.recordings) == (9, 15)
    complete = table[~table["subject"].isin(["s0", "s1", "s2"])]
    paired = compare_cells(values(complete), "ramp", "walk")
    assert compared.difference != pytest.approx(paired.difference)
    assert error_of(compared) < error_of(paired)


@pytest.mark.campaign
@pytest.mark.parametrize(("repeats", "sizes"), [(1, (1.0, 0.5, 0.7)), (3, (1.0, 0.5, 0.7))])
def test_intervals_hold_the_true_difference(repeats, sizes):
    """In 500 studies of nine people, of whom three lack a cell; 95 %, give or take 2 %."""
    missing = {(f"s{k}", ("walk", "ramp")[k % 2]) for k in range(3)}
    held = 0
    for seed in range(500):
        rng = np.random.default_rng(seed)
        table = recordings(rng, repeats=repeats, difference=1.0, missing=missing, sizes=sizes)
        low, high = compare_cells(values(table), "ramp", "walk").interval()
        held += low < 1.0 < high
    assert abs(held / 500 - 0.95) < 0.03


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("subjects", "repeats", "sizes", "fewest"),
    [
        (4, 3, (1.0, 0.5, 0.7), 0.035),
        (6, 2, (1.0, 0.5, 0.7), 0.035),
        (9, 3, (1.0, 0.5, 0.7), 0.035),
        (4, 3, (0.0, 0.0, 1.0), 0.02),  # of variances of zero, estimates are too large
    ],
)
def test_factors_without_an_effect_are_significant_in_5_percent_of_studies(
    subjects, repeats, sizes, fewest
):
    """1,000 studies of three conditions; 5 %, give or take 1.5 %."""
    design = design_of(["a", "b", "c"], compensated=False)
    shape = (1000, subjects, 3, repeats)
    rng = np.random.default_rng(0)
    of_subject, of_cell = rng.normal(size=(*shape[:2], 1, 1)), rng.normal(size=(*shape[:3], 1))
    drawn = 20 + sizes[0] * of_subject + sizes[1] * of_cell + sizes[2] * rng.normal(size=shape)
    index = pd.MultiIndex.from_product([range(subjects), list("abc"), range(repeats)])
    names = index.to_frame(name=["subject", "condition", "repeat"]).astype(str)
    names = names.reset_index(drop=True).assign(compensated=False, cell=lambda t: t["condition"])
    names["recording"] = names["condition"] + names["repeat"]
    significant = 0
    for study in drawn:
        ((_, test),) = effects_of_factors(names.assign(value=study.ravel()), design)
        significant += test.p < 0.05
    assert fewest <= significant / 1000 <= 0.065


def residuals(table):
    return table.rename(columns={"value": "rms"}).assign(
        compensated=False,
        axis="Fx",
        unit="N",
        window="cycle",
        rms_percent=0.1,
        expected=np.nan,
        n_cycles=9,
        n_frames=900,
    )


def test_mixed_models_are_in_the_table_where_cells_are_missing_or_repeated_only():
    rng = np.random.default_rng(5)
    for missing, repeats, expected in ((set(), 1, 0), ({("s0", "ramp")}, 1, 3), (set(), 2, 3)):
        table = residuals(recordings(rng, repeats=repeats, missing=missing))
        tests = statistics(pool_recordings(table, "cycle"), design=DESIGN, recordings=table)
        mixed = tests[tests["test"] == "mixed model"]
        assert len(mixed) == expected  # the factor, and the pair with either correction
        assert set(mixed["effect"]) <= {"condition", "ramp - walk"}


def test_pairs_of_mixed_models_are_corrected_as_the_design_says():
    rng = np.random.default_rng(1)
    tables = [
        recordings(rng, repeats=2).replace({"walk": names[0], "ramp": names[1]})
        for names in (("a", "b"), ("c", "d"))
    ]
    table = residuals(pd.concat(tables))
    design = design_of(["a", "b", "c", "d"], compensated=False)
    tests = statistics(pool_recordings(table), design=design, recordings=table)
    pairs = tests[(tests["test"] == "mixed model") & (tests["statistic_name"] == "t")]
    p = pairs[pairs["correction"] == "Holm x3"].sort_values("p_uncorrected")
    ordered = np.maximum.accumulate(p["p_uncorrected"] * [3, 2, 1])
    np.testing.assert_allclose(p["p_corrected"], np.minimum(ordered, 1))
    p = pairs[pairs["correction"] == "Bonferroni x3"]
    np.testing.assert_allclose(p["p_corrected"], np.minimum(3 * p["p_uncorrected"], 1))


def test_conditions_without_results_yet_leave_the_others_tested():
    table = residuals(recordings(np.random.default_rng(2), repeats=2))
    begun = table[table["condition"] == "walk"]
    tests = statistics(pool_recordings(begun), design=DESIGN, recordings=begun)
    notes = tests.loc[tests["test"] == "mixed model", "note"]
    assert notes.str.contains("not computed").all()
    (verdict,) = verdicts(pool_recordings(begun), DESIGN, recordings=begun)
    assert verdict.answer == "no data"


def test_a_verdict_uses_all_recordings_where_cells_are_missing():
    table = residuals(
        recordings(np.random.default_rng(6), difference=3.0, missing={("s0", "ramp")})
    )
    pooled = pool_recordings(table, "cycle")
    (alone,), (mixed,) = verdicts(pooled, DESIGN), verdicts(pooled, DESIGN, recordings=table)
    assert (alone.mixed, mixed.mixed, alone.n, mixed.n) == (False, True, 8, 9)
    assert mixed.answer == alone.answer == "above"
    assert mixed.difference != alone.difference
    complete = table[table["subject"] != "s0"]
    pooled = pool_recordings(complete, "cycle")
    assert verdicts(pooled, DESIGN, recordings=complete) == verdicts(pooled, DESIGN)


@pytest.mark.parametrize("seed", range(20))
def test_all_numbers_of_a_verdict_are_of_the_model_that_judges(seed):
    """The interval in percent excludes no difference exactly where the one in newtons does."""
    rng = np.random.default_rng(seed)
    table = residuals(recordings(rng, 6, 2, difference=rng.normal(), missing={("s1", "walk")}))
    (verdict,) = verdicts(pool_recordings(table), DESIGN, recordings=table)
    assert verdict.ic - verdict.baseline == pytest.approx(verdict.difference)
    assert (verdict.low > 0) == (verdict.low_percent > 0)
    assert (verdict.high > 0) == (verdict.high_percent > 0)
    if np.isfinite(verdict.high_percent):
        assert verdict.low_percent < verdict.percent(verdict.difference) < verdict.high_percent
        assert (verdict.answer == "within margin") == (verdict.high_percent <= 20)


def repeated(seed, subjects=9, repeats=4):
    return residuals(recordings(np.random.default_rng(seed), subjects, repeats))


@pytest.mark.parametrize("seed", range(3))
def test_as_many_recordings_as_there_were_need_the_same_subjects(seed):
    table = repeated(seed, repeats=5)
    (verdict,) = verdicts(pool_recordings(table), DESIGN, recordings=table)
    assert verdict.needed_with[PLANNED_RECORDINGS.index(5)] == verdict.needed
    assert list(verdict.needed_with) == sorted(verdict.needed_with, reverse=True)


def test_subjects_needed_follow_from_the_variances_between_and_within_subjects():
    """Cells vary by 0.5 between subjects and by 0.7 between recordings, of a mean of 4."""
    table = repeated(1, subjects=60, repeats=4)
    (verdict,) = verdicts(pool_recordings(table, "recording"), DESIGN, recordings=table)
    for count, needed in zip(PLANNED_RECORDINGS, verdict.needed_with, strict=True):
        both = 1 + 1.2**2
        variance = 0.5**2 * both + 0.2**2 + 0.7**2 * both / count
        expected = subjects_needed(np.sqrt(variance), 0.2 * 4, 0.025)
        assert needed == pytest.approx(expected, rel=0.3)


def test_one_recording_per_condition_plans_no_other_number():
    table = residuals(recordings(np.random.default_rng(2)))
    (verdict,) = verdicts(pool_recordings(table), DESIGN, recordings=table)
    assert verdict.needed_with == ()


def test_groups_are_a_factor_of_the_model_of_all_cells():
    table = residuals(recordings(np.random.default_rng(3), subjects=12, repeats=2))
    second = table["subject"].isin([f"s{k}" for k in range(6)])
    table["rms"] += 3.0 * (second & (table["condition"] == "ramp"))
    people = pd.DataFrame({"subject": [f"s{k}" for k in range(12)]})
    people["group"] = ["old"] * 6 + ["young"] * 6
    design = replace(DESIGN, group="group", covariates=())
    tests = statistics(pool_recordings(table), people, design, table)
    mixed = tests[(tests["test"] == "mixed model") & (tests["statistic_name"] == "F")]
    p = mixed.set_index("effect")["p_corrected"]
    assert set(p.index) == {"condition", "group", "condition:group"}
    assert p["condition:group"] < 1e-5


@pytest.mark.parametrize("effect_sd", [0.2, 0.02, 0.01])
def test_what_hardly_changes_within_recordings_is_compared_too(effect_sd):
    """With and without compensation in one recording: 3.5 N between subjects, 0.01 N between."""
    rng = np.random.default_rng(7)
    before = 20 + 3.5 * rng.normal(size=(8, 1)) + 2 * rng.normal(size=(8, 2))
    after = before - 0.1 + effect_sd * rng.normal(size=(8, 2))
    rows = [
        {"subject": f"s{k}", "recording": f"{j}", "cell": cell, "value": table[k, j]}
        for cell, table in (("no IC", before), ("IC", after))
        for k in range(8)
        for j in range(2)
    ]
    compared = compare_cells(pd.DataFrame(rows), "IC", "no IC")
    assert compared.difference == pytest.approx((after - before).mean(), rel=1e-6)
    assert 0 < error_of(compared) < effect_sd


def test_equal_copies_of_recordings_are_refused_with_the_reason():
    table = recordings(np.random.default_rng(1), repeats=2)
    table["value"] = table.groupby(["subject", "condition"])["value"].transform("first")
    with pytest.raises(ValueError, match="hardly vary"):
        compare_cells(values(table), "ramp", "walk")


def test_one_subject_with_both_conditions_has_means_whoever_has_one_alone():
    table = residuals(recordings(np.random.default_rng(1), subjects=3))
    table = table[(table["subject"] == "s0") | (table["condition"] == "walk")]
    (verdict,) = verdicts(pool_recordings(table), DESIGN, recordings=table)
    complete = table[table["subject"] == "s0"].set_index("condition")["rms"]
    assert (verdict.answer, verdict.n, verdict.paired) == ("no interval", 1, 1)
    assert (verdict.ic, verdict.baseline) == (complete["ramp"], complete["walk"])


def test_compensation_that_changes_nothing_is_shown_as_no_change():
    """Means with and without it weigh subjects alike, or there is no mean without it."""
    one = residuals(recordings(np.random.default_rng(5), repeats=2))
    one["rms"] *= np.where(one["recording"] == "00", 1, 3)
    both = pd.concat([one, one.assign(compensated=True, rms=one["rms"] * (1 + 1e-4))])
    design = design_of(["walk", "ramp"], compensated=True)
    balanced = verdicts(pool_recordings(both), design, recordings=both)
    assert [v.no_ic for v in balanced] == pytest.approx([v.ic for v in balanced], rel=2e-4)
    lacking = both[(both["subject"] != "s1") | (both["condition"] == "walk")]
    found = {v.condition: v for v in verdicts(pool_recordings(lacking), design, recordings=lacking)}
    assert np.isnan(found["ramp"].no_ic)
    assert (found["ramp"].n, found["ramp"].paired) == (9, 8)
