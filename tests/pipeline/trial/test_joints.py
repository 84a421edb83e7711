"""Joints over gait cycles conserve energy, on both sides, and their peaks fit the curves."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from hbm.coordinates import INDEX, MOVING
from hbm.poses import segment_frames
from hbm.spatial import GRAVITY_MPS2, shift_wrench
from pipeline.config.schema import Settings, Subject
from pipeline.io.recording import Plate
from pipeline.run.load import _joint_cycles
from pipeline.trial.joints import (
    CURVES,
    JOINT_COLUMNS,
    JOINT_MOTIONS,
    QUANTITIES,
    joint_curves,
    joint_rows,
    joint_spans,
    quantities,
)
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality, frames_within, free_of
from tests.pipeline import lab
from tests.recordings.recorded import recorded, treadmill

LEG_JOINTS = ("HipFlexion", "HipAbduction", "KneeFlexion", "AnklePlantarFlexion")


@pytest.fixture(scope="module")
def virtual(processed):
    return processed


@pytest.fixture(scope="module")
def real(shared_data):
    recording, known = recorded(treadmill, shared_data)
    return process_recording(recording, settings=Settings(), **known)


def rate(time, values):
    return CubicSpline(time, values).derivative()(time)


def spin(rotation, time):
    """Angular velocity in the lab, (T, 3), of rotations (T, 3, 3)."""
    turning = np.einsum("tij,tkj->tik", rate(time, rotation), rotation)
    return np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)


def rate_of_energy(result, time, rotation, origin):
    """Of motion and of height, from positions alone, (T,) [W]."""
    energy = np.zeros(len(time))
    for name, part in result.body.rigid_bodies.items():
        k = MOVING.index(name)
        place = origin[:, k] + rotation[:, k] @ part.center
        velocity, omega = rate(time, place), spin(rotation[:, k], time)
        of_segment = np.einsum("tij,ti->tj", rotation[:, k], omega)
        energy += part.mass * (np.sum(velocity**2, axis=1) / 2 + GRAVITY_MPS2 * place[:, 2])
        energy += np.einsum("ti,ij,tj->t", of_segment, part.tensor, of_segment) / 2
    return rate(time, energy)


def power_of_ground(result, variant, time, rotation, origin):
    """Of the wrenches on the feet, which move, (T,) [W]."""
    power = np.zeros(len(time))
    for foot, wrench in result.ground[variant].items():
        k = MOVING.index(foot)
        velocity, omega = rate(time, origin[:, k]), spin(rotation[:, k], time)
        moment = wrench[:, 3:] - np.cross(origin[:, k], wrench[:, :3])
        power += np.sum(wrench[:, :3] * velocity, axis=1) + np.sum(moment * omega, axis=1)
    return power


@pytest.mark.parametrize("name", ["virtual", "real"])
def test_powers_of_joints_residual_and_ground_are_the_rate_of_energy(name, request):
    """Energy from positions of segments, differentiated; powers from the result."""
    result = request.getfixturevalue(name)
    time = result.motion.time
    rotation, origin = segment_frames(result.body, result.motion.q)
    expected = rate_of_energy(result, time, rotation, origin)
    for variant, dynamics in result.variants.items():
        joints = dynamics.power[:, 6:].sum(axis=1)
        residual = dynamics.power[:, :6].sum(axis=1)
        ground = power_of_ground(result, variant, time, rotation, origin)
        off = (joints + residual + ground - expected)[result.counts & np.isfinite(joints)]
        assert len(off) > 500
        assert np.sqrt(np.mean(off**2)) < 0.02 * np.std(expected[result.counts])


def test_curves_are_the_model_s_coordinates_forces_and_powers_over_cycles(virtual):
    curves = joint_curves(virtual)["compensated"]
    for side, letter in (("right", "R"), ("left", "L")):
        (start, stop), own = joint_spans(virtual)[side][0], curves[side][0]
        at = start + (stop - start) * np.linspace(0, 1, 101)
        k = INDEX[f"{letter}KneeFlexion"]
        knee = own[:, [m.name for m in JOINT_MOTIONS].index("knee_flexion")]
        angle = np.interp(at, virtual.motion.time, np.degrees(virtual.motion.q[:, k]))
        np.testing.assert_allclose(knee[:, 0], angle, atol=0.5)
        speed = np.interp(at, virtual.motion.time, virtual.motion.v[:, k])
        np.testing.assert_allclose(knee[:, 2], knee[:, 1] * speed, atol=0.1)


def test_a_trunk_that_bends_to_the_right_bends_to_the_side_of_right_cycles_only(virtual):
    bent = virtual.motion.q.copy()
    bent[:, INDEX["TrunkRightBend"]] = 0.2
    curves = joint_curves(replace(virtual, motion=replace(virtual.motion, q=bent)))["measured"]
    k = [motion.direction for motion in JOINT_MOTIONS].index("ipsilateral bend")
    assert np.nanmean(curves["right"][:, :, k, 0]) == pytest.approx(np.degrees(0.2))
    assert np.nanmean(curves["left"][:, :, k, 0]) == pytest.approx(-np.degrees(0.2))


def summary_of(trial):
    return pd.DataFrame(joint_rows(trial, "any", joint_curves(trial)), columns=JOINT_COLUMNS)


def test_where_cycles_of_one_side_count_those_of_the_other_are_of_the_same_time(virtual):
    walk = virtual
    assert [side for side, own in walk.cycles.items() if len(own)] == ["right"]
    spans = joint_spans(walk)
    assert len(spans["left"]) >= len(spans["right"]) - 1 > 0
    assert spans["left"].min() >= spans["right"].min()
    assert spans["left"].max() <= spans["right"].max()


def test_peaks_ranges_and_work_are_those_of_the_curves(virtual):
    summary = summary_of(virtual)
    own = summary.query("compensated and side == 'right' and joint == 'ankle'")
    own = own[own["direction"] == "plantarflexion"].set_index("quantity")["value"]
    assert set(own.index) == set(QUANTITIES)
    assert own["range of motion"] == pytest.approx(
        own["largest angle"] - own["smallest angle"], rel=0.2
    )
    curves = joint_curves(virtual)["compensated"]["right"]
    k = [motion.name for motion in JOINT_MOTIONS].index("ankle_plantarflexion")
    assert own["largest moment"] == pytest.approx(np.nanmax(curves[:, :, k, 1], axis=1).mean())
    # net work: the integral of the power over all frames, by splines
    time, power = virtual.motion.time, virtual.compensated.power[:, INDEX["RAnklePlantarFlexion"]]
    known = np.isfinite(power)
    integral = CubicSpline(time[known], power[known]).antiderivative()
    net = np.diff(integral(joint_spans(virtual)["right"]))[:, 0] / virtual.body.mass
    assert own["positive work"] + own["negative work"] == pytest.approx(net.mean(), abs=2e-3)
    stored = _joint_cycles(virtual, joint_curves(virtual)).to_pandas()
    stored = stored.query("compensated and side == 'right' and cycle == 1")
    for c, name in enumerate(CURVES):
        values = stored[f"ankle_plantarflexion_{name}"].to_numpy()
        np.testing.assert_allclose(values, curves[0, :, k, c], rtol=1e-6, atol=1e-5)


def test_work_is_the_integral_over_the_cycle():
    """Of a power of sin² with a period of the cycle: half of its duration, and no more."""
    curves = np.zeros((1, 101, len(JOINT_MOTIONS), len(CURVES)))
    curves[..., 2] = np.cos(np.pi * np.linspace(0, 1, 101))[:, None] ** 2
    rows = {row[:3]: row[4] for row in quantities(curves, np.array([1.1]))}
    assert rows["ankle", "plantarflexion", "positive work"] == pytest.approx(0.55)
    assert rows["ankle", "plantarflexion", "negative work"] == 0


def test_an_extreme_that_may_be_hidden_is_not_reported():
    """A peak at 50 % of three cycles, of which unknown instants hide it, its foot, and nothing."""
    peak = np.exp(-(((np.arange(101) - 50) / 8) ** 2))
    curves = np.tile(peak[:, None, None], (3, 1, len(JOINT_MOTIONS), len(CURVES)))
    curves[0, 45:60] = curves[1, 70:85] = np.nan
    rows = {row[:3]: row for row in quantities(curves, np.ones(3))}
    *_, value, _, percent, count = rows["ankle", "plantarflexion", "largest moment"]
    assert (value, percent, count) == (1.0, 50.0, 2)
    curves[:, 45:60] = np.nan
    names = {row[2] for row in quantities(curves, np.ones(3))}
    assert "largest moment" not in names
    assert "smallest moment" in names


def test_on_one_plate_moments_of_legs_are_those_of_two_or_unknown(tmp_path):
    """A walk whose feet have a plate each, and the same walk on one plate for both."""
    walk = lab.walk(tmp_path)
    corners = np.concatenate([plate.corners for plate in walk.plates])
    low, high = corners.min(axis=0), corners.max(axis=0)
    outline = [[low[0], low[1]], [low[0], high[1]], [high[0], high[1]], [high[0], low[1]]]
    together = Plate(
        1,
        walk.plates[0].time,
        shift_wrench(sum(plate.wrench for plate in walk.plates), corners.mean(axis=0)),
        np.eye(3),
        corners.mean(axis=0),
        np.insert(np.array(outline), 2, 0.0, axis=1),
    )
    known = {"subject": Subject(sex="male", mass_kg=74.6), "settings": Settings()}
    on_two = process_recording(walk, **known)
    on_one = process_recording(replace(walk, plates=(together,)), **known)
    np.testing.assert_allclose(on_one.measured.residual, on_two.measured.residual, atol=1e-6)

    inside = on_one.counts & frames_within(on_one.motion.time, *on_one.cycles.values())
    columns = [INDEX[f"{side}{joint}"] for side in "LR" for joint in LEG_JOINTS]
    error = np.abs(on_one.measured.tau - on_two.measured.tau)[:, columns].max(axis=1)
    uncertain = ~free_of(on_one.quality, Quality.FOOT_UNCERTAIN)
    assert np.isnan(error[uncertain]).all()
    assert np.nanmax(error[inside & ~uncertain]) < 0.1 * on_one.body.mass
    assert np.mean(~uncertain[inside]) > 0.3


def test_an_ankle_s_peak_does_not_hold_the_other_foot_s_load(real):
    """In some cycles of this walk the right heel lands on the left plate, with up to 300 N."""
    summary = summary_of(real)
    peak = summary.query("joint == 'ankle' and quantity == 'largest moment' and side == 'left'")
    peak = peak[peak["direction"] == "plantarflexion"].iloc[0]
    assert peak["value"] == pytest.approx(1.30, abs=0.03)
    assert peak["sd"] < 0.03
    assert peak["n_cycles"] >= 4
