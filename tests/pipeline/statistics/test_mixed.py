"""Mixed models: published numbers, the paired t-test where nothing is missing, true differences."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import design_of
from pipeline.statistics.mixed import compare_cells, fit_mixed
from pipeline.statistics.recordings import pool_recordings
from pipeline.statistics.verdict import PLANNED_RECORDINGS, subjects_needed, verdicts

SLEEP = Path(__file__).with_name("sleepstudy.csv")
"""Reaction times [ms] of 18 people over days of little sleep: Belenky et al. 2003, J Sleep Res
12:1, as `sleepstudy` of the R package lme4."""
DESIGN = design_of(["walk", "ramp"], compensated=False)


def test_a_published_model_with_random_slopes_is_reproduced():
    """lme4 (Bates et al. 2015, J Stat Softw 67(1)): 251.405 ± 6.825 and 10.467 ± 1.546 ms."""
    found = fit_mixed("reaction ~ days", pd.read_csv(SLEEP), "subject", "1 + days")
    assert found.fe_params.tolist() == pytest.approx([251.405, 10.467], abs=5e-4)
    assert found.bse_fe.tolist() == pytest.approx([6.825, 1.546], abs=5e-4)
    assert np.sqrt(found.scale) == pytest.approx(25.592, abs=5e-3)


def recordings(rng, subjects=9, repeats=1, difference=0.0, missing=()):
    """Values of people: 4 ± 1 of the subject, ± 0.5 of its cell, ± 0.7 of each recording."""
    rows = []
    for k in range(subjects):
        of_subject = 4 + rng.normal()
        for condition in ("walk", "ramp"):
            of_cell = 0.5 * rng.normal() + difference * (condition == "ramp")
            for repeat in range(repeats):
                name = {"subject": f"s{k}", "condition": condition, "recording": f"{repeat:02d}"}
                value = of_subject + of_cell + 0.7 * rng.normal()
                if (f"s{k}", condition) not in missing:
                    rows.append({**name, "value": value})
    return pd.DataFrame(rows)


def values(table):
    key = table["condition"] + " " + table["recording"]
    return table.assign(cell=table["condition"], recording=key)


@pytest.mark.parametrize("seed", range(3))
def test_of_complete_single_recordings_it_is_the_paired_t_test(seed):
    table = recordings(np.random.default_rng(seed))
    found = compare_cells(values(table), "ramp", "walk")
    cells = table.pivot(index="subject", columns="condition", values="value")
    paired = stats.ttest_rel(cells["ramp"], cells["walk"])
    low, high = paired.confidence_interval()
    assert found.difference == pytest.approx((low + high) / 2, rel=1e-6)
    assert found.interval() == pytest.approx((low, high), abs=0.05 * (high - low))
    assert found.p == pytest.approx(paired.pvalue, rel=0.1, abs=0.01)


def test_subjects_with_one_cell_take_part():
    missing = {("s0", "ramp"), ("s1", "walk"), ("s2", "ramp")}
    table = recordings(np.random.default_rng(4), difference=1.0, missing=missing)
    found = compare_cells(values(table), "ramp", "walk")
    assert (found.subjects, found.recordings) == (9, 15)
    paired = compare_cells(
        values(table[~table["subject"].isin(["s0", "s1", "s2"])]), "ramp", "walk"
    )
    assert found.difference != pytest.approx(paired.difference)
    assert found.error < paired.error


@pytest.mark.slow
@pytest.mark.parametrize(("repeats", "lost"), [(1, 3), (3, 3)])
def test_intervals_hold_the_true_difference(repeats, lost):
    """In 300 studies of nine people, of whom three lack a cell; 95 %, give or take 2.5 %."""
    missing = {(f"s{k}", ("walk", "ramp")[k % 2]) for k in range(lost)}
    held = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        table = recordings(rng, repeats=repeats, difference=1.0, missing=missing)
        low, high = compare_cells(values(table), "ramp", "walk").interval()
        held += low < 1.0 < high
    assert held > 0.92 * 300


def residuals(table):
    return table.rename(columns={"value": "rms"}).assign(
        compensated=False,
        axis="Fx",
        unit="N",
        window="cycle",
        rms_percent=0.1,
        n_cycles=9,
        n_frames=900,
    )


def test_mixed_models_are_in_the_table_where_cells_are_missing_or_repeated_only():
    rng = np.random.default_rng(5)
    for missing, repeats, expected in ((set(), 1, 0), ({("s0", "ramp")}, 1, 2), (set(), 2, 2)):
        table = residuals(recordings(rng, repeats=repeats, missing=missing))
        pooled = pool_recordings(table, "cycle")
        tests = statistics(pooled, design=DESIGN, recordings=table)
        mixed = tests[tests["test"] == "mixed model"]
        assert len(mixed) == expected
        assert set(mixed["effect"]) <= {"condition", "ramp - walk"}


def test_a_verdict_uses_all_recordings_where_cells_are_missing():
    table = residuals(
        recordings(np.random.default_rng(6), difference=3.0, missing={("s0", "ramp")})
    )
    pooled = pool_recordings(table, "cycle")
    (alone,), (mixed,) = verdicts(pooled, DESIGN), verdicts(pooled, DESIGN, recordings=table)
    assert (alone.mixed, mixed.mixed) == (False, True)
    assert mixed.answer == alone.answer == "above"
    assert mixed.difference != alone.difference
    complete = table[table["subject"] != "s0"]
    pooled = pool_recordings(complete, "cycle")
    assert verdicts(pooled, DESIGN, recordings=complete) == verdicts(pooled, DESIGN)


def repeated(seed, subjects=9, repeats=4):
    return residuals(recordings(np.random.default_rng(seed), subjects, repeats)).assign(n_cycles=1)


@pytest.mark.parametrize("seed", range(3))
def test_as_many_recordings_as_there_were_need_the_same_subjects(seed):
    table = repeated(seed, repeats=5)
    means = pool_recordings(table, "cycle")
    mean = table.groupby(["subject", "condition"])["rms"].mean()
    means["rms"] = [mean[key] for key in zip(means["subject"], means["condition"], strict=True)]
    (found,) = verdicts(means, DESIGN, recordings=table)
    assert found.needed_with[PLANNED_RECORDINGS.index(5)] == found.needed
    assert list(found.needed_with) == sorted(found.needed_with, reverse=True)


def test_subjects_needed_follow_from_the_variances_between_and_within_subjects():
    """Cells vary by 0.5 between subjects and by 0.7 between recordings, of a mean of 4."""
    table = repeated(1, subjects=60, repeats=4)
    (found,) = verdicts(pool_recordings(table, "recording"), DESIGN, recordings=table)
    for count, needed in zip(PLANNED_RECORDINGS, found.needed_with, strict=True):
        both = 1 + 1.2**2
        variance = 0.5**2 * both + 0.2**2 + 0.7**2 * both / count
        expected = subjects_needed(np.sqrt(variance), 0.2 * 4, 0.025)
        assert needed == pytest.approx(expected, rel=0.3)


def test_one_recording_per_condition_plans_no_other_number():
    table = residuals(recordings(np.random.default_rng(2)))
    (found,) = verdicts(pool_recordings(table), DESIGN, recordings=table)
    assert found.needed_with == ()


def test_groups_are_a_factor_of_the_model_of_all_cells():
    table = residuals(recordings(np.random.default_rng(3), subjects=12, repeats=2))
    second = table["subject"].isin([f"s{k}" for k in range(6)])
    table["rms"] += 3.0 * (second & (table["condition"] == "ramp"))
    people = pd.DataFrame({"subject": [f"s{k}" for k in range(12)]})
    people["group"] = ["old"] * 6 + ["young"] * 6
    design = replace(DESIGN, group="group", covariates=())
    tests = statistics(pool_recordings(table), people, design, table)
    mixed = tests[(tests["test"] == "mixed model") & (tests["statistic_name"] == "chi2")]
    p = mixed.set_index("effect")["p_corrected"]
    assert set(p.index) == {"condition", "group", "condition:group"}
    assert p["condition:group"] < 1e-6
