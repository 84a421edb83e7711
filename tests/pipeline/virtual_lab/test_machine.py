"""The treadmill and its instruments, held against physics written out a second time."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import (
    AccelerometerFaults,
    CameraFaults,
    Faults,
    PlateFaults,
)
from pipeline.virtual_lab.machine.cameras import SKIN_M, move_skin, see
from pipeline.virtual_lab.machine.instruments import make_accelerometers, make_load_cells
from pipeline.virtual_lab.machine.motion import TreadmillMotion
from pipeline.virtual_lab.machine.treadmill import (
    LEFT_ASSEMBLY,
    Machine,
    assembly_wrench,
    belt_moment,
    drive_belt,
    move_platform,
    specific_force,
)
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    PLATFORM_MARKERS,
    make_treadmill,
    record,
    treadmill_wrenches,
)
from pipeline.virtual_lab.protocol.walking_protocol import PITCH_DEG, SWAY_MPS, sway_command
from pipeline.virtual_lab.trajectories import smooth_step

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
    """A lopsided assembly of eight point masses gives the wrench of their specific forces."""
    corners = np.array([[x, y, z] for x in (-0.8, 0.9) for y in (0.1, 0.4) for z in (-0.2, 0.0)])
    corners += np.random.default_rng(1).uniform(-0.1, 0.1, size=corners.shape)
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


def test_actuators_exceed_neither_range_nor_speed_whatever_they_are_told():
    wild = 5 * np.random.default_rng(0).normal(size=4000)
    wild[1000:2000] = 1.0
    motion, most = move_platform(Machine(), wild, wild, RATE), Machine().limits
    settled = 10  # the first command is where the platform is at the start
    assert np.abs(motion.sway[0, settled:]).max() <= most.sway_m
    assert np.abs(motion.sway[1]).max() <= most.sway_m_per_s * (1 + 1e-9)
    assert np.abs(motion.pitch[0, settled:]).max() <= np.radians(most.pitch_deg)
    assert np.abs(motion.pitch[1]).max() <= np.radians(most.pitch_deg_per_s) * (1 + 1e-9)
    assert motion.sway[0, 1900] == pytest.approx(most.sway_m, rel=1e-3)


@pytest.mark.parametrize(("joint", "hz"), [("sway", 7.0), ("pitch", 3.0)])
def test_actuators_follow_a_steady_move_late_by_twice_their_time_constant(joint, hz):
    time = np.arange(3000) / RATE
    ramp = 0.01 * time
    motion = getattr(move_platform(Machine(), ramp, ramp, RATE), joint)
    assert (ramp[-1] - motion[0, -1]) / 0.01 == pytest.approx(2 / (2 * np.pi * hz), rel=1e-3)
    assert motion[1, -1] == pytest.approx(0.01)


def test_pitch_turns_about_the_pivot_and_lowers_the_front(shaken):
    pose, pivot = shaken.pose, np.array(Machine().pivot_m)
    moved = pose.to_lab(pivot)
    np.testing.assert_allclose(
        moved[:, [0, 2]], np.tile(pivot[[0, 2]], (len(moved), 1)), atol=1e-12
    )
    np.testing.assert_allclose(moved[:, 1], shaken.sway[0], atol=1e-12)
    front = pose.to_lab(pivot + np.array([1.0, 0, 0]))
    np.testing.assert_allclose(front[:, 2] - pivot[2], -np.sin(shaken.pitch[0]), atol=1e-12)


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


def test_a_belt_follows_its_command_late_and_does_not_overshoot():
    time = np.arange(3000) / RATE
    told = np.where(time > 1, 2.0, 1.0)
    speed = drive_belt(Machine(), told, RATE)
    assert speed[:1000] == pytest.approx(1.0)
    assert speed.max() <= 2.0 + 1e-9
    reached = time[np.searchsorted(speed, 1.9)] - 1.0
    assert 0.5 / Machine().servo_hz < reached < 1.0 / Machine().servo_hz
    late = drive_belt(Machine(), time, RATE)
    assert time[-1] - late[-1] == pytest.approx(2 / (2 * np.pi * Machine().servo_hz), rel=1e-3)


def test_belt_speed_is_told_in_steps_of_200_hz(perfect):
    trial, _ = perfect("baseline")
    told = trial.recording.analog.channel("Belt.Left")
    starting = slice(5000, 7000)
    means = told[starting].reshape(-1, 5)
    assert np.abs(means - means[:, :1]).max() < 10 * 0.005  # noise alone
    true = trial.motion.belt[starting].reshape(-1, 5)[:, 0]
    assert np.std(means.mean(axis=1) - true) < 0.005


def test_accelerating_belts_pitch_their_plates_and_nothing_else():
    time = np.arange(2000) / RATE
    at_rest = move_platform(Machine(), 0 * time, 0 * time, RATE)
    motion = TreadmillMotion(time, at_rest, 1.5 * time, np.empty(0))
    for wrench in treadmill_wrenches(make_treadmill(Faults.none(), 1), motion):
        assert wrench[-1, 4] == pytest.approx(1.5 * Machine().belt_moment_kg_m, rel=1e-3)
        assert np.abs(np.delete(wrench, 4, axis=1)).max() < 1e-9


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


def test_plates_report_cross_talk_zero_and_drift_of_what_is_there():
    faults = PlateFaults(force_noise_n=0, moment_noise_nm=0)
    cells, rng = make_load_cells(faults, np.random.default_rng(3)), np.random.default_rng(0)
    time, nothing = np.array([0.0, 60.0]), np.zeros((2, 6))
    zero, later = cells.measure(nothing, time, rng)
    np.testing.assert_allclose(zero, cells.offset)
    np.testing.assert_allclose(later - zero, 60 * cells.drift)
    loaded = cells.measure(nothing + 800 * np.eye(6)[2], time, rng)[0] - zero
    np.testing.assert_allclose(loaded, 800 * cells.gain[:, 2])
    assert np.abs(np.delete(loaded, 2)).max() > 0.1


def test_plate_errors_are_as_large_as_stated():
    drawn = [make_load_cells(PlateFaults(), np.random.default_rng(k)) for k in range(200)]
    offsets = np.array([cells.offset for cells in drawn])
    drifts = 60 * np.array([cells.drift for cells in drawn])
    assert offsets[:, :3].std() == pytest.approx(2.0, rel=0.1)
    assert offsets[:, 3:].std() == pytest.approx(2.0 / 3, rel=0.1)
    assert drifts[:, :3].std() == pytest.approx(0.3, rel=0.1)
    noise = drawn[0].measure(np.zeros((5000, 6)), np.zeros(5000), np.random.default_rng(1))
    np.testing.assert_allclose(noise.std(axis=0), [1.5] * 3 + [0.5] * 3, rtol=0.05)


def test_accelerometer_errors_are_as_large_as_stated():
    sensors = [
        s
        for k in range(100)
        for s in make_accelerometers(AccelerometerFaults(sensors=4), np.random.default_rng(k))
    ]
    gains = np.array([np.linalg.norm(s.sensitivity, axis=1) - 1 for s in sensors])
    assert gains.std() == pytest.approx(0.01, rel=0.1)
    crooked = [np.degrees(np.arccos(np.trace(_turn(s.sensitivity)) / 2 - 0.5)) for s in sensors]
    assert np.sqrt(np.mean(np.square(crooked))) == pytest.approx(1.0, rel=0.1)
    assert np.std([s.offset for s in sensors]) == pytest.approx(0.05, rel=0.1)
    assert {s.limit for s in sensors} == {2 * 9.81}


def _turn(sensitivity):
    """Take the gains off a sensitivity: what is left is a rotation."""
    return np.clip(sensitivity / np.linalg.norm(sensitivity, axis=1)[:, None], -1, 1)


def test_a_late_device_reports_what_was_there_before(perfect):
    """Plates, accelerometers and the platform's channels, each by its own delay."""
    trial, _ = perfect("pitch")
    faults, late = Faults.none(), 0.03
    for table, channels in (
        ("plates", lambda r: r.plates[1].wrench_in_plate),
        ("accelerometers", lambda r: r.analog.values[:, :6]),
        ("platform", lambda r: r.analog.values[:, 8:10]),
    ):
        delayed = getattr(faults, table).model_copy(update={"delay_s": late})
        treadmill = make_treadmill(faults.model_copy(update={table: delayed}), 1)
        recorded = record(treadmill, trial.motion, trial.walk, "x.c3d", np.random.default_rng(0))
        now, then = channels(trial.recording)[10_000:20_000], round(late * RATE)
        found = channels(recorded)[10_000 + then : 20_000 + then]
        np.testing.assert_allclose(found, now, atol=1e-6)


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


def test_marker_noise_is_white_and_as_large_as_stated():
    still = np.zeros((4000, 46, 3))
    faults = CameraFaults(gaps_per_minute=0)
    noise = see(still, faults, np.random.default_rng(0), 100.0)
    assert noise.std() == pytest.approx(faults.noise_m, rel=0.01)
    lagged = np.mean(noise[1:] * noise[:-1]) / noise.var()
    assert abs(lagged) < 0.01


@pytest.mark.parametrize(("segment", "size_m"), list(SKIN_M.items()))
def test_skin_of_every_segment_moves_by_its_published_size(segment, size_m):
    phase = np.arange(4000) / 108
    name = segment if segment in ("pelvis", "trunk", "head") else f"right_{segment}"
    turned = {name: np.tile(np.eye(3), (4000, 1, 1))}
    given = np.zeros((4000, 6, 3)), (name,) * 6, turned, phase
    moved = move_skin(*given, CameraFaults(), np.random.default_rng(1), 100.0)
    assert np.sqrt(np.mean(np.sum(moved**2, axis=2))) == pytest.approx(size_m, rel=0.3)
    standing = move_skin(
        *given[:3], np.zeros(4000), CameraFaults(), np.random.default_rng(1), 100.0
    )
    assert np.abs(standing).max() == 0


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
    first, again = make_treadmill(Faults(), 3), make_treadmill(Faults(), 3)
    np.testing.assert_array_equal(first.cells[0].gain, again.cells[0].gain)
    assert not np.array_equal(first.cells[0].gain, make_treadmill(Faults(), 4).cells[0].gain)
    assert len(PLATFORM_MARKERS) == 5
