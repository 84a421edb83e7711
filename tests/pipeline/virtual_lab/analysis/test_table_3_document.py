"""What docs/table_3.md says in words, recomputed from the numbers beside it."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.virtual_lab.analysis.empty_plate import THESIS_RUNNING_N
from pipeline.virtual_lab.analysis.printed_table_3 import printed_cells, removed
from pipeline.virtual_lab.analysis.reproduction import AS_IS, DOCUMENTED, ESTIMATED

DOCS = Path(__file__).parents[4] / "docs"


@pytest.fixture(scope="module")
def page():
    return (DOCS / "table_3.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def text(page):
    return " ".join(page.split())


@pytest.fixture(scope="module")
def cells():
    """Mean of every headline cell by laboratory, condition, compensated and axis."""
    table = pd.read_csv(DOCS / "table_3.csv")
    keys = ["laboratory", "condition", "compensated", "axis"]
    return table[table["headline"]].set_index(keys)["mean"].sort_index()


@pytest.fixture(scope="module")
def thesis():
    return printed_cells().set_index(["condition", "compensated", "axis"]).sort_index()


def rows(page, head):
    """The cells of the table with this head, as lists."""
    table = page.split(head)[1].split("\n\n")[0]
    return [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]


def numbers(cell):
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", cell)]


def test_both_fits_miss_by_more_than_chance(text):
    found = re.findall(r"(\d+) for (\d+) degrees of freedom", text)
    limits = re.findall(r"below (\d+) in 95 %", text)
    assert len(found) == len(limits) == 2
    assert all(
        float(misfit) > float(limit) for (misfit, _), limit in zip(found, limits, strict=True)
    )
    assert "The fit is with the platform's pose" in text
    with_pose, without = numbers(text.split("in standard errors, is ")[1].split("without it")[0])[
        ::2
    ]
    assert with_pose < without


def test_a_flexible_machine_shakes_more_and_compensation_removes_that_but_not_the_thesis(
    text, cells, thesis
):
    assert "**A flexible machine is not what is missing.**" in text
    shaken, calmed = (cells.loc[ESTIMATED, "baseline", ic] for ic in (False, True))
    assert (shaken > cells.loc[DOCUMENTED, "baseline", False]).all()
    left = calmed / shaken
    left_in_thesis = thesis.loc["baseline", True]["mean"] / thesis.loc["baseline", False]["mean"]
    assert left.max() < 0.7 < 0.8 < left_in_thesis.min()


def test_the_empty_plate_beside_a_runner_rules_the_estimated_machine_out(page):
    *machines, own = rows(page, "| Flexibility | Lowest modes")
    assert numbers(own[2]) == list(THESIS_RUNNING_N)
    found = {numbers(row[0])[0]: [np.array(numbers(cell)) for cell in row[1:]] for row in machines}
    (_, _, default), (_, four_raw, _) = found.pop(1.0), found.pop(4.0)
    assert (default < THESIS_RUNNING_N).all()
    assert (four_raw > THESIS_RUNNING_N).all()
    assert len(found) == 2
    for modes, _, filtered in found.values():
        assert modes[0] < 6
        assert (filtered > 2 * np.array(THESIS_RUNNING_N)).all()


def test_elsewhere_compensation_removes_less_than_a_fifth_in_the_thesis(text, thesis):
    assert "In the others compensation removes less than a fifth" in text
    means = thesis["mean"].unstack("compensated")
    others = means.drop(index=removed(printed_cells()))
    assert len(others) == 13
    assert (others[True] > 0.8 * others[False]).all()


def test_in_sway_the_window_decides_on_a_stiff_machine_and_not_how_mz_and_fy_are_related(page):
    own = rows(page, "| Window | Fy (N)")
    table = {row[0]: np.array([numbers(cell)[0] for cell in row[1:]]) for row in own}
    lengths = ["0.3 s", "0.4 s", "0.5 s", "0.7 s", "0.9 s"]
    assert (np.diff([table[name] for name in lengths], axis=0) < 0).all()
    thesis = table.pop("thesis")
    ratios = [values[2] / values[0] for values in table.values()]
    assert max(ratios) < 1.1 * min(ratios)
    assert thesis[2] / thesis[0] > 1.3 * max(ratios)
    forces = np.array([list(map(float, row[1:])) for row in rows(page, "| Window | 4 Hz")])
    assert (forces.max(axis=0) > thesis[0]).all()
    assert (forces.min(axis=0) < thesis[0]).all()
    ringing, still = numbers(" ".join(page.split("rings\non:")[1].split())[:110])[2:4]
    assert ringing > 1.2 * still


def test_what_is_documented_explains_neither_the_baseline_nor_pitch(cells, thesis):
    base, own = thesis.loc["baseline"]["mean"], cells.loc[AS_IS, "baseline"]
    change = (cells.loc[DOCUMENTED, "baseline"] - own).abs()
    gap = (base - own).loc[(slice(None), ["Fx", "Fy", "Fz", "My"])]
    assert (gap > 5 * change.loc[gap.index]).all()
    assert (base / own).mean() > 1.5
    pitch = cells.loc[DOCUMENTED, "pitch", True][["Fx", "Fy"]]
    assert (pitch < 0.5 * thesis.loc["pitch", True]["mean"][["Fx", "Fy"]]).all()


def test_the_subjects_of_the_thesis_differed_widely_in_pitch(thesis):
    compensated = thesis.loc["pitch", True].loc[["Fx", "Fy", "Mx", "Mz"]]
    own = thesis.loc["pitch"].loc[(slice(None), ["Fy", "Mx", "Mz"]), :]
    for share in (compensated["sd"] / compensated["mean"], own["sd"] / own["mean"]):
        assert share.between(0.595, 0.86).all()
    means = own["mean"].unstack("compensated")
    assert (1 - means[True] / means[False]).between(0, 0.0715).all()
