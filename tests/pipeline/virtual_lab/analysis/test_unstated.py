"""What the thesis does not state: estimated from half of its table, judged by the other half."""

import numpy as np
import pandas as pd
import pytest

from pipeline.trial.residuals import AXES
from pipeline.virtual_lab.analysis.reproduction import LENGTHS_S
from pipeline.virtual_lab.analysis.unstated import (
    CENTER,
    DESIGN,
    KEYS,
    REACH,
    THESIS_SUBJECTS,
    estimate,
    fit_response,
)
from pipeline.virtual_lab.protocol.walking_protocol import ANALYSED_CONDITIONS

CELLS = pd.MultiIndex.from_product([ANALYSED_CONDITIONS, (False, True), AXES], names=KEYS)
TRUE = np.array([0.4, -0.3, 0.5])
WINDOW_S = 0.35
FLOOR = dict(zip(AXES, (30.0, 25.0, 50.0, 8.0, 15.0, 3.0), strict=True))


def made_up_logs(pose, z, length_s):
    """Cells of a laboratory that is not ours: smooth in all that is not stated."""
    rng = np.random.default_rng(3 if pose == "channels" else 4)
    base, slope, bend = rng.uniform(2, 6, 36), rng.normal(0, 0.5, (36, 3)), rng.normal(0, 0.1, 36)
    window = np.where(CELLS.get_level_values("condition") == "sway", -0.6, 0.0)
    return base + slope @ z + bend * z[0] * z[1] + window * np.log(length_s)


@pytest.fixture(scope="module")
def responses():
    return {
        pose: fit_response(
            np.stack([[made_up_logs(pose, z, s) for s in LENGTHS_S] for z in DESIGN]), CELLS
        )
        for pose in ("channels", "none")
    }


def printed(pose, rng=None, share=0.05):
    """A table of nine people in a laboratory whose values are known."""
    simulated = np.exp(made_up_logs(pose, TRUE, WINDOW_S))
    floor = np.array([FLOOR[axis] for axis in CELLS.get_level_values("axis")])
    mean = np.hypot(simulated, floor)
    sd = share * mean
    if rng is not None:
        mean = mean + sd / np.sqrt(THESIS_SUBJECTS) * rng.normal(size=36)
    return CELLS.to_frame(index=False).assign(mean=mean, sd=sd)


@pytest.mark.parametrize("pose", ["channels", "none"])
def test_a_laboratory_is_found_from_the_cells_without_compensation(responses, pose):
    found = estimate(responses, printed(pose))
    expected = np.exp((CENTER + REACH * TRUE)[:2])
    assert found.value.pose == pose
    assert (found.value.sway_hz, found.value.assembly_kg) == pytest.approx(
        tuple(expected), rel=0.02
    )
    assert found.value.place_forward_m == pytest.approx(REACH[2] * TRUE[2], abs=0.01)
    assert found.value.window_s == pytest.approx(WINDOW_S, rel=0.03)
    assert found.floor == pytest.approx(FLOOR, rel=0.15)
    assert found.cells["explained"].all()


def test_cells_with_compensation_change_nothing_of_the_estimate(responses):
    table = printed("channels")
    other = table.assign(mean=np.where(table["compensated"], 7 * table["mean"], table["mean"]))
    first, second = estimate(responses, table), estimate(responses, other)
    assert first.value == second.value
    judged = second.cells[~second.cells["used"]]
    assert not judged["explained"].any()


def test_intervals_hold_the_true_values_as_often_as_they_state(responses):
    inside = []
    for seed in range(60):
        found = estimate(responses, printed("channels", np.random.default_rng(seed)))
        for name, true in (
            ("assembly_kg", np.exp(CENTER[1] + REACH[1] * TRUE[1])),
            ("place_forward_m", REACH[2] * TRUE[2]),
            ("sway_hz", np.exp(CENTER[0] + REACH[0] * TRUE[0])),
        ):
            low, high = (getattr(end, name) for end in (found.low, found.high))
            inside.append(low <= true <= high)
    assert 0.88 < np.mean(inside) <= 1.0
