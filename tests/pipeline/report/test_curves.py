"""Curves of a study: every recording enters, and groups are compared."""

from dataclasses import replace

import pandas as pd
import pytest

from pipeline.report.curves import compared_curves, curve_tables
from pipeline.report.figures import rms_over_cycles
from pipeline.report.joints import JointMeans
from pipeline.run.load import Curves, collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.design import EXPERIMENT_3, design_of
from tests.pipeline.fake_results import write_fake_results

PAIR = "sway IC - baseline no IC"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Eleven people, one of whom did not sway."""
    folder = tmp_path_factory.mktemp("eleven")
    write_fake_results(folder, subjects=11, cycles=4, without=[("sub01", "sway")])
    return collect(folder, in_curves=lambda trial: True)


def compared(results, design, **columns):
    cycles, joints = (Curves(results.folder / f"{n}.parquet") for n in ("cycles", "joint_cycles"))
    people = pd.DataFrame(columns, index=results.subjects["subject"])
    over_cycles = rms_over_cycles(cycles, "cycle", within=("recording",))
    return compared_curves(over_cycles, JointMeans(joints, "cycle"), design, people)


@pytest.fixture(scope="module")
def of_experiment(results):
    return compared(results, EXPERIMENT_3)


def test_a_subject_without_a_condition_enters_curves_as_it_enters_the_mixed_model(
    results, of_experiment
):
    of_fx = of_experiment["Fx", PAIR]
    headline = results.residuals[results.residuals["headline"]]
    tests = statistics(headline, results.subjects, EXPERIMENT_3, headline)
    rows = tests.query(f"axis == 'Fx' and test == 'mixed model' and effect == '{PAIR}'")
    assert {*rows["n"]} == {of_fx.subjects} == {11}
    assert {*rows["note"]} == {f"{of_fx.recordings} recordings"} == {"21 recordings"}


def test_groups_are_compared_in_every_cell_and_in_what_cells_differ_by(results):
    design = replace(design_of(("baseline", "pitch"), compensated=False), group="group")
    large = compared(results, design, group=[*"pppppcccccc"])
    labels = {label for curve, label in large if curve == "Fx"}
    cells = ("pitch - baseline", "pitch", "baseline")
    assert labels == {cells[0], *(f"{cell}: p - c" for cell in cells)}
    assert large["Fx", "pitch: p - c"].subjects == 11
    # of four people in a group nothing is said
    assert {label for _, label in compared(results, design, group=[*"ppppccccccc"])} == {cells[0]}


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
