"""The treadmill and its instruments, held against physics written out a second time."""

import numpy as np
import pytest

from pipeline.virtual_lab.bench import PLATFORM_MARKERS, make_bench
from pipeline.virtual_lab.cameras import move_skin, see
from pipeline.virtual_lab.faults import (
    AccelerometerFaults,
    CameraFaults,
    Faults,
    PlateFaults,
)
from pipeline.virtual_lab.instruments import make_accelerometers, make_load_cells
from pipeline.virtual_lab.machine import (
    LEFT_ASSEMBLY,
    Machine,
    assembly_wrench,
    belt_moment,
    move_platform,
    specific_force,
)
from pipeline.virtual_lab.protocol import PITCH_DEG, SWAY_MPS, sway_command
from pipeline.virtual_lab.stance import smooth_step

RATE = 1000.0
UPWARD = np.array([0, 0, 9.81])


@pytest.fixture
def shaken():
    time = np.arange(8000) / RATE
    growing = smooth_step(time / 2)
    sway = 0.03 * np.sin(2 * np.pi * 0.7 * time) * growing
    pitch = 0.12 * np.sin(2 * np.pi * 0.4 * time) * growing
    return move_platform(Machine(), sway, pitch, RATE)


def test_specific_force_is_the_second_derivative_of_the_place_minus_gravity(shaken):
    point = np.array([0.9, -0.5, -0.2])
    pose = shaken.pose
    place = pose.to_lab(point)
    acceleration = np.gradient(np.gradient(place, 1 / RATE, axis=0), 1 / RATE, axis=0)
    expected = np.einsum("tji,tj->ti", pose.rotation, acceleration + UPWARD)
    np.testing.assert_allclose(specific_force(shaken, point)[50:-50], expected[50:-50], atol=2e-3)


def test_an_assembly_is_the_sum_of_its_points(shaken):
    """A belt assembly of eight point masses on a box gives the wrench of their specific forces."""
    corners = np.array([[x, y, z] for x in (-0.8, 0.9) for y in (0.1, 0.4) for z in (-0.2, 0.0)])
    mass = 150 / 8
    center = corners.mean(axis=0)
    away = corners - center
    tensor = sum(mass * (a @ a * np.eye(3) - np.outer(a, a)) for a in away)
    assembly = type(LEFT_ASSEMBLY)(150.0, tuple(center), tuple(map(tuple, tensor)))
    force = [mass * specific_force(shaken, c) for c in corners]
    tare = mass * 9.81 * np.array([0, 0, 1.0])
    expected = np.hstack(
        [
            sum(f - tare for f in force),
            sum(np.cross(c, f - tare) for c, f in zip(corners, force, strict=True)),
        ]
    )
    np.testing.assert_allclose(assembly_wrench(shaken, assembly), expected, atol=1e-6)


def test_sway_reaches_its_speed_and_stays_within_the_assumed_acceleration():
    time = np.arange(3000) / RATE
    motion = move_platform(Machine(), sway_command([1.0], [1.0], time), 0 * time, RATE)
    assert motion.sway[1].max() == pytest.approx(SWAY_MPS, rel=0.02)
    assert motion.sway[2].max() == pytest.approx(5.0, rel=0.1)
    assert motion.sway[0][-1] == pytest.approx(0.05, abs=1e-6)


def test_pitching_the_assemblies_makes_the_force_that_their_weight_makes():
    time = np.arange(30_000) / RATE
    pitch = np.radians(PITCH_DEG) * np.sin(2 * np.pi * time / 30)
    motion = move_platform(Machine(), 0 * time, pitch, RATE)
    force = assembly_wrench(motion, LEFT_ASSEMBLY)[:, 0]
    expected = 150 * 9.81 * np.sqrt(np.mean(np.sin(pitch) ** 2))
    assert np.sqrt(np.mean(force**2)) == pytest.approx(expected, rel=0.02)


def test_a_steady_belt_leaves_no_moment_and_an_accelerating_one_does():
    speed_up = np.zeros(4000)
    speed_up[1000:3000] = 2.0
    moment = belt_moment(Machine(), speed_up, RATE)
    assert np.abs(moment[:999]).max() == 0
    assert moment[2900] == pytest.approx(2 * Machine().belt_moment_kg_m, rel=1e-3)


def test_perfect_instruments_tell_the_truth(shaken):
    perfect, rng = Faults.none(), np.random.default_rng(0)
    wrench = rng.normal(size=(50, 6))
    cells = make_load_cells(perfect.plates, rng)
    np.testing.assert_array_equal(cells.measure(wrench, np.arange(50.0), rng), wrench)
    for sensor in make_accelerometers(perfect.accelerometers, rng):
        np.testing.assert_allclose(
            sensor.read(shaken, rng), specific_force(shaken, sensor.place), atol=1e-12
        )
    markers = rng.normal(size=(30, 5, 3))
    np.testing.assert_array_equal(see(markers, perfect.cameras, rng, 100.0), markers)


def test_accelerometers_clip_at_their_range(shaken):
    faults = AccelerometerFaults(range_g=0.5)
    sensor = make_accelerometers(faults, np.random.default_rng(0))[0]
    assert sensor.read(shaken, np.random.default_rng(1)).max() == pytest.approx(0.5 * 9.81)


def test_cross_talk_is_as_large_as_stated():
    gains = [
        make_load_cells(PlateFaults(cross_talk=0.01), np.random.default_rng(k)).gain - np.eye(6)
        for k in range(50)
    ]
    assert np.std(np.array(gains)[:, :3]) == pytest.approx(0.01, rel=0.1)


def test_gaps_and_swaps_are_as_frequent_as_stated():
    rng = np.random.default_rng(4)
    still = np.tile(rng.normal(size=(1, 46, 3)), (60_000, 1, 1))
    faults = CameraFaults(noise_m=0, skin_scale=0, gaps_per_minute=6, gap_s=0.1)
    seen = see(still, faults, rng, 100.0)
    gaps = np.isnan(seen[..., 0]).sum(axis=(0, 1)) / 100
    assert gaps == pytest.approx(6 * 10 * 0.1, rel=0.6)
    swapped = see(still, CameraFaults(noise_m=0, gaps_per_minute=0, swaps_per_minute=3), rng, 100.0)
    wrong = np.any(swapped != still, axis=2)
    assert np.all(wrong.sum(axis=1) % 2 == 0)
    assert 0 < wrong.any(axis=1).mean() < 0.05


def test_skin_moves_with_the_stride_and_by_the_published_size():
    phase = np.arange(6000) / 108
    position = np.zeros((6000, 3, 3))
    turned = {"left_thigh": np.tile(np.eye(3), (6000, 1, 1))}
    moved = move_skin(
        position,
        ("left_thigh",) * 3,
        turned,
        phase,
        CameraFaults(),
        np.random.default_rng(0),
        100.0,
    )
    size = np.sqrt(np.mean(np.sum(moved**2, axis=2)))
    assert size == pytest.approx(0.009, rel=0.25)
    together = np.corrcoef(moved[:, 0, 0], moved[:, 1, 0])[0, 1]
    assert 0.2 < abs(together) < 0.95


def test_a_bench_is_drawn_once_and_again_the_same():
    first, again = make_bench(Faults(), 3), make_bench(Faults(), 3)
    np.testing.assert_array_equal(first.cells[0].gain, again.cells[0].gain)
    assert not np.array_equal(first.cells[0].gain, make_bench(Faults(), 4).cells[0].gain)
    assert len(PLATFORM_MARKERS) == 5
