"""Table III has the thesis' reductions, both baselines, and p-values as they are printed."""

import numpy as np
import pandas as pd
import pytest

from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import design_of
from pipeline.statistics.table_3 import format_p, reduction_percent, table_3, table_3_markdown
from tests.pipeline.statistics.shared_errors import covariances

PRINTED = {  # mean without IC, mean with IC, reduction [%] of baseline, sway, pitch
    "Fx": ((37.1, 38.1, -2), (44.7, 47.4, -6), (342.0, 74.5, 78)),
    "Fy": ((30.4, 30.6, -1), (435.5, 33.6, 92), (71.7, 71.5, 0)),
    "Fz": ((63.1, 63.3, 0), (62.1, 63.7, -3), (100.0, 91.0, 9)),
    "Mx": ((11.4, 10.8, 5), (469.3, 19.5, 96), (22.9, 21.4, 7)),
    "My": ((20.5, 17.2, 16), (26.9, 22.1, 18), (357.6, 33.9, 91)),
    "Mz": ((4.5, 5.1, -13), (202.1, 13.7, 93), (22.6, 21.0, 7)),
}
DIFFERENCES = {"Fx": (9.3, 36.4), "Fy": (3.0, 40.9), "Mx": (8.8, 10.6), "Mz": (8.6, 15.9)}


@pytest.fixture(scope="module")
def residuals():
    """Nine subjects whose means are those of the thesis."""
    rng = np.random.default_rng(0)
    rows = []
    for axis, conditions in PRINTED.items():
        for condition, means in zip(("baseline", "sway", "pitch"), conditions, strict=True):
            for compensated in (False, True):
                spread = rng.normal(size=9)
                values = means[compensated] * (1 + 0.1 * (spread - spread.mean()))
                for subject, value in enumerate(values):
                    rows.append((f"sub{subject:02d}", condition, compensated, axis, "N", value))
    columns = ["subject", "condition", "compensated", "axis", "unit", "rms"]
    return pd.DataFrame(rows, columns=columns)


@pytest.fixture(scope="module")
def tests(residuals):
    return statistics(residuals)


@pytest.fixture(scope="module")
def table(residuals, tests):
    return table_3(residuals, tests)


@pytest.mark.parametrize(
    ("no_ic", "ic", "printed"), [row for rows in PRINTED.values() for row in rows]
)
def test_reductions_are_those_of_the_thesis(no_ic, ic, printed):
    lowest = reduction_percent(no_ic - 0.05, ic + 0.05)  # its means are rounded to 0.1
    highest = reduction_percent(no_ic + 0.05, ic - 0.05)
    assert lowest - 0.5 <= printed <= highest + 0.5


def test_a_residual_that_is_zero_has_no_reduction():
    assert np.isnan(reduction_percent(0.0, 1.0))
    assert reduction_percent(2.0, 2.0) == 0


def test_means_are_those_of_the_subjects(table):
    means = [row[:2] for rows in PRINTED.values() for row in rows]
    np.testing.assert_allclose(table[["mean_no_ic", "mean_ic"]], means)


def test_both_differences_from_baseline_are_there_and_the_thesis_printed_the_one_with_ic(table):
    rows = table.set_index(["axis", "condition"])
    for axis, printed in DIFFERENCES.items():
        for condition, difference in zip(("sway", "pitch"), printed, strict=True):
            row = rows.loc[(axis, condition)]
            assert row["ic_minus_baseline_ic"] == pytest.approx(difference, abs=0.11)
    row = rows.loc[("Fx", "sway")]
    assert row["ic_minus_baseline_no_ic"] == pytest.approx(47.4 - 37.1)
    assert rows.xs("baseline", level=1)["ic_minus_baseline_ic"].isna().all()


def test_p_values_are_the_bonferroni_ones_of_the_planned_pairs(tests, table):
    wanted = (tests["axis"] == "Mz") & (tests["correction"] == "Bonferroni x5")
    p = tests[wanted].set_index(["test", "effect"])["p_corrected"]
    row = table[(table["axis"] == "Mz") & (table["condition"] == "sway")].iloc[0]
    assert row["p_t"] == p["paired t", "sway IC - sway no IC"]
    assert row["p_t_baseline"] == p["paired t", "sway IC - baseline no IC"]
    assert row["p_wilcoxon"] == p["Wilcoxon exact", "sway IC - sway no IC"]
    assert row["p_wilcoxon_baseline"] == p["Wilcoxon exact", "sway IC - baseline no IC"]


@pytest.mark.parametrize(
    ("p", "written"),
    [
        *((0.0, "<.001*"), (0.04, ".040*"), (0.04996, ".04996*"), (0.05, ".050")),
    ],
)
def test_p_is_never_written_as_zero_and_on_the_side_of_alpha_where_it_is(p, written):
    assert format_p(p) == written


def test_incomplete_subjects_are_counted_and_named(residuals):
    gap = (residuals["subject"] == "sub03") & (residuals["condition"] == "sway")
    residuals = residuals[~gap]
    table = table_3(residuals, statistics(residuals))
    assert list(table["n"][:3]) == [9, 8, 9]
    assert list(table["without"][:3]) == ["", "sub03", ""]
    assert "sway without sub03." in table_3_markdown(table)


def test_one_subject_gives_means_and_no_p(residuals):
    one = residuals[residuals["subject"] == "sub00"]
    text = table_3_markdown(table_3(one, statistics(one)))
    assert "nan" not in text
    assert "±" not in text.partition("\n\n")[0]


SDS = ("mean_no_ic", "mean_ic", "no_ic_minus_baseline_no_ic", "ic_minus_baseline_no_ic")


def errors(residuals, level, of_condition):
    """Errors that change each value of a condition alike."""
    return covariances(residuals, level, residuals["condition"].map(of_condition))


def test_with_errors_of_measurement_means_and_differences_have_intervals_in_brackets(
    residuals, tests
):
    known = errors(residuals, "laboratory", {"baseline": 1.0, "sway": 3.0, "pitch": 1.0})
    table = table_3(residuals, tests, measurement=known)
    rows = table.set_index(["axis", "condition"])[[f"measurement_sd_{name}" for name in SDS]]
    np.testing.assert_allclose(rows.loc["Fx", "baseline"], [1, 1, np.nan, np.nan])
    np.testing.assert_allclose(rows.loc["Fx", "sway"], [3, 3, 2, 2])
    np.testing.assert_allclose(rows.loc["Mz", "pitch"], [1, 1, 0, 0])
    text = table_3_markdown(table)
    (line,) = (line for line in text.splitlines() if line.startswith("|  | sway | 9 | 44.7"))
    assert "[38.8, 50.6] | 47.4 ±" in line  # 44.7 ± 1.96 · 3
    assert "| +10.3 [+6.4, +14.2] |" in line  # 47.4 - 37.1 ± 1.96 · 2
    assert "nan" not in text


def test_an_rms_is_not_negative_and_neither_is_its_interval(residuals, tests):
    known = errors(residuals, "laboratory", dict.fromkeys(("baseline", "sway", "pitch"), 50.0))
    assert "[0.0, 135.1]" in table_3_markdown(table_3(residuals, tests, measurement=known))


def test_means_of_incomplete_subjects_have_the_uncertainty_of_those_who_are_complete(residuals):
    gap = (residuals["subject"] < "sub05") & (residuals["condition"] == "sway")
    known = errors(residuals, "subject", dict.fromkeys(("baseline", "sway", "pitch"), 6.0))
    left = residuals[~gap]
    table = table_3(left, statistics(left), measurement=known)
    np.testing.assert_allclose(table["measurement_sd_mean_ic"][:3], [2, 3, 2])


def test_without_compensation_only_the_plates_as_measured_have_intervals(residuals):
    design = design_of(["baseline", "sway", "pitch"], compensated=False)
    measured = residuals[~residuals["compensated"]]
    known = errors(measured, "trial", {"baseline": 3.0, "sway": 4.0, "pitch": 0.0})
    found = statistics(measured, design=design)
    table = table_3(measured, found, design, known)
    difference = table["measurement_sd_no_ic_minus_baseline_no_ic"]
    np.testing.assert_allclose(difference[:3], [np.nan, 5 / 3, 1])
    assert table["measurement_sd_mean_ic"].isna().all()
    assert "nan" not in table_3_markdown(table, design)
