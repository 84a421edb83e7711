"""The statistics of experiment 3 have the numbers, corrections and notes that were planned."""

import numpy as np
import pandas as pd
import pytest

from pipeline.statistics.comparison import statistics
from tests.pipeline.statistics.fixtures import FIXTURES, ORACLE, STUDY, long_table

SUBJECTS = STUDY[["subject", "sex", "height_m"]]
IN_R = {"IC": "a", "condition": "b", "sex": "sex", "height_m": "height"}


@pytest.fixture(scope="module")
def table():
    return statistics(long_table(), SUBJECTS)


def rows(table, test):
    return table[table["test"] == test].set_index("effect")


@pytest.mark.parametrize(
    ("test", "key"),
    [("RM-ANOVA", "study"), ("RM-ANOVA with sex and height_m", "study_covariates")],
)
def test_the_analyses_of_variance_are_those_of_r(table, test, key):
    found = rows(table, test)
    expected = {frozenset(row["term"].split(":")): row for row in ORACLE[key]}
    assert len(found) == len(expected) - 1  # R tests the intercept too
    for effect, row in found.iterrows():
        r = expected[frozenset(IN_R[name] for name in effect.split(":"))]
        own = row[["statistic", "df1", "df2", "p_uncorrected"]].astype(float)
        np.testing.assert_allclose(own, [r["f"], r["df1"], r["df2"], r["p"]], rtol=1e-9)
        eta = r["ss"] / (r["ss"] + r["ss_error"])
        assert row["effect_size"] == pytest.approx(eta)
        rejected = r["mauchly_p"] is not None and r["mauchly_p"] < 0.05
        assert row["correction"] == ("Greenhouse-Geisser" if rejected else "none")
        assert row["p_corrected"] == pytest.approx(r["p_gg"] if rejected else r["p"])
        assert 0.05 <= row["power"] <= 1


def test_mauchly_is_reported_where_there_is_sphericity_to_test(table):
    found = rows(table, "Mauchly, RM-ANOVA")
    assert list(found.index) == ["condition", "IC:condition"]
    expected = [row["mauchly_p"] for row in ORACLE["study"] if row["mauchly_p"] is not None]
    np.testing.assert_allclose(found["p_corrected"], expected, rtol=1e-9)


def test_sphericity_that_is_not_rejected_leaves_p_uncorrected():
    tooth = pd.read_csv(FIXTURES / "toothgrowth.csv").set_axis(STUDY.columns[3:], axis=1)
    tooth = tooth.assign(subject=range(10), sex="", height_m=0.0)
    row = rows(statistics(long_table(tooth)), "RM-ANOVA").loc["IC:condition"]
    assert round(row["statistic"], 3) == 2.534  # as rstatix prints it
    assert (row["correction"], round(row["p_corrected"], 3)) == ("none", 0.107)


@pytest.mark.parametrize(
    ("effect", "key"),
    [
        ("all cells", "friedman_cells"),
        ("condition, no IC", "friedman_no_ic"),
        ("condition, IC", "friedman_ic"),
    ],
)
def test_friedman_is_that_of_r(table, effect, key):
    row, r = rows(table, "Friedman").loc[effect], ORACLE[key]
    own = row[["statistic", "df1", "p_corrected", "effect_size"]].astype(float)
    np.testing.assert_allclose(own, [r["chi2"], r["df"], r["p"], r["w"]], rtol=1e-9)


def test_the_five_planned_pairs_have_bonferroni_and_holm_corrections(table):
    pairs = list(ORACLE["pairs"].values())  # in the same order
    tests = {
        "paired t": "p_t",
        "Wilcoxon exact": "p_wilcoxon_exact",
        "Wilcoxon asymptotic": "p_wilcoxon_asymptotic",
    }
    for test, name in tests.items():
        p = np.array([pair[name] for pair in pairs])
        found = rows(table, test)
        bonferroni = found[found["correction"] == "Bonferroni x5"]
        holm = found[found["correction"] == "Holm x5"]
        np.testing.assert_allclose(bonferroni["p_uncorrected"], p, rtol=1e-9)
        np.testing.assert_allclose(bonferroni["p_corrected"], np.minimum(1, 5 * p), rtol=1e-9)
        assert (holm["p_corrected"] <= bonferroni["p_corrected"]).all()
        if test == "paired t":
            expected = list(ORACLE["holm_t"].values())
            np.testing.assert_allclose(holm["p_corrected"], expected, rtol=1e-9)


def test_every_pair_has_its_effect_sizes_with_intervals(table):
    for pair, r in zip(
        table.loc[table["test"] == "estimate", "effect"].unique(),
        ORACLE["pairs"].values(),
        strict=True,
    ):
        estimates = rows(table, "estimate").loc[pair].set_index("effect_size_name")
        interval = estimates.loc["mean difference", ["effect_size", "ci_low", "ci_high"]]
        np.testing.assert_allclose(interval.astype(float), [r["mean"], *r["mean_ci"]], rtol=1e-9)
        assert set(estimates.index) == {"mean difference", "Cohen's dz"}
        for name in estimates.index:
            low, value, high = estimates.loc[name, ["ci_low", "effect_size", "ci_high"]]
            assert low < value < high


def test_an_incomplete_subject_is_named_and_left_out_only_where_needed():
    residuals = long_table()
    gap = (residuals["subject"] == "sub03") & (residuals["condition"] == "sway")
    gap &= residuals["compensated"]
    dropped = statistics(residuals[~gap], SUBJECTS)
    blank = statistics(residuals.assign(rms=residuals["rms"].mask(gap)), SUBJECTS)
    pd.testing.assert_frame_equal(dropped, blank)
    needs_sway = dropped["note"].str.contains(r"without sub03 \(no sway IC\)")
    assert (dropped["n"] == np.where(needs_sway, 8, 9)).all()
    assert needs_sway[dropped["test"].str.startswith("RM-ANOVA")].all()
    assert not needs_sway[dropped["effect"] == "pitch IC - pitch no IC"].any()
    complete = statistics(residuals[residuals["subject"] != "sub03"], SUBJECTS)
    np.testing.assert_allclose(
        rows(dropped, "RM-ANOVA")["statistic"], rows(complete, "RM-ANOVA")["statistic"]
    )


@pytest.mark.parametrize("n", [2, 5])
def test_few_subjects_give_the_tests_that_exist_and_a_note_for_the_others(n):
    found = statistics(long_table(STUDY[:n]), SUBJECTS[:n])
    nothing = found["statistic"].isna() & found["effect_size"].isna()
    assert found.loc[nothing, "note"].str.startswith("not computed").all()
    assert not found.loc[~nothing, "note"].str.startswith("not computed").any()


def test_compensation_that_changes_nothing_is_not_given_a_p_value():
    study = STUDY.copy()
    for condition in ("baseline", "sway", "pitch"):
        study[f"ic_{condition}"] = study[f"no_ic_{condition}"]
    found = statistics(long_table(study))
    for test in ("RM-ANOVA", "paired t", "Wilcoxon exact"):
        pair = rows(found, test).filter(regex="^IC|sway IC - sway no IC", axis=0)
        assert len(pair)
        assert pair["p_corrected"].isna().all()
        assert pair["note"].str.contains("not computed").all()
    others = found["effect"] == "pitch IC - baseline no IC"
    assert found.loc[others & (found["test"] == "paired t"), "p_corrected"].notna().all()


def test_residuals_are_analysed_one_by_one(table):
    found = statistics(long_table(axes=("Fx", "Mz")), SUBJECTS)
    first = found[found["axis"] == "Fx"].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, table)


def test_a_cell_that_is_given_twice_is_refused():
    with pytest.raises(ValueError, match="duplicate"):
        statistics(pd.concat([long_table(), long_table()[:1]]), SUBJECTS)
