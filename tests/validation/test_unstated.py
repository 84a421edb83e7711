"""What the thesis does not state: estimated from half of its table, judged by the other half."""

import numpy as np
import pytest

from tests.validation.table_3 import CELLS, LENGTHS_S, THESIS_SUBJECTS
from tests.validation.unstated import (
    DESIGN,
    ESTIMATED,
    FITTED,
    POSES,
    Response,
    estimate,
    fit_response,
    judge,
    unstated_at,
)

WINDOW_S = 0.35
TRUE = np.array([0.4, -0.3, 0.5, 0.2, np.log(WINDOW_S)])
SHARE = 0.05


def made_up_logs(pose, z, length_s):
    """Cells of a laboratory that is not ours: smooth in all that is not stated."""
    rng = np.random.default_rng(POSES.index(pose))
    base, slope, bend = rng.uniform(2, 6, 36), rng.normal(0, 0.5, (36, 4)), rng.normal(0, 0.1, 36)
    window = np.where(CELLS.get_level_values("condition") == "sway", -0.6, 0.0)
    return base + slope @ z[:4] + bend * z[0] * z[1] + window * np.log(length_s)


def made_up_response(pose, level=0.0, spread=0.0):
    """What is fitted to them, with all cells too high by ``level``, as sampled subjects are."""
    logs = np.stack([[made_up_logs(pose, z, s) for s in LENGTHS_S] for z in DESIGN])
    shift = np.broadcast_to(level, logs.shape[1:])
    return fit_response(logs, shift, np.full(36, spread))


@pytest.fixture(scope="module")
def responses():
    return {pose: made_up_response(pose) for pose in POSES}


def table(mean, sd):
    return CELLS.to_frame(index=False).assign(mean=mean, sd=sd)


def printed(pose):
    """The table of a laboratory whose values are known, without chance."""
    mean = np.exp(made_up_logs(pose, TRUE, WINDOW_S))
    return table(mean, SHARE * mean)


def sampled(pose, rng):
    """The table of nine people of that laboratory."""
    mean = np.exp(made_up_logs(pose, TRUE, WINDOW_S))
    people = mean * (1 + SHARE * rng.normal(size=(THESIS_SUBJECTS, 36)))
    return table(people.mean(axis=0), people.std(axis=0, ddof=1))


@pytest.mark.parametrize("pose", POSES)
def test_a_laboratory_is_found_from_the_cells_without_compensation(responses, pose):
    found = estimate(responses, printed(pose))
    true = unstated_at(TRUE, pose)
    assert found.value.pose == pose
    for name in ESTIMATED:
        assert getattr(found.value, name) == pytest.approx(getattr(true, name), rel=0.02), name
        assert getattr(found.low, name) < getattr(true, name) < getattr(found.high, name)
    assert found.at_edge == ()
    assert found.predicted[pose] == pytest.approx(printed(pose)["mean"].to_numpy(), rel=0.01)
    assert min(found.misfit, key=found.misfit.get) == pose


@pytest.mark.parametrize("pose", POSES)
def test_cells_with_compensation_change_nothing_of_the_estimate(responses, pose):
    """Even if they are those of a laboratory with the other pose."""
    own, opposite = printed(pose), printed(next(name for name in POSES if name != pose))
    other = own.assign(mean=np.where(own["compensated"], opposite["mean"], own["mean"]))
    other = other.assign(sd=np.where(own["compensated"], opposite["sd"] / 3, own["sd"]))
    first, second = (estimate(responses, cells) for cells in (own, other))
    assert first.value.pose == pose
    assert (first.value, first.low, first.high) == (second.value, second.low, second.high)
    assert first.misfit == second.misfit
    assert (first.error == second.error).all()


def test_cells_that_depend_on_a_window_that_is_not_known_have_the_error_of_every_window():
    own = made_up_response("none")
    size = np.where(FITTED | (CELLS.get_level_values("condition") != "sway"), 0.0, -1.0)
    unknown = own.coefficients[:1] + 0.0 * own.coefficients
    unknown[:, 0] += size * np.log(LENGTHS_S)[:, None]
    response = Response(unknown, own.error)
    mean = response.at(TRUE)
    found = estimate({"none": response}, table(mean, SHARE * mean))
    assert (found.low.window_s, found.high.window_s) == (LENGTHS_S[0], LENGTHS_S[-1])
    ratio = max(found.value.window_s / LENGTHS_S[0], LENGTHS_S[-1] / found.value.window_s)
    at_least = (1 - 1 / ratio) * found.predicted["none"]
    assert (found.error[size < 0] > 0.9 * at_least[size < 0]).all()
    assert (found.error[size == 0] < 0.2 * at_least[size == 0]).all()


def test_intervals_hold_the_true_values_as_often_as_they_state():
    """Chance is in the thesis' nine people and in the nine that are simulated."""
    inside = []
    true = unstated_at(TRUE, "none")
    for seed in range(25):
        rng = np.random.default_rng(seed)
        error = SHARE / np.sqrt(THESIS_SUBJECTS)
        own = made_up_response("none", error * rng.normal(size=36), error)
        found = estimate({"none": own}, sampled("none", rng))
        inside += [
            getattr(found.low, name) <= getattr(true, name) <= getattr(found.high, name)
            for name in ESTIMATED
        ]
    assert 0.93 < np.mean(inside) < 1.0


def people(mean, rng, count=9):
    return mean * (1 + SHARE * rng.normal(size=(count, 36)))


def test_true_cells_are_explained_as_often_as_chance_says():
    rng = np.random.default_rng(5)
    mean = np.exp(made_up_logs("none", TRUE, WINDOW_S))
    shares = [judge(people(mean, rng), sampled("none", rng))["explained"].mean() for _ in range(40)]
    assert np.mean(shares) == pytest.approx(0.95, abs=0.02)


def test_a_cell_of_another_laboratory_is_named_unexplained_and_no_other():
    cell = ("pitch", "My")
    mean = np.exp(made_up_logs("none", TRUE, WINDOW_S))
    spread = np.linspace(-SHARE, SHARE, 9)[:, None]
    off = np.where(CELLS.isin([(cell[0], True, cell[1])]), 1.2, 1.0)
    judged = judge(mean * (1 + spread), table(off * mean, SHARE * mean))
    assert len(judged) == 18
    missed = judged.loc[~judged["explained"], ["condition", "axis"]]
    assert missed.to_numpy().tolist() == [list(cell)]


def test_agreement_within_more_than_half_of_a_cell_is_undecided():
    mean = np.exp(made_up_logs("none", TRUE, WINDOW_S))
    simulated = people(mean, np.random.default_rng(1))
    sharp = judge(simulated, table(mean, SHARE * mean))
    assert not sharp["undecided"].any()
    blunt = judge(simulated, table(mean, 0.9 * mean))
    assert (blunt["tolerance"] > 0.5 * blunt["thesis"]).all()
    assert blunt["undecided"].all()
    assert not blunt["explained"].any()
    other = judge(10 * simulated, table(mean, 0.9 * mean))
    assert not (other["undecided"] | other["explained"]).any()
