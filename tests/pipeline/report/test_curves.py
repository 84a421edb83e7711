"""Every recording of a study enters its curves, and groups are compared."""

import re
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.report.curves import compared_curves, curve_tables
from pipeline.report.figures import difference_title, file_names, rms_over_cycles
from pipeline.report.joints import JointMeans
from pipeline.run.load import Curves, collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.curves import CurveComparison
from pipeline.statistics.design import EXPERIMENT_3, design_of
from pipeline.trial.residuals import AXES
from tests.pipeline.fake_results import write_fake_results

COLUMNS_OF_CYCLES = ["subject", "condition", "compensated", "recording", "axis", "percent"]
PAIR = "sway IC - baseline no IC"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Twelve people, one of whom did not sway."""
    folder = tmp_path_factory.mktemp("twelve")
    write_fake_results(folder, subjects=12, cycles=2, without=[("sub01", "sway")])
    return collect(folder, in_curves=lambda trial: True)


NO_JOINTS = SimpleNamespace(of_recordings={})


def compared(results, design, axes=("Fx",), joints=NO_JOINTS, **columns):
    people = pd.DataFrame(columns, index=results.subjects["subject"])
    cycles = Curves(results.folder / "cycles.parquet")
    over_cycles = rms_over_cycles(cycles, "cycle", within=("recording",))
    over_cycles = over_cycles[over_cycles["axis"].isin(axes)]
    return compared_curves(over_cycles, joints, design, people)


@pytest.fixture(scope="module")
def of_experiment(results):
    joints = JointMeans(Curves(results.folder / "joint_cycles.parquet"), "cycle")
    return compared(results, EXPERIMENT_3, AXES, joints)


def test_a_subject_without_a_condition_enters_curves_as_it_enters_the_mixed_model(
    results, of_experiment
):
    of_fx = of_experiment["Fx", PAIR]
    headline = results.residuals[results.residuals["headline"]]
    tests = statistics(headline, results.subjects, EXPERIMENT_3, headline)
    rows = tests.query(f"axis == 'Fx' and test == 'mixed model' and effect == '{PAIR}'")
    assert {*rows["n"]} == {of_fx.subjects} == {12}
    assert {*rows["note"]} == {f"{of_fx.recordings} recordings"} == {"23 recordings"}


def test_groups_are_compared_in_every_cell_and_in_what_cells_differ_by(results):
    design = replace(design_of(("baseline", "pitch"), compensated=False), group="group")
    large = compared(results, design, group=[*"ppppppcccccc"])
    labels = {label for _, label in large}
    cells = ("pitch - baseline", "pitch", "baseline")
    assert labels == {cells[0], *(f"{cell}: p - c" for cell in cells)}
    assert large["Fx", "pitch: p - c"].subjects == 12
    # of five people in a group nothing is said
    assert {label for _, label in compared(results, design, group=[*"pppppccccccc"])} == {cells[0]}


def test_of_a_single_condition_groups_are_compared(results):
    design = replace(design_of(["baseline"], compensated=False), group="group")
    labels = {label for _, label in compared(results, design, group=[*"ppppppcccccc"])}
    assert labels == {"baseline: p - c"}


def test_of_three_groups_each_is_compared_with_the_first():
    """Those of whom no group or no sex is stated are in none."""
    rng = np.random.default_rng(0)
    people = pd.DataFrame({"group": [*["a"] * 7, *["b"] * 6, *["c"] * 6, None, None]})
    people["sex"] = ["unspecified", *"fmfmfmfmfmfmfmfmfmfm"]
    people.index = people.index.map("sub{:02}".format)
    keys = product(people.index, [""], range(101))
    rows = pd.DataFrame(keys, columns=["subject", "recording", "percent"])
    over_cycles = rows.assign(axis="Fx", condition="walk", compensated=False)
    over_cycles["value"] = rng.normal(size=len(rows))
    design = replace(design_of(["walk"], compensated=False), group="group")
    found = compared_curves(over_cycles, NO_JOINTS, design, people)
    assert {label: of.in_groups for (_, label), of in found.items()} == {
        "walk: b - a": (6, 6),
        "walk: c - a": (6, 6),
    }
    # a cell of which nothing is known is no second condition
    unknown = over_cycles.assign(condition="run", value=np.nan)
    two = replace(design_of(["walk", "run"], compensated=False), group="group")
    every = pd.concat([over_cycles, unknown])
    found = compared_curves(every, NO_JOINTS, two, people)
    assert {label for _, label in found} == {"walk: b - a", "walk: c - a"}


def test_without_gait_cycles_nothing_is_compared_and_the_tables_have_their_columns():
    over_cycles = pd.DataFrame(columns=[*COLUMNS_OF_CYCLES, "value"])
    people = pd.DataFrame(index=["sub01"])
    tables = curve_tables(compared_curves(over_cycles, NO_JOINTS, EXPERIMENT_3, people))
    assert [(len(of), len(of.columns)) for of in tables.values()] == [(0, 7), (0, 8)]


def test_figures_say_who_entered_and_what_is_subtracted():
    nothing = np.zeros(101)
    of_curves = {
        axis: CurveComparison(nothing, nothing, nothing, nothing + 1, counts, 20)
        for axis, counts in (("Fx", (6, 5)), ("Fy", (7, 5)))
    }
    title = difference_title("walk: patients - controls", of_curves)
    assert title.startswith("walk: patients - controls: ")
    assert all(part in title for part in ("95 %", "6 to 7 subjects", "5 subjects", "20 recordings"))


def test_different_labels_have_different_files_of_a_length_that_is_allowed():
    labels = ["walk: a/b - c", "walk: a:b - c", "walk: A b - C", *("long " * 99 + k for k in "xy")]
    names = file_names(labels)
    assert len({name.casefold() for name in names}) == len(labels)
    assert all(re.fullmatch(r"[\w.+-]+", n) and len(n.encode()) < 210 for n in names)


def test_a_band_is_written_for_every_comparison_and_holds_where_no_part_differs(of_experiment):
    tables = curve_tables(of_experiment)
    bands = tables["curve_bands"]
    assert {*zip(bands["curve"], bands["compared"], strict=True)} == {*of_experiment}
    assert bands.groupby(["curve", "compared"]).size().eq(101).all()
    of_one = of_experiment["Fx", PAIR]
    rows = bands[(bands["curve"] == "Fx") & (bands["compared"] == PAIR)]
    assert rows["low"].tolist() == of_one.low.tolist()
    outside = (rows["low"] > 0) | (rows["high"] < 0)
    assert abs(int(outside.sum()) - int((rows["p"] < 0.05).sum())) <= 10
