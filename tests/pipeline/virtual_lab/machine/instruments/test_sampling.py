"""Delay and noise, which all instruments have in common."""

import numpy as np
import pytest

from pipeline.virtual_lab.machine.instruments.belt_speed import BeltSpeedSensor
from pipeline.virtual_lab.machine.instruments.sampling import delayed, noise_sd_at


def test_a_late_instrument_reports_what_was_there_before():
    time = np.arange(100) / 100
    values = np.column_stack([time, 2 * time])
    np.testing.assert_allclose(delayed(values, 0.03, time)[3:], values[:-3], atol=1e-12)
    assert (delayed(values, 0.03, time)[:3] == 0).all()


def test_white_noise_keeps_its_density_at_any_sampling_rate():
    densities = [noise_sd_at(2.0, rate) ** 2 / rate for rate in (200.0, 1000.0, 5000.0)]
    assert densities == pytest.approx([2.0**2 / 1000.0] * 3)


@pytest.mark.parametrize(("rate_hz", "held"), [(1000.0, 5), (200.0, 1), (100.0, 1)])
def test_belt_speed_is_held_between_updates_at_200_hz(rate_hz, held):
    speed = np.arange(52.0)
    reported = BeltSpeedSensor(noise=0.0).measure(speed, rate_hz, np.random.default_rng(0))
    np.testing.assert_array_equal(reported, speed // held * held)
