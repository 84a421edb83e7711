"""The study of the published compensation is right on machines of which the answer is known."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from tests.flexible_treadmill import FlexibleTreadmill, as_recording
from tests.validation import published_compensation as published
from tests.validation.published_compensation import METHODS, NONE, SETUP, SIZES

SECONDS = 10.0
"""Of each recording."""
RIGID, QUIET = 1e-8, 0.01
"""Flexibility and noise by those of the study; without any noise our fit is ill-conditioned."""
WRENCH = np.array([3.0, -2.0, 40.0, 5.0, -7.0, 1.0])


@pytest.fixture(scope="module")
def rigid():
    machine = FlexibleTreadmill(3, RIGID, QUIET)
    signal = machine.record(1, sway=0.7, pitch=2.2, highest_hz=5.0, seconds=SECONDS)
    people = [
        machine.record(2, person="walking", seconds=SECONDS),
        machine.record(3, person="boards", seconds=SECONDS),
    ]
    trial = machine.record(4, sway=0.5, pitch=1.0, person="walking", seconds=SECONDS)
    first, *beside = (as_recording(f"{n}.c3d", one) for n, one in enumerate((signal, *people)))
    return published.Session(first, beside, {"sway": as_recording("trial.c3d", trial)})


@pytest.mark.parametrize("sensors", [2, 4])
def test_all_methods_recover_a_rigid_machine_with_hardly_any_noise(rigid, sensors):
    left = published.left_over(rigid, sensors)
    assert len(left) == len(METHODS)
    for (_, method), (wrench, _) in left.items():
        if method == NONE:
            assert published.size(wrench[:, :3]) > 50
        else:
            assert np.abs(wrench).max() < 0.1, method


def test_a_machine_that_bends_leaves_more_than_a_rigid_one(rigid):
    machine = FlexibleTreadmill(3, 1.0, QUIET)
    trial = machine.record(4, sway=0.5, pitch=1.0, person="walking", seconds=SECONDS)
    bending = rigid._replace(trials={"sway": as_recording("trial.c3d", trial)})
    wrench, _ = published.left_over(bending, 4)["sway", published.PUBLISHED]
    assert published.size(wrench[:, :3]) > 0.5


def test_an_error_acts_about_mid_hip_hip_and_ankle_of_the_leg_that_stands():
    joints = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.1, 0.9]]), np.array([[0.1, 0.1, 0.1]])
    person = published.Walker(50.0, *(np.repeat(j, 4, axis=0) for j in joints), np.arange(4) < 2)
    error = np.tile(WRENCH, (9, 1))
    error[2::4], error[3::4] = 100 * WRENCH, 100 * WRENCH  # in swing, which the leg does not feel
    found = published.felt_by(person, error[:8], 100.0)
    force, moment = WRENCH[:3], WRENCH[3:]
    hip, ankle = (moment - np.cross(joint[0], force) for joint in joints[1:])
    assert found["hip"] == pytest.approx(np.linalg.norm(hip) / 50)
    assert found["ankle"] == pytest.approx(np.linalg.norm(ankle) / 50)
    about = np.linalg.norm(moment - np.cross(joints[0][0], force))
    assert about < found["pelvis_moment"] < 100 * about


def test_the_walker_stands_on_the_left_leg_for_more_than_half_of_the_time():
    person = published.walker()
    assert 0.55 < person.stance.mean() < 0.7
    height = [getattr(person, name)[:, 2].mean() for name in ("ankle", "hip", "pelvis")]
    assert 0.05 < height[0] < 0.2 < 0.7 < height[1] < 1.1
    assert (person.hip[:, 1] > person.pelvis[:, 1]).all()


def test_the_interval_of_a_median_of_twenty_is_from_the_sixth_to_the_fifteenth():
    values = pd.Series(np.random.default_rng(0).permutation(20) + 1.0)
    assert [*published.median_and_interval(values)] == [10.5, 6, 15]


def test_shares_are_of_machines_and_of_no_compensation():
    key = dict(zip(SETUP, ("judge", "stiff", "stay", 2, "sway"), strict=True))
    left = {NONE: 10.0, published.PUBLISHED: 2.0, published.STATIC: 1.0}
    rows = [
        {**key, "method": method, "seed": seed, **dict.fromkeys(SIZES, force + (seed == 3))}
        for method, force in left.items()
        for seed in range(4)
    ]
    rows[-1]["force"] = 9.0
    table = published.summary(pd.DataFrame(rows)).set_index("method")
    assert table.loc[published.PUBLISHED, "force_removed"] == pytest.approx(80)
    assert table.loc[published.STATIC, "less_than_published"] == 75


@pytest.mark.parametrize("method", ["belt model as published", "belt model, ours"])
def test_both_belt_models_recover_a_filter_of_their_family(method, monkeypatch):
    rng = np.random.default_rng(0)
    theta = np.array([-1.2, 0.5, 2.0, -1.0, 0.5])

    def recording():
        acceleration = rng.normal(size=3000)
        return acceleration, lfilter(theta[2:], [1, *theta[:2]], acceleration)

    monkeypatch.setattr(published, "filtered_belt", lambda pair: pair)
    rows = {
        row["method"]: row["moment"] for row in published.judge_belt("", recording(), recording())
    }
    assert rows["no compensation"] > 1
    assert rows["static least squares"] > 1
    assert rows[method] < 0.02
