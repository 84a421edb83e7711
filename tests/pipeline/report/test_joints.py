"""Compensation changes joints as the tables say, and every column of every table has a meaning."""

import csv
import re
import shutil

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy import stats

from pipeline.config.comparison import study_design
from pipeline.config.study import read_study
from pipeline.report.joints import JointMeans, compensation_tables, joint_figures, subject_values
from pipeline.report.write import write_report
from pipeline.run.load import Curves
from pipeline.statistics.design import unstated_design
from pipeline.statistics.recordings import subject_means
from pipeline.trial.joints import CURVES, JOINT_MOTIONS
from tests.pipeline.fake_results import without_figures

DESIGN = unstated_design(["walk"], compensated=True)


def peaks(values, cycles=4):
    """One row per subject, side and compensation: the largest ankle moment [N·m/kg]."""
    return pd.DataFrame(
        [
            {
                **{"subject": f"s{k}", "condition": "walk", "compensated": bool(compensated)},
                **{"side": side, "joint": "ankle", "direction": "plantarflexion"},
                **{"quantity": "largest moment", "unit": "N·m/kg", "value": value},
                "n_cycles": cycles,
            }
            for k, pair in enumerate(values)
            for compensated, value in enumerate(pair)
            for side in ("left", "right")
        ]
    )


def test_the_change_of_a_peak_has_the_interval_of_a_paired_t_test():
    pairs = [(1.2, 1.5), (1.4, 1.5), (1.1, 1.6), (1.3, 1.4)]
    (table,) = compensation_tables(peaks(pairs), DESIGN)
    ((name, before, after, change, percent),) = table.rows
    assert name == "ankle plantarflexion, largest moment"
    assert (before, after, percent) == ("1.25", "1.50", "+20.0 %")
    differences = np.subtract(*np.transpose(pairs)[::-1])
    low, high = stats.ttest_1samp(differences, 0).confidence_interval()
    numbers = [float(n.replace("−", "-")) for n in re.findall(r"[−+\d.]+", change)]
    np.testing.assert_allclose(numbers, [differences.mean(), low, high], atol=5e-4)


@pytest.mark.parametrize(
    ("pair", "percent"),
    [
        ((1.0, 0.4), "−60.0 %"),
        ((-1.0, -0.394), "−60.6 %"),
        ((-1.0, -1.2), "+20.0 %"),
        ((-0.2, 0.3), "–"),
    ],
)
def test_a_peak_that_shrinks_has_lost_so_much_of_itself_whichever_its_sign(pair, percent):
    (table,) = compensation_tables(peaks([pair] * 2), DESIGN)
    (row,) = table.rows
    assert row[-1] == percent
    assert "-" not in "".join(row[1:])  # every minus sign is one


def test_joints_are_drawn_only_where_most_cycles_are_known_and_the_title_says_so(tmp_path):
    """At 50 % one of three cycles is known, at 60 % two."""
    columns = [f"{motion.name}_{curve}" for motion in JOINT_MOTIONS for curve in CURVES]
    rows = [
        {"subject": s, "condition": "walk", "compensated": False, "recording": ""}
        | {"side": "left", "cycle": cycle, "percent": percent}
        | dict.fromkeys(columns, np.nan if percent in (50, 60)[: 3 - cycle] else 1.0)
        for s in ("s1", "s2")
        for cycle in (1, 2, 3)
        for percent in range(101)
    ]
    design = unstated_design(["walk"], compensated=False)
    pd.DataFrame(rows).to_parquet(tmp_path / "joint_cycles.parquet")
    means = JointMeans(Curves(tmp_path / "joint_cycles.parquet"), design.weigh)
    figures = {name: draw() for name, draw in joint_figures(means, design, {})}
    drawn = figures["joints"].axes[0].get_lines()[0].get_ydata()
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [50]
    assert "gaps: load" in figures["joints"].get_suptitle()


def test_values_of_sides_and_recordings_are_averaged_by_cycles_or_each_equal():
    table = pd.concat([peaks([(1.0, 1.0)], cycles=1), peaks([(2.0, 2.0)], cycles=3)])
    assert subject_values(table, "cycle")["value"].tolist() == [1.75, 1.75]
    assert subject_values(table, "recording")["value"].tolist() == [1.5, 1.5]


def test_both_sides_count_alike_however_many_cycles_they_have():
    left = peaks([(1.0, 1.0)], cycles=1).query("side == 'left'")
    table = pd.concat([left, peaks([(3.0, 3.0)], cycles=9).query("side == 'right'")])
    for weigh in ("cycle", "recording"):
        assert subject_values(table, weigh)["value"].tolist() == [2.0, 2.0]


@pytest.mark.parametrize(("weigh", "expected"), [("cycle", 1.75), ("recording", 1.5)])
def test_mean_curves_weigh_cycles_or_recordings_as_the_study_says(weigh, expected):
    cycles = pd.DataFrame({"recording": ["01", "02", "02", "02"], "side": "left"})
    cycles = cycles.assign(subject="s1", condition="walk", compensated=False, percent=0)
    cycles["hip"] = cycles["recording"].astype(int).astype(float)
    assert subject_means(cycles, ["hip"], weigh, of_sides=True)["hip"].tolist() == [expected]


@pytest.fixture(scope="module")
def reported(moving_study, finished, tmp_path_factory):
    """The report of two simulated people, without its figures."""
    out = shutil.copytree(finished, tmp_path_factory.mktemp("joints") / "results")
    with without_figures():
        write_report(out, moving_study)
    return out


def test_every_column_of_every_table_is_in_the_data_dictionary(reported):
    with (reported / "columns.csv").open(encoding="utf-8") as content:
        known = {(row["file"], row["column"]): row for row in csv.DictReader(content)}
    for path in [*reported.glob("*.csv"), *reported.glob("*.parquet")]:
        if path.name == "columns.csv":
            continue
        is_table = path.suffix == ".parquet"
        columns = pq.read_schema(path).names if is_table else pd.read_csv(path, nrows=0).columns
        for column in columns:
            assert known[path.name, column]["meaning"], (path.name, column)
    assert known["joint_cycles.parquet", "hip_flexion_moment"]["unit"] == "N·m/kg"
    assert known["statistics.csv", "ci_low"]["unit"].startswith("as unit")


def test_joints_of_every_trial_are_in_one_table(reported, moving_study):
    table = pd.read_csv(reported / "joints.csv")
    design = study_design(read_study(moving_study, recordings=False).file)
    assert set(table["condition"]) == set(design.conditions)
    assert set(table["side"]) == {"left", "right"}
    cycles = pd.read_parquet(reported / "joint_cycles.parquet")
    knee = cycles.query("compensated and condition == 'baseline'")
    span = knee.groupby(["subject", "side", "cycle"])["knee_flexion_angle"].agg(np.ptp)
    shown = table.query("compensated and condition == 'baseline' and joint == 'knee'")
    shown = shown[shown["quantity"] == "range of motion"]
    expected = span.groupby(["subject", "side"]).mean()
    np.testing.assert_allclose(shown.sort_values(["subject", "side"])["value"], expected, rtol=1e-5)
