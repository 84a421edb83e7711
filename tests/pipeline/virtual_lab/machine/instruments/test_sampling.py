"""When instruments sample: delays, clocks, jitter, streams."""

import numpy as np
import pytest

from hbm.signals.filtering import low_pass
from pipeline.virtual_lab.machine.instruments import (
    BeltSpeedSensor,
    Clock,
    Stream,
    delayed,
    folded,
    interpolated,
    jitter,
    noise_sd_at,
    quantise,
    wander,
)

RATE_HZ = 1000.0


def rng():
    return np.random.default_rng(0)


def test_a_late_instrument_reports_what_was_there_before():
    time = np.arange(100) / 100
    values = np.column_stack([time, 2 * time])
    np.testing.assert_allclose(delayed(values, 0.03, time)[3:], values[:-3], atol=1e-12)
    assert (delayed(values, 0.03, time)[:3] == 0).all()


def test_between_samples_a_cubic_is_exact_and_a_sine_of_80_hz_nearly():
    place = np.arange(40.0)
    cubic = (0.3 * place**3 - 2 * place**2 + place)[:, None]
    wanted = np.random.default_rng(0).uniform(1, 37, 200)
    exact = 0.3 * wanted**3 - 2 * wanted**2 + wanted
    np.testing.assert_allclose(interpolated(cubic, wanted)[:, 0], exact, atol=1e-9)
    sine = np.sin(2 * np.pi * 0.08 * place)[:, None]
    found = interpolated(sine, wanted)[:, 0]
    assert np.abs(found - np.sin(2 * np.pi * 0.08 * wanted)).max() < 0.003


def test_a_fast_clock_drifts_away_by_its_error():
    time = np.arange(100_000) / RATE_HZ
    found = Clock(rate=1e-4).sample(time[:, None], RATE_HZ, rng())[:, 0]
    np.testing.assert_allclose(found[:-20], time[:-20] * (1 + 1e-4), atol=1e-9)


def test_jitter_of_the_instants_is_as_large_as_stated_and_bounded():
    time = np.arange(100_000) / RATE_HZ
    found = Clock(jitter_s=0.0003).sample(time[:, None], RATE_HZ, rng())[:, 0]
    assert np.std((found - time)[10:-10]) == pytest.approx(0.0003, rel=0.01)
    assert np.abs(jitter(100_000, 0.001, rng())).max() == 0.002


def test_a_perfect_clock_changes_nothing():
    values = rng().normal(size=(50, 3))
    assert Clock().sample(values, RATE_HZ, rng()) is values


def test_white_noise_keeps_its_density_at_any_sampling_rate():
    densities = [noise_sd_at(2.0, rate) ** 2 / rate for rate in (200.0, 1000.0, 5000.0)]
    assert densities == pytest.approx([2.0**2 / 1000.0] * 3)


def test_a_converter_reports_steps_of_its_range_and_without_bits_everything():
    true = rng().normal(size=(50, 3))
    for bits, expected in ((0, true), (3, np.rint(true))):
        values = true.copy()
        quantise(values, 4.0, bits)
        np.testing.assert_allclose(values, expected, atol=1e-12)


def test_what_is_folded_from_above_half_the_sampling_rate_is_one_tone_below_it():
    tones = set()
    for seed in range(5):
        tone = folded(4096, np.random.default_rng(seed))
        assert np.std(tone) == pytest.approx(1.0, rel=0.05)
        power = np.abs(np.fft.rfft(tone * np.hanning(4096))) ** 2
        peak = int(np.argmax(power))
        assert power[max(peak - 3, 0) : peak + 4].sum() > 0.99 * power.sum()
        tones.add(peak)
    assert len(tones) == 5


def test_a_wandering_zero_is_slow_and_as_large_as_stated():
    drawn = wander(600_000, RATE_HZ, 6, rng())
    assert drawn.std() == pytest.approx(1.0, rel=0.1)
    fast = drawn - low_pass(drawn, RATE_HZ, 10.0, "zero_phase")
    assert fast.std() < 0.02


@pytest.mark.parametrize(("rate_hz", "held"), [(1000.0, 5), (200.0, 1), (100.0, 1)])
def test_belt_speed_is_held_between_updates_at_200_hz(rate_hz, held):
    speed = np.arange(52.0)
    reported = BeltSpeedSensor(noise=0.0).measure(speed, rate_hz, rng())
    np.testing.assert_array_equal(reported, speed // held * held)


def test_a_streamed_value_is_now_and_then_the_one_before():
    time = np.arange(600_000) / RATE_HZ
    stream = Stream(doubled_per_minute=6.0, held=True)
    found = stream.sample(time[:, None], RATE_HZ, rng())[::5, 0]
    doubled = np.abs(found - (time[::5] - 0.005)) < 1e-6
    assert 30 < doubled.sum() < 90  # 60 in ten minutes
    np.testing.assert_allclose(found[~doubled], time[::5][~doubled], atol=1e-9)


def test_a_stream_reads_at_jittering_instants():
    time = np.arange(100_000) / RATE_HZ
    found = Stream(delay_s=0.03, jitter_s=0.0003).sample(time[:, None], RATE_HZ, rng())[:, 0]
    late = (time - found)[100:]
    assert late.mean() == pytest.approx(0.03, abs=1e-5)
    assert late.std() == pytest.approx(0.0003, rel=0.03)
