"""The delay of plates behind markers is found from the force that the body's motion needs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation.force_delay import marker_plate_delay, soft_tissue
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import interpolate

time = np.arange(1500) / 100


def walking_force(at):
    """Force on a 60 kg walker: body weight, and harmonics of 0.9 strides per second."""
    phase = 2 * np.pi * 0.9 * np.asarray(at)[:, None]
    forward = 50 * np.sin(2 * phase) + 15 * np.sin(4 * phase + 1)
    left = 25 * np.sin(phase + 0.3) + 8 * np.sin(3 * phase)
    up = 589 + 70 * np.cos(2 * phase + 0.5) + 20 * np.cos(4 * phase)
    return np.hstack([forward, left, up])


long_before = np.arange(-500, 1500) / 100
on_plates = walking_force(long_before) + soft_tissue(walking_force(long_before), long_before)


def plates_later_by(delay_s):
    """Force that plates measure of the walker, whose soft tissue follows the bones."""
    return interpolate(long_before, on_plates, time - delay_s)


def error_of_the_model(seed, scale_n=10.0):
    """Force that no shift explains, in the band that a 6 Hz filter passes."""
    noise = np.random.default_rng(seed).normal(size=(len(time), 3))
    smooth = low_pass(noise, time, 6, "zero_phase")
    return scale_n * smooth / smooth.std()


@settings(max_examples=15)
@given(delay_s=st.floats(-0.12, 0.12))
def test_a_known_delay_is_found_positive_where_plates_are_late(delay_s):
    found = marker_plate_delay(plates_later_by(delay_s), walking_force(time), time)
    assert found.seconds == pytest.approx(delay_s, abs=1e-6)
    assert found.standard_error < 1e-3


def test_the_delay_of_a_rigid_body_is_found_within_its_interval():
    """Its soft tissue is two standard deviations from the usual."""
    found = marker_plate_delay(walking_force(time - 0.013), walking_force(time), time)
    assert abs(found.seconds - 0.013) < min(found.uncertainty, 0.001)


@pytest.mark.parametrize("delay_s", [-0.004, 0.0844])
def test_a_known_delay_is_found_within_its_uncertainty_at_realistic_noise(delay_s):
    late = plates_later_by(delay_s)
    found = [
        marker_plate_delay(late, walking_force(time) + error_of_the_model(seed), time)
        for seed in range(12)
    ]
    error = np.array([delay.seconds for delay in found]) - delay_s
    stated = np.array([delay.standard_error for delay in found])
    assert abs(error).max() < 3 * stated.mean()
    assert abs(error.mean()) < 1e-3


def test_the_delay_does_not_depend_on_zeros_and_axes_of_the_lab():
    late, force = plates_later_by(0.013), walking_force(time)
    offset = force + np.array([5.0, -3.0, 40.0])
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    for plate, motion in ((late, offset), (late @ turn.T, force @ turn.T)):
        assert marker_plate_delay(plate, motion, time).seconds == pytest.approx(0.013, abs=1e-5)


@pytest.mark.parametrize("heavier", [-0.05, 0.05])
def test_a_wrong_body_mass_or_gain_of_the_plates_is_no_delay(heavier):
    found = marker_plate_delay(plates_later_by(0.013), (1 + heavier) * walking_force(time), time)
    assert found.seconds == pytest.approx(0.013, abs=1e-3)


def test_a_jumping_marker_and_a_stumble_have_little_weight():
    motion = walking_force(time) + error_of_the_model(3)
    motion[500:508] += 900.0
    motion[900:960, 2] -= 300.0
    found = marker_plate_delay(plates_later_by(0.010), motion, time)
    assert found.seconds == pytest.approx(0.010, abs=2e-3)


def test_frames_with_gaps_do_not_count():
    plate, motion = plates_later_by(0.010), walking_force(time)
    motion[300:340] = np.nan
    plate[700] = np.nan
    assert marker_plate_delay(plate, motion, time).seconds == pytest.approx(0.010, abs=1e-4)


def test_axes_that_disagree_widen_the_interval_until_there_is_no_delay():
    motion = walking_force(time)

    def axes_later_by(*delays):
        return np.column_stack([plates_later_by(d)[:, k] for k, d in enumerate(delays)])

    agree = marker_plate_delay(axes_later_by(0.010, 0.010, 0.010), motion, time)
    disagree = marker_plate_delay(axes_later_by(0.014, 0.010, 0.006), motion, time)
    assert disagree.uncertainty > 2 * agree.uncertainty
    with pytest.raises(ValueError, match="its axes disagree"):
        marker_plate_delay(axes_later_by(0.060, 0.010, -0.040), motion, time)


@pytest.mark.parametrize("noise_n", [9.5, 30.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_force_of_which_motion_explains_little_shows_no_delay(seed, noise_n):
    """As in quiet standing: forces that correlate by 0.3, or hardly."""
    common, of_plates = error_of_the_model(seed, 3.0), error_of_the_model(100 + seed, noise_n)
    with pytest.raises(ValueError, match=r"more than 10 ms|agree nowhere"):
        marker_plate_delay(common + of_plates, common, time)


@pytest.mark.parametrize(
    ("plate", "motion", "message"),
    [
        (walking_force(time), np.full((1500, 3), np.nan), "0.33 s of .* got 0 s"),
        (np.full((1500, 3), 500.0), np.full((1500, 3), 500.0), "changes too little"),
        (plates_later_by(0.3), walking_force(time), "nowhere within ±150 ms"),
    ],
)
def test_a_delay_that_cannot_be_estimated_is_refused_with_the_reason(plate, motion, message):
    with pytest.raises(ValueError, match=message):
        marker_plate_delay(plate, motion, time)
