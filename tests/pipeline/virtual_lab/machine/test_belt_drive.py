"""The belt's drive obeys mechanics and its limits."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.virtual_lab.machine.belts import identified_drive, run_belt

RATE_HZ = 1000.0
QUIET = replace(
    identified_drive(),
    unbalance_kg_per_m=0.0,
    lines=(),
    rumble_nm_per_sqrt_hz=0.0,
    report_jitter_s=0.0,
)
FRICTIONLESS = replace(QUIET, coulomb_n=0.0, static_n=0.0, viscous_n_per_mps=0.0, stretch_n=np.inf)


def run(drive, command, seed=0, **loads):
    return run_belt(drive, np.asarray(command), RATE_HZ, np.random.default_rng(seed), **loads)


def ramp(start, end, seconds=1.0, held=2.0):
    """Hold, change smoothly, and hold."""
    n, at = round(held * RATE_HZ), np.linspace(0, 1, round(seconds * RATE_HZ))
    change = start + (end - start) * at**3 * (10 - 15 * at + 6 * at**2)
    return np.concatenate([np.full(n, start), change, np.full(n, end)])


def test_a_belt_that_is_not_commanded_stays_and_loads_nothing():
    motion = run(identified_drive(), np.zeros(3000))
    for field in fields(motion):
        assert not np.any(getattr(motion, field.name)), field.name


@given(speed=st.floats(0.3, 3.0), weight=st.floats(0.0, 1200.0), push=st.floats(-80.0, 80.0))
@settings(max_examples=15)
def test_steady_speed_needs_friction_alone_and_loads_no_plate(speed, weight, push):
    drive = replace(QUIET, stretch_n=np.inf)
    count = 4000
    loads = {"weight": np.full(count, weight), "push": np.full(count, push)}
    motion = run(drive, np.full(count, speed), **loads)
    needed = drive.bearing_friction(np.array(speed)) + drive.board_friction * weight + push
    assert motion.speed[-1] == pytest.approx(speed, rel=1e-4)
    assert motion.motor_force[-1] == pytest.approx(needed, abs=0.5)
    assert motion.pitch_moment[-1] == pytest.approx(0, abs=0.01)


@given(start=st.floats(-2.0, 2.0), end=st.floats(-2.0, 2.0), weight=st.floats(0.0, 800.0))
@settings(max_examples=15)
def test_the_moments_impulse_is_the_change_of_angular_momentum(start, end, weight):
    command = ramp(start, end)
    motion = run(replace(QUIET, stretch_n=np.inf), command, weight=np.full(len(command), weight))
    impulse = np.sum(motion.pitch_moment) / RATE_HZ
    change = motion.speed[-1] - motion.speed[0]
    assert impulse == pytest.approx(-QUIET.moment_kg_m * change, rel=0.005, abs=0.005)


def test_the_motors_work_is_kinetic_energy_and_friction():
    drive = replace(QUIET, stretch_n=np.inf, belt_hz=60.0, belt_damping=0.3)
    motion = run(drive, ramp(0, 2))
    work = np.sum(motion.motor_force * motion.speed) / RATE_HZ
    kinetic = (drive.motor_kg + drive.turning_kg) * motion.speed[-1] ** 2 / 2
    lost = np.sum(drive.bearing_friction(motion.speed) * motion.speed) / RATE_HZ
    assert work == pytest.approx(kinetic + lost, rel=0.005)


def test_without_friction_responses_add_and_with_friction_they_do_not():
    """What is fitted to belts is linear; a real drive is not."""
    time = np.arange(6000) / RATE_HZ
    one, other = np.sin(2 * np.pi * time), 0.5 * np.sin(2 * np.pi * 2.7 * time)

    def excess(drive):
        both, first, second = (run(drive, x).pitch_moment for x in (one + other, one, other))
        return np.std(both - first - second) / np.std(both)

    assert excess(FRICTIONLESS) < 1e-9
    assert excess(QUIET) > 0.02


def test_an_unbalanced_roller_pulls_with_the_square_of_the_speed_once_a_turn():
    pulls = {}
    for speed in (1.0, 2.0):
        motion = run(replace(QUIET, unbalance_kg_per_m=0.3), np.full(20_000, speed))
        spectrum = np.abs(np.fft.rfft(motion.upward_force))
        hz = np.argmax(spectrum) * RATE_HZ / len(motion.speed)
        assert hz == pytest.approx(speed * QUIET.turns_per_m, abs=0.05)
        pulls[speed] = np.std(motion.upward_force)
        moment = np.std(motion.pitch_moment)
        assert moment <= 2 * 0.3 * speed**2 * np.hypot(QUIET.roller_place_m, 0.1)
    assert pulls[2.0] == pytest.approx(4 * pulls[1.0], rel=0.02)


def test_reported_speed_is_held_and_late():
    command = ramp(0, 2, seconds=2.0)
    drive = replace(QUIET, report_hz=200.0, report_lag_s=0.0, report_delay_s=0.02, stretch_n=np.inf)
    motion = run(drive, command)
    held = motion.reported_speed.reshape(-1, 5)
    assert np.all(held == held[:, :1])
    late = np.interp(
        np.arange(len(command)) / RATE_HZ - 0.0225, np.arange(len(command)) / RATE_HZ, motion.speed
    )
    assert np.abs(motion.reported_speed - late).max() < 0.02
    assert np.abs(motion.reported_speed - motion.speed).max() > 0.03


def test_a_command_beyond_the_motor_gets_one_clear_error():
    weak = replace(QUIET, max_force_n=60.0)
    with pytest.raises(ValueError, match="motor's 60 N"):
        run(weak, 3 * np.sin(2 * np.pi * 2 * np.arange(5000) / RATE_HZ))
