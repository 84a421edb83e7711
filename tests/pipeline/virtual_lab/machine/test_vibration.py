"""The structure responds as known limits and a direct integration in time have it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.virtual_lab.machine.platform import (
    BELT_ASSEMBLIES,
    Machine,
    inertial_wrench,
    motion_terms,
    move_platform,
    smooth_step,
    specific_force,
)
from pipeline.virtual_lab.machine.structure import (
    COORDINATES,
    FRAME,
    FRAME_NODES_M,
    STRUCTURE,
    frame_shape,
    make_structure,
    respond,
)

RATE_HZ = 1000.0
SOFT = {"base_hz": (25.0, 7.0, 30.0, 22.0, 7.0, 25.0), "base_damping": (0.05,) * 6}
"""Much softer than the default, so that vibration is large."""
PLACES = (np.array([-0.9, 0.62, -0.2]), np.array([0.95, -0.58, -0.2]))


def smooth_loads(count, seed=0):
    """Wrenches below 10 Hz on both plates, of the size of people's, that begin smoothly."""
    rng = np.random.default_rng(seed)
    time = np.arange(count) / RATE_HZ
    loads = []
    for _ in range(2):
        hz, phase = rng.uniform(0.5, 10, (2, 6, 8))
        size = rng.normal(size=(6, 8)) * np.array([20, 20, 100, 30, 40, 10])[:, None]
        waves = (size * np.sin(2 * np.pi * hz * time[:, None, None] + phase)).sum(axis=2)
        loads.append(waves * smooth_step(time / 0.5)[:, None])
    return loads[0], loads[1]


def response(structure, motion, loads=None, on_frame=None):
    drives = (np.zeros((motion.sway.shape[1], 6)),) * 2
    return respond(structure, motion, drives, loads, on_frame, PLACES, RATE_HZ, 10)


@pytest.fixture(scope="module")
def at_rest():
    still = np.zeros(4000)
    return move_platform(Machine(), still, still, RATE_HZ)


def test_a_rigid_machine_carries_the_person_and_its_own_inertia_exactly(moving):
    motion, _ = moving
    loads = smooth_loads(motion.sway.shape[1])
    found = response(None, motion, loads)
    for k, assembly in enumerate(BELT_ASSEMBLIES):
        own = motion_terms(motion) @ inertial_wrench(assembly, motion.pivot).T
        np.testing.assert_allclose(found.plates[k], own + loads[k], atol=1e-9)
        np.testing.assert_allclose(found.artefacts[k], own, atol=1e-9)
    for place, felt in zip(PLACES, found.sensors, strict=True):
        np.testing.assert_array_equal(felt, specific_force(motion, place))
    assert not found.frame.any()


def test_the_stiffer_it_is_the_nearer_it_is_to_rigid(moving):
    """Under smooth loads the difference falls about in proportion to flexibility."""
    motion, _ = moving
    loads = smooth_loads(motion.sway.shape[1])
    rigid, off = response(None, motion, loads), []
    for flexibility in (0.1, 0.05, 0.025):
        found = response(make_structure(flexibility, **SOFT), motion, loads)
        off.append(
            [
                *(np.abs(f - r).max() for f, r in zip(found.plates, rigid.plates, strict=True)),
                *(np.abs(f - r).max() for f, r in zip(found.sensors, rigid.sensors, strict=True)),
                np.abs(found.frame).max(),
            ]
        )
    np.testing.assert_allclose(np.divide(off[1:], off[:-1]), 0.5, rtol=0.2)


def test_a_constant_load_is_carried_exactly_by_its_own_plate(at_rest):
    """But for the turning of the loaded plate, which tilts it in gravity."""
    load = np.tile([20.0, -10.0, 700.0, 150.0, -100.0, 8.0], (4000, 1))
    for k in range(2):
        both = [0 * load, 0 * load]
        both[k] = load
        found = response(make_structure(flexibility=1e-7), at_rest, tuple(both))
        np.testing.assert_allclose(found.plates[k], load, atol=1e-3)
        np.testing.assert_allclose(found.plates[1 - k], 0 * load, atol=1e-3)


def test_a_tilted_plate_feels_its_weight_along_itself(at_rest):
    """A pitch moment on the frame turns everything; the assembly's weight gets a forward part."""
    push = np.zeros((4000, 6))
    push[:, 4] = 300.0
    found = response(make_structure(), at_rest, on_frame=push)
    pitch = found.frame[-1, 4]
    assert pitch > 1e-4
    for k, assembly in enumerate(BELT_ASSEMBLIES):
        expected = -assembly.mass * 9.81 * np.sin(pitch)
        assert found.plates[k][-1, 0] == pytest.approx(expected, rel=1e-3)
    for felt in found.sensors:
        assert felt[-1, 0] == pytest.approx(-9.81 * np.sin(pitch), rel=1e-3)


def test_the_modes_agree_with_a_direct_integration_in_time():
    """Newton's law for masses, springs and dampers as they are, by an adaptive Runge-Kutta."""
    time = np.arange(250) / RATE_HZ
    motion = move_platform(
        Machine(), 0.02 * np.sin(20 * time) ** 2, 0.01 * np.sin(15 * time) ** 2, RATE_HZ
    )
    loads = smooth_loads(len(time), seed=4)
    structure = make_structure(**SOFT)
    terms = motion_terms(motion)
    load = np.zeros((len(time), COORDINATES))
    for node in FRAME_NODES_M:
        felt = specific_force(motion, node) - [0, 0, 9.81]
        load[:, :FRAME] -= STRUCTURE.frame_mass / len(FRAME_NODES_M) * felt @ frame_shape(node)[:3]
    for k, assembly in enumerate(BELT_ASSEMBLIES):
        carried = terms @ inertial_wrench(assembly, motion.pivot).T + loads[k]
        load[:, FRAME + 6 * k : FRAME + 6 * k + 6] = -carried
    inverse = np.linalg.inv(structure.mass)

    def change(t, state):
        x, v = np.split(state, 2)
        now = np.array([np.interp(t, time, column) for column in load.T])
        return np.concatenate(
            [v, inverse @ (now - structure.stiffness @ x - structure.damping @ v)]
        )

    start = np.concatenate([np.linalg.solve(structure.stiffness, load[0]), np.zeros(COORDINATES)])
    states = solve_ivp(
        change, (0, time[-1]), start, t_eval=time, rtol=1e-10, atol=1e-13, max_step=1e-3
    ).y.T
    place, speed = np.split(states, 2, axis=1)
    found = response(structure, motion, loads)
    np.testing.assert_allclose(found.frame, place[::10, :FRAME], atol=1e-9)
    for k, (by_displacement, by_velocity) in enumerate(structure.cells):
        cells = place @ by_displacement.T + speed @ by_velocity.T
        weight = BELT_ASSEMBLIES[k].mass * np.array([0, 0, 9.81])
        total = cells + np.concatenate([weight, np.cross(BELT_ASSEMBLIES[k].center, weight)])
        shift, turn = np.split(place[:, FRAME + 6 * k : FRAME + 6 * k + 6], 2, axis=1)
        cells[:, :3] -= np.cross(turn, total[:, :3])
        cells[:, 3:] -= np.cross(turn, total[:, 3:]) + np.cross(shift, total[:, :3])
        np.testing.assert_allclose(found.plates[k], cells, atol=1e-4)
