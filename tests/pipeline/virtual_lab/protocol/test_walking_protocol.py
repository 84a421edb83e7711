"""The protocol of the walking study: conditions, durations and perturbations as in the thesis."""

import numpy as np
import pytest

from compensation import check_trial, low_pass, pitch_and_sway_signals
from hbm.coordinates import INDEX
from pipeline.config.schema import Treadmill
from pipeline.trial.ground.accelerometers import accelerations
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.virtual_lab.faults import Faults, MachineFaults
from pipeline.virtual_lab.machine.instrumented_treadmill import PULSE_CHANNEL, make_treadmill
from pipeline.virtual_lab.machine.instruments import SENSOR_NAMES
from pipeline.virtual_lab.machine.platform import BeltRamp, TreadmillMotion, move_platform
from pipeline.virtual_lab.person.gait import StepParameters, schedule
from pipeline.virtual_lab.protocol.walking_protocol import (
    DEMO,
    ONSET_PHASE,
    SWAY_M,
    Protocol,
    perturbations,
    pitch_command,
    sway_command,
)
from pipeline.virtual_lab.protocol.walking_trial import record, run_signal


@pytest.fixture(scope="module")
def twenty():
    """Steps of a whole sway trial, and its perturbations."""
    protocol = Protocol()
    steps = schedule(
        StepParameters(),
        protocol.speed_mps,
        4.0,
        protocol.duration("sway"),
        np.random.default_rng(3),
    )
    return steps, *perturbations(protocol, steps, seed=1)


def test_the_platform_sways_to_the_contralateral_side_at_a_tenth_of_the_gait_cycle(twenty):
    steps, onsets, sides = twenty
    for onset, side in zip(onsets, sides, strict=True):
        last = int(np.searchsorted(steps.contact, onset)) - 1
        assert steps.side(last) == ("right" if side > 0 else "left")
        stride = steps.contact[last + 2] - steps.contact[last]
        assert (onset - steps.contact[last]) / stride == pytest.approx(ONSET_PHASE, abs=0.001)


def test_a_sway_goes_out_fast_and_returns_slowly_before_the_next(twenty):
    _, onsets, sides = twenty
    time = np.arange(0, onsets[-1] + 15, 0.01)
    sway = sway_command(onsets, sides, time)
    speed = np.gradient(sway, time)
    assert np.abs(sway).max() == pytest.approx(SWAY_M)
    assert np.abs(speed).max() == pytest.approx(0.30, rel=0.02)
    since = time[:, None] - onsets
    back = ((since > 1) & (since < 7)).any(axis=1)
    assert np.abs(np.abs(sway[back]) - SWAY_M).max() < 1e-9
    slow = ((since > 7) & (since < 10.5)).any(axis=1)
    assert 0 < np.abs(speed[slow]).max() < 0.04
    assert np.abs(sway_command(onsets, sides, onsets)).max() < 1e-9


@pytest.mark.parametrize("condition", ["baseline", "sway", "pitch"])
def test_every_trial_starts_in_a_t_pose_on_a_treadmill_at_rest(walked, condition):
    walk, motion = walked(0, condition)
    still = motion.time < 1.0
    q = walk.motion.at(motion.time[still][::10])
    assert np.ptp(q, axis=0).max() < 1e-3
    for side in "RL":
        assert np.degrees(q[:, INDEX[f"{side}ShoulderAbduction"]]).min() > 80
    assert np.abs(motion.belt[still]).max() == 0
    assert np.abs(motion.platform.sway[0][still]).max() == 0
    assert np.abs(motion.platform.pitch[0][still]).max() == 0


def test_a_pulse_marks_the_onset_of_every_perturbation(walked):
    walk, motion = walked(0, "sway")
    recording = record(make_treadmill(Faults(), 1), motion, walk, "x.c3d", np.random.default_rng(0))
    pulse = recording.analog.channel(PULSE_CHANNEL)
    rises = motion.time[1:][(pulse[1:] > 2.5) & (pulse[:-1] < 2.5)]
    np.testing.assert_allclose(rises, motion.onsets, atol=0.001)
    moved = np.abs(motion.platform.sway[0]) > 1e-5
    starts = motion.time[1:][moved[1:] & ~moved[:-1]]
    assert 0 < np.min(starts[:1] - rises[:1]) < 0.02


def perturbed_on(faults):
    """The demo's treadmill with nobody on it, and its accelerometers in sway and in pitch."""
    treadmill, rate_hz = make_treadmill(faults, 1), 1000.0
    time = np.arange(0, DEMO.duration("pitch"), 1 / rate_hz)
    sway = sway_command(np.array([12.0, 26.0]), np.array([1.0, -1.0]), time)
    belt = BeltRamp(DEMO.speed_mps, DEMO.standing_s, DEMO.starting_s).speed(time)
    commands = {"sway": (sway, 0 * time), "pitch": (0 * time, pitch_command(DEMO, time))}
    trials = {}
    for name, command in commands.items():
        platform = move_platform(treadmill.machine, *command, rate_hz)
        motion = TreadmillMotion(time, platform, belt, np.empty(0))
        recording = record(treadmill, motion, None, name, np.random.default_rng(1))
        trials[name] = filtered(recording)
    return treadmill, trials


TREADMILL = Treadmill(
    accelerometers={name: tuple(f"{name}.{axis}" for axis in "XYZ") for name in SENSOR_NAMES[:2]}
)


def filtered(recording):
    readings = accelerations(recording, TREADMILL)[1]
    return low_pass(readings, 1000.0, TREADMILL.cutoff_hz, "zero_phase")


def beyond(perturbed, signal):
    """Conditions whose accelerations leave the range of a calibration with a signal."""
    treadmill, trials = perturbed
    recording = run_signal(treadmill, signal, np.random.default_rng(2))
    model = fit_calibration(recording, TREADMILL).plates["plate 1"]
    return [name for name, trial in trials.items() if check_trial(model, trial)]


@pytest.mark.slow
def test_the_demos_calibration_covers_its_own_perturbations_on_a_rigid_machine():
    """A flexible one is shaken more by the jerk of a sway than by its calibration."""
    drawn = {signal.name: signal for signal in pitch_and_sway_signals(1, 3.0)}
    for flexibility, uncovered in ((0.0, []), (1.0, ["sway"])):
        machine = perturbed_on(Faults(machine=MachineFaults(flexibility=flexibility)))
        assert beyond(machine, drawn[DEMO.calibration]) == uncovered
