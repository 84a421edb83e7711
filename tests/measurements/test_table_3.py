"""What stands beside the thesis' Table III is what was processed."""

import numpy as np
import pandas as pd
import pytest

from hbm.spatial import GRAVITY_MPS2
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from tests.validation.empty_plate import FORCES, THESIS_RUNNING_N, beside_a_runner
from tests.validation.table_3 import (
    CELLS,
    after_onsets,
    compared,
    printed_cells,
    process,
)

TINY = Setting(
    protocol=Protocol(
        conditions=("sway",),
        subjects=1,
        waits_s=(12.0,),
        calibration="square_sway_60s_3mps",
        beside_s=0.0,
    )
)


def test_every_one_of_the_36_cells_stands_beside_the_printed_one():
    cells = CELLS.to_frame(index=False).merge(printed_cells(), on=[*CELLS.names])
    rows = [
        cells.assign(laboratory="as it is", window="cycle", headline=True, rms=cells["mean"] + off)
        for off in (-1.0, 3.0)
    ]
    table = compared(pd.concat(rows).drop(columns=["mean", "sd"]))
    assert len(table) == 36
    np.testing.assert_allclose(table["mean"] - table["mean_thesis"], 1.0)
    np.testing.assert_allclose(table["sd"], np.sqrt(8))
    assert (table["within"] == (table["sd_thesis"] >= 1)).all()


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Results of one simulated sway trial."""
    return process(TINY, tmp_path_factory.mktemp("lab"), 1)


@pytest.mark.slow
def test_the_shorter_the_window_after_an_onset_the_larger_what_the_treadmill_adds(stored):
    """The platform accelerates when it starts and when it stops, and rests for the remainder."""
    table = after_onsets(stored).set_index(["compensated", "axis", "length_s"])["rms"]
    table = table.sort_index()
    artefact, body = table[False, "Fy"], table[True, "Fy"]
    assert artefact[0.3] > artefact[0.5] > artefact[0.9] > 200
    assert body.max() < 30
    squares = artefact**2 * artefact.index.to_numpy()
    assert squares[0.9] == pytest.approx(squares[0.5], rel=0.1)


@pytest.mark.slow
def test_without_the_pose_the_weight_of_a_person_stays_where_the_platform_was(stored, tmp_path):
    """5 cm beside it, for most of 0.9 s."""
    changed = TINY.protocol.model_copy(update={"pose": "none", "sway_window": 0.9})
    setting = TINY.model_copy(update={"protocol": changed})
    own, moved = (
        after_onsets(results).set_index(["compensated", "axis", "length_s"])["rms"][True, "Mx", 0.9]
        for results in (stored, process(setting, tmp_path, 1))
    )
    weight_n = 83.0 * GRAVITY_MPS2
    assert own < 0.015 * weight_n
    assert 0.03 * weight_n < np.sqrt(moved**2 - own**2) < 0.05 * weight_n


def test_the_thesis_empty_plate_is_that_of_a_machine_up_to_four_times_as_flexible_as_the_default():
    """Table II, row Running; no cell of Table III."""
    found = beside_a_runner([1.0, 4.0, 13.9]).set_index(["flexibility", "filtered"])
    forces = found[list(FORCES)] / np.array(THESIS_RUNNING_N)
    assert (forces.loc[1.0, True] < 1).all()
    assert (forces.loc[1.0, False] < 1.3).all()
    assert (forces.loc[4.0, True] < 1.4).all()
    assert (forces.loc[4.0, False] > 1).all()
    assert (forces.loc[13.9, True] > 3.0).all()
    softness = found.index.get_level_values("flexibility").to_numpy()
    assert (found["sway_hz"] ** 2 * softness).std() < 0.01
