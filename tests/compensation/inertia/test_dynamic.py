"""A dynamic model removes what bending adds, and nothing where there is no bending.

The oracle is an assembly on load cells of one mode: the cells feel its platform's acceleration
through ``ω₀² / (ω₀² − ω² + 2iζω₀ω)``, the accelerometers do not. It is damped little: what
damping delays is found beforehand, as the delay of a sensor.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation import Setup, dynamic_channels, fit_inertia, fit_trials
from compensation.inertia.fit import LAGS_S, left_of_held_out

RATE_HZ = 200.0
SETUP = Setup(("rear", "front"), RATE_HZ, 20.0)
MASS_KG, ARM_M = 150.0, 0.4
NOISE_N = 0.3
GAIN = np.zeros((6, 6))
GAIN[:3, :3] = -MASS_KG * np.eye(3)  # the rear sensor is where the assembly is
GAIN[5, 4] = -MASS_KG * ARM_M


def response(hz, mode_hz, damping=0.001):
    """Give what the load cells feel of a sine of the platform, by its amplitude."""
    if mode_hz is None:
        return np.ones(hz.shape, complex)
    return mode_hz**2 / (mode_hz**2 - hz**2 + 2j * damping * mode_hz * hz)


def motion(seed, mode_hz, seconds):
    """Give what two accelerometers and the load cells feel of random motion below 15 Hz, (N, 6)."""
    time = np.arange(0, seconds, 1 / RATE_HZ)
    rng = np.random.default_rng(seed)
    hz, phase = rng.uniform(0.2, 15.0, (30, 6)), rng.uniform(0, 2 * np.pi, (30, 6))
    sines = 0.3 * np.exp(1j * (2 * np.pi * hz * time[:, None, None] + phase))
    gravity = np.tile([0, 0, 9.81], 2)
    felt = sines.imag.sum(axis=1) + gravity
    return felt, (sines * response(hz, mode_hz)).imag.sum(axis=1) + gravity


def slow_tilt():
    """Give what all feel of a tilt of ± 10° in 30 s, which no mode changes, (N, 6)."""
    angle = np.radians(10) * np.sin(2 * np.pi * np.arange(0, 60, 1 / RATE_HZ) / 30)
    return np.tile(9.81 * np.column_stack([-np.sin(angle), 0 * angle, np.cos(angle)]), 2)


def recorded(felt, cells, seed):
    """Give channels and wrench as a fit takes them: filtered, without the ends."""
    noise = NOISE_N * np.random.default_rng((seed, 1)).normal(size=(len(felt), 6))
    channels = dynamic_channels(SETUP.low_pass(felt, RATE_HZ), RATE_HZ)
    wrench = SETUP.low_pass(cells @ GAIN + noise, RATE_HZ)
    return channels[200:-200], wrench[200:-200]


def fit_dynamic(trials, setup=None):
    return fit_trials(trials, setup or SETUP, lags_s=LAGS_S)


def trial(seed, mode_hz, seconds=30.0):
    return recorded(*motion(seed, mode_hz, seconds), seed)


def left(model, channels, wrench):
    error = model.compensate(channels[:, : len(model.gain) - 1], wrench)
    return error.std(axis=0)


def both(hz, seed=0):
    channels, wrench = trial(seed, hz)
    return fit_inertia(channels[:, :6], wrench, SETUP), fit_dynamic([(channels, wrench)], SETUP)


@pytest.fixture(scope="module")
def bending():
    """A static and a dynamic model of an assembly that resonates at 35 Hz."""
    return both(35.0)


def test_an_assembly_on_soft_load_cells_is_compensated_to_the_noise(bending):
    static, dynamic = bending
    channels, wrench = trial(7, 35.0)
    assert wrench[:, 0].std() > 100
    noise = wrench[:, 3].std()  # the plate's own: no motion is in this component
    assert np.all(left(static, channels, wrench)[:3] > 50 * noise)
    assert np.all(left(dynamic, channels, wrench) < 3 * noise)


def test_on_a_rigid_machine_both_models_predict_the_same():
    static, dynamic = both(None)
    channels, _ = trial(3, None)
    difference = dynamic.predict(channels) - static.predict(channels[:, :6])
    assert np.abs(difference).max() < 0.3  # of 500 N


def test_slow_tilt_is_predicted_by_the_weight_alone(bending):
    """The differences vanish: nothing of gravity may be lost to what was fitted at 10 Hz."""
    _, dynamic = bending
    channels, wrench = recorded(slow_tilt(), slow_tilt(), 5)
    assert np.abs(channels[:, 6:]).max() < 0.001
    weight = wrench[:, 0].std()
    assert weight > 170
    error = dynamic.compensate(channels, wrench)
    assert np.all(error.std(axis=0)[:3] < 0.002 * weight)
    np.testing.assert_allclose(dynamic.gain[:6], GAIN, atol=0.01 * MASS_KG)


@settings(max_examples=20)
@given(
    offset=st.floats(-20, 20), rate=st.floats(-5, 5), seed=st.integers(0, 100), hz=st.just(RATE_HZ)
)
def test_the_differences_do_not_see_what_is_constant_or_changes_evenly(offset, rate, seed, hz):
    moving = np.random.default_rng(seed).normal(size=(60, 3))
    even = offset + rate * np.arange(60)[:, None] / hz
    with_ramp, without = (dynamic_channels(x, hz)[:, 3:] for x in (moving + even, moving))
    np.testing.assert_allclose(with_ramp[10:-10], without[10:-10], atol=1e-9)


def test_a_gap_stays_a_gap_and_its_neighbours_have_no_differences():
    felt = np.random.default_rng(0).normal(size=(100, 3))
    felt[50] = np.nan
    channels = dynamic_channels(felt, 100.0)
    assert np.isnan(channels[50]).all()
    others = np.delete(channels, 50, axis=0)
    assert np.isfinite(others).all()
    for k, lag_s in enumerate(LAGS_S):
        step = round(100 * lag_s)
        assert not channels[[50 - step, 50 + step, 0, -1], 3 + 3 * k : 6 + 3 * k].any()


def test_two_recordings_with_zeros_of_their_own_give_one_model():
    first, second = trial(0, 35.0), trial(1, 35.0)
    model = fit_dynamic([first, (second[0], second[1] + 40.0)], SETUP)
    assert np.all(left(model, *trial(9, 35.0)) < 4 * NOISE_N)
    np.testing.assert_allclose(model.gain[-1], fit_dynamic([first], SETUP).gain[-1] + 20, atol=2.0)


def test_held_out_parts_show_what_the_models_leave_of_other_recordings(bending):
    channels, wrench = trial(0, 35.0)
    for model, x in zip(bending, (channels[:, :6], channels), strict=True):
        (held_out,) = left_of_held_out([(x, wrench)], x.shape[1] // 6 - 1)
        other = left(model, *trial(11, 35.0))
        np.testing.assert_allclose(held_out.std(axis=0)[:3], other[:3], rtol=0.5)


def test_the_uncertainty_of_a_dynamic_model_covers_what_it_leaves(bending):
    channels, wrench = trial(13, 35.0)
    error = bending[1].compensate(channels, wrench)
    sd = bending[1].uncertainty(channels)
    inside = np.mean(np.abs(error) < 1.96 * sd, axis=0)
    assert np.all(inside > 0.9)


def test_the_model_does_not_depend_on_the_order_of_the_sensors(bending):
    channels, wrench = trial(0, 35.0)
    order = np.concatenate([np.r_[6 * k + 3 : 6 * k + 6, 6 * k : 6 * k + 3] for k in range(4)])
    exchanged = fit_dynamic([(channels[:, order], wrench)], SETUP)
    np.testing.assert_allclose(
        exchanged.predict(channels[:, order]), bending[1].predict(channels), atol=1e-5
    )
