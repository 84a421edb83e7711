"""The delay of plates behind markers, from the force that the body's motion needs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation.alignment.force_delay import marker_plate_delay
from hbm.signals.filtering import low_pass

time = np.arange(1500) / 100


def walking_force(at):
    """Force on a 60 kg walker: body weight, and harmonics of 0.9 strides per second."""
    phase = 2 * np.pi * 0.9 * np.asarray(at)[:, None]
    forward = 50 * np.sin(2 * phase) + 15 * np.sin(4 * phase + 1)
    left = 25 * np.sin(phase + 0.3) + 8 * np.sin(3 * phase)
    up = 589 + 70 * np.cos(2 * phase + 0.5) + 20 * np.cos(4 * phase)
    return np.hstack([forward, left, up])


def error_of_the_model(seed, scale_n=10.0):
    """Force that no shift explains, in the band that a 6 Hz filter passes."""
    noise = np.random.default_rng(seed).normal(size=(len(time), 3))
    smooth = low_pass(noise, time, 6, "zero_phase")
    return scale_n * smooth / smooth.std()


@settings(deadline=None, max_examples=15)
@given(delay_s=st.floats(-0.12, 0.12))
def test_a_known_delay_is_found_positive_where_plates_are_late(delay_s):
    found = marker_plate_delay(walking_force(time - delay_s), walking_force(time), time)
    assert found.seconds == pytest.approx(delay_s, abs=1e-6)
    assert found.standard_error < 1e-5


@pytest.mark.parametrize("delay_s", [-0.004, 0.0071, 0.0844])
def test_a_known_delay_is_found_within_its_uncertainty_at_realistic_noise(delay_s):
    late = walking_force(time - delay_s)
    found = [
        marker_plate_delay(late, walking_force(time) + error_of_the_model(seed), time)
        for seed in range(12)
    ]
    error = np.array([delay.seconds for delay in found]) - delay_s
    stated = np.array([delay.standard_error for delay in found])
    assert abs(error).max() < 3 * stated.mean()
    assert 0.5 < stated.mean() / error.std() < 2.5
    assert abs(error.mean()) < 3 * error.std() / np.sqrt(len(error))  # no bias


def test_the_delay_does_not_depend_on_mass_zero_and_axes_of_the_lab():
    late, force = walking_force(time - 0.013), walking_force(time)
    offset = force + np.array([5.0, -3.0, 40.0])
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    for plate, motion in ((late, offset), (late @ turn.T, force @ turn.T)):
        assert marker_plate_delay(plate, motion, time).seconds == pytest.approx(0.013, abs=1e-5)


def test_a_jumping_marker_and_a_stumble_have_little_weight():
    motion = walking_force(time) + error_of_the_model(3)
    motion[500:508] += 900.0
    motion[900:960, 2] -= 300.0
    found = marker_plate_delay(walking_force(time - 0.010), motion, time)
    assert found.seconds == pytest.approx(0.010, abs=2e-3)
    assert found.standard_error < 2e-3


def test_frames_with_gaps_do_not_count():
    plate, motion = walking_force(time - 0.010), walking_force(time)
    motion[300:340] = np.nan
    plate[700] = np.nan
    assert marker_plate_delay(plate, motion, time).seconds == pytest.approx(0.010, abs=1e-6)


def test_axes_that_disagree_widen_the_uncertainty():
    motion = walking_force(time)
    agree = walking_force(time - 0.010)
    disagree = np.column_stack([walking_force(time - d)[:, k] for k, d in enumerate((0.02, 0, 0))])
    assert marker_plate_delay(agree, motion, time).standard_error < 1e-5
    assert marker_plate_delay(disagree, motion, time).standard_error > 3e-3


@pytest.mark.parametrize(
    ("plate", "motion", "message"),
    [
        (walking_force(time)[:, :2], walking_force(time), r"must have shape \(T, 3\)"),
        (
            walking_force(time),
            np.full((1500, 3), np.nan),
            "needs 2 s of frames without gaps, got 0",
        ),
        (np.full((1500, 3), 500.0), np.full((1500, 3), 500.0), "changes too little"),
        (walking_force(time - 0.3), walking_force(time), "agree nowhere within ±150 ms"),
    ],
)
def test_a_delay_that_cannot_be_estimated_is_refused_with_the_reason(plate, motion, message):
    with pytest.raises(ValueError, match=message):
        marker_plate_delay(plate, motion, time)
