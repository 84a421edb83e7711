"""Conditions, durations and perturbations of the walking study are those of the thesis."""

import numpy as np
import pytest

from hbm.coordinates import INDEX
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import PULSE_CHANNEL, make_treadmill
from pipeline.virtual_lab.person.gait import StepParameters, schedule
from pipeline.virtual_lab.protocol.walking_protocol import (
    MOTION,
    Protocol,
    perturbations,
    sway_command,
)
from pipeline.virtual_lab.protocol.walking_trial import record


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
        assert last % 2 == (1 if side > 0 else 0)  # right steps are odd
        stride = steps.contact[last + 2] - steps.contact[last]
        assert (onset - steps.contact[last]) / stride == pytest.approx(MOTION.onset, abs=0.001)


def test_a_sway_goes_out_fast_and_returns_slowly_before_the_next(twenty):
    _, onsets, sides = twenty
    time = np.arange(0, onsets[-1] + 15, 0.01)
    sway = sway_command(onsets, sides, time)
    speed = np.gradient(sway, time)
    assert np.abs(sway).max() == pytest.approx(MOTION.sway)
    assert np.abs(speed).max() == pytest.approx(0.30, rel=0.02)
    since = time[:, None] - onsets
    back = ((since > 1) & (since < 7)).any(axis=1)
    assert np.abs(np.abs(sway[back]) - MOTION.sway).max() < 1e-9
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
