"""Frames in which the plates do not carry the whole subject do not count, and all others do."""

from types import SimpleNamespace

import numpy as np
import pytest

from hbm.signals.filtering import low_pass
from pipeline.config.schema import Settings
from pipeline.trial.gait.carried import Support

WEIGHT_N, LENGTH_M, RATE_HZ = 700.0, 0.26, 100.0
TIME = np.arange(800) / RATE_HZ
BODY = SimpleNamespace(
    mass=WEIGHT_N / 9.80665, lengths={"left_foot": LENGTH_M, "right_foot": LENGTH_M}
)
LEFT_BELT = np.array([[0.85, 0.5, 0], [0.85, 0, 0], [-0.85, 0, 0], [-0.85, 0.5, 0]])
BELTS = np.stack([LEFT_BELT, LEFT_BELT - [0, 0.5, 0]])
BOTH = np.tile([0, 1], (len(TIME), 1))


def stance(side, stride_s=1.1, share=0.6):
    """Phase of a foot's step, below 1 in stance, (T,)."""
    return np.mod(TIME / stride_s + 0.5 * side, 1) / share


def walking(sideways_m=(0.25, -0.25), speed=1.2, stride_s=1.1, share=0.6):
    """Places of pelvis, ankles and balls on belts, and the vertical load of each foot."""
    places, loads = np.zeros((len(TIME), 5, 3)), []
    places[:, 0, 2] = 0.9
    for side in (0, 1):
        phase = stance(side, stride_s, share)
        on, swing = phase < 1, (phase - 1) * share / (1 - share)
        way = speed * stride_s * share
        forward = np.where(
            on, way * (0.5 - phase), way * (swing - 0.5 - np.sin(2 * np.pi * swing) / 6)
        )
        lift = np.where(on, 0.0, 0.1 * np.sin(np.pi * np.clip(swing, 0, 1)))
        for joint, ahead, up in ((1 + side, 0.0, 0.08), (3 + side, 0.13, 0.03)):
            places[:, joint] = np.column_stack(
                [forward + ahead, np.full(len(TIME), sideways_m[side]), lift + up]
            )
        loads.append(np.where(on, np.clip(np.minimum(phase, 1 - phase) * 8, 0, 1), 0.0))
    total = np.maximum(np.sum(loads, axis=0), 1e-9)
    return places, np.array([WEIGHT_N * load / total for load in loads])


def wrenches_of(places, loads):
    """The plates' wrenches, each under the middle of its foot, (T, 2, 6)."""
    wrenches = np.zeros((len(TIME), 2, 6))
    for k in (0, 1):
        middle = (places[:, 1 + k] + places[:, 3 + k]) / 2
        force = np.column_stack([0 * loads[k], 0 * loads[k], loads[k]])
        wrenches[:, k] = np.hstack([force, np.cross(middle * [1, 1, 0], force)])
    return wrenches


def rules(method):
    return Settings(contact_threshold_n=30.0, cutoff_hz=6.0, filter=method)


def carried(places, loads, *, corners=BELTS, method="zero_phase", mass=1.0):
    body = SimpleNamespace(mass=mass * BODY.mass, lengths=BODY.lengths)
    need = np.full(len(TIME), mass * WEIGHT_N)
    support = Support(body, corners, rules(method))
    wrenches = wrenches_of(places, loads)
    return support.carried(support.feet(TIME, places), wrenches, BOTH, need, loads.sum(axis=0))


@pytest.mark.parametrize(("gain", "mass"), [(0.7, 1.25), (1.0, 1.0), (1.3, 0.8)])
def test_walking_on_plates_is_carried_whatever_their_gain_and_the_mass(mass, gain):
    places, loads = walking()
    assert carried(places, gain * loads, mass=mass).all()


def test_a_step_half_beside_a_plate_is_not_carried_whatever_it_measures():
    """The sole is 10 cm wide; the outer edge of the belt is at 0.5 m."""
    places, loads = walking()
    step = (TIME > 3.0) & (TIME < 4.0)
    places[step, 1, 1] += 0.25
    places[step, 3, 1] += 0.25
    for share in (0.0, 0.5, 1.0):
        scaled = loads.copy()
        scaled[0, step] *= share
        for mass in (0.9, 1.0, 1.1):
            valid = carried(places, scaled, mass=mass)
            assert not valid[step & (loads[0] > 100)].any()
            assert valid[(TIME < 2.6) | (TIME > 4.5)].all()


def test_a_foot_on_a_plate_that_measures_nothing_is_not_carried():
    places, loads = walking()
    loads[1] = 0.0
    assert not carried(places, loads)[(stance(1) < 1) & (TIME > 0.2)].any()


RUNNING = {"speed": 3.0, "stride_s": 0.72, "share": 0.35}


def runner(later_s=0.0):
    """Places of a runner, and half sines of load whose mean is the body weight."""
    places, _ = walking(**RUNNING)
    peak_n = np.pi * WEIGHT_N / (4 * RUNNING["share"])
    phase = [
        np.mod((TIME - later_s) / RUNNING["stride_s"] + side / 2, 1) / RUNNING["share"]
        for side in (0, 1)
    ]
    return places, np.array([peak_n * np.sin(np.pi * p) * (p < 1) for p in phase])


def carried_runner(loads, method="zero_phase"):
    places, needed = runner()
    need, measured = (low_pass(x.sum(axis=0), TIME, 6.0, method) for x in (needed, loads))
    support = Support(BODY, BELTS, rules(method))
    feet, wrenches = support.feet(TIME, places), wrenches_of(places, loads)
    return support.carried(feet, wrenches, BOTH, need, measured)


@pytest.mark.parametrize("method", ["zero_phase", "realtime"])
@pytest.mark.parametrize("later_s", [0.0, 0.03, -0.02])
def test_a_runner_on_plates_that_are_late_is_carried_throughout(later_s, method):
    """The pressure of a late plate is where the foot is when it is measured."""
    assert carried_runner(runner(later_s)[1], method=method)[20:-20].all()


def test_a_step_that_no_plate_measures_does_not_count_in_running_either():
    loads = runner(0.02)[1]
    step = (TIME > 4 * 0.72 - 0.05) & (TIME < 4.5 * 0.72)
    loads[0, step] = 0.0
    valid = carried_runner(loads)
    assert not valid[step & (runner()[1][0] > WEIGHT_N)].any()
    assert valid[(TIME < 2.4) & (TIME > 0.2) | (TIME > 4.0) & (TIME < 7.8)].all()


def test_a_foot_whose_plate_has_no_corners_stands_where_the_pressure_is():
    places, loads = walking()
    assert carried(places, loads, corners=np.full((2, 4, 3), np.nan)).all()


def test_a_raised_foot_needs_no_plate():
    """Standing on the left leg for as long as one likes."""
    places, _ = walking()
    places[:] = places[0]
    places[:, [2, 4], 2] += 0.2
    assert carried(places, np.array([np.full(len(TIME), WEIGHT_N), 0 * TIME])).all()
