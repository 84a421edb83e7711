"""Joints over gait cycles: energy is conserved, both sides are there, peaks fit the curves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from hbm.coordinates import INDEX, MOVING
from hbm.poses import segment_frames
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Settings
from pipeline.trial.joints import (
    CURVES,
    JOINT_MOTIONS,
    QUANTITIES,
    joint_curves,
    joint_spans,
    joint_tables,
)
from pipeline.trial.process import process_recording
from tests.recordings.recorded import recorded, treadmill


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


def test_where_cycles_of_one_side_count_those_of_the_other_are_of_the_same_time(virtual):
    walk = virtual
    assert [side for side, own in walk.cycles.items() if len(own)] == ["right"]
    spans = joint_spans(walk)
    assert len(spans["left"]) >= len(spans["right"]) - 1 > 0
    assert spans["left"].min() >= spans["right"].min()
    assert spans["left"].max() <= spans["right"].max()


def test_peaks_ranges_and_work_are_those_of_the_curves(virtual):
    summary, cycles = joint_tables(virtual, "pitch")
    own = summary.query("compensated and side == 'right' and joint == 'ankle'")
    own = own[own["direction"] == "plantarflexion"].set_index("quantity")["value"]
    assert set(own.index) == set(QUANTITIES)
    assert own["range of motion"] == pytest.approx(
        own["largest angle"] - own["smallest angle"], rel=0.2
    )
    curves = joint_curves(virtual)["compensated"]["right"]
    k = [motion.name for motion in JOINT_MOTIONS].index("ankle_plantarflexion")
    spans = joint_spans(virtual)["right"]
    net = np.nanmean(curves[:, :, k, 2], axis=1) * np.diff(spans)[:, 0]
    assert own["positive work"] + own["negative work"] == pytest.approx(net.mean())
    assert own["largest moment"] == pytest.approx(np.nanmax(curves[:, :, k, 1], axis=1).mean())
    stored = cycles.query("compensated and side == 'right' and cycle == 1")
    for c, name in enumerate(CURVES):
        values = stored[f"ankle_plantarflexion_{name}"].to_numpy()
        np.testing.assert_allclose(values, curves[0, :, k, c], rtol=1e-6, atol=1e-5)
