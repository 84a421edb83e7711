"""Signals reach the machine as files that hold what was computed."""

import numpy as np
import pytest

from compensation import (
    MachineLimits,
    Signal,
    belt_signals,
    pitch_and_sway_signals,
    resample_signal,
    validation_signals,
)
from pipeline.calibration_ranking.signal_files import signal_figure, write_signals


def test_files_hold_the_signal_at_the_rate_asked_for(tmp_path):
    signal = pitch_and_sway_signals(1, 3.0)[1]
    (path,) = write_signals([signal], tmp_path / "signals", 200.0, MachineLimits())
    assert path.name == "square_sway_60s_3mps.csv"
    assert path.read_text(encoding="utf-8").startswith("time_s,sway_m,pitch_deg,belt_speed_m_per_s")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.allclose(np.diff(table[:, 0]), 1 / 200)
    every_second = slice(None, None, 2)
    np.testing.assert_allclose(table[every_second, 1], signal.sway, atol=1e-4)
    np.testing.assert_allclose(table[every_second, 2], np.degrees(signal.pitch), atol=2e-2)
    np.testing.assert_array_equal(table[:, 3], 3)
    assert path.with_suffix(".png").stat().st_size > 10_000


def test_a_signal_beyond_the_machine_is_not_written(tmp_path):
    slow = MachineLimits(sway_m_per_s=0.1)
    with pytest.raises(
        ValueError, match=r"cannot do this: .*square_sway_60s_3mps: sway_m_per_s reaches"
    ):
        write_signals(pitch_and_sway_signals(1, 3.0)[:2], tmp_path, 100.0, slow)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "signal", [belt_signals(1, 2.0)[4], validation_signals()[3], pitch_and_sway_signals(1, 0.0)[6]]
)
def test_the_picture_shows_courses_limits_and_spectra(signal: Signal):
    figure = signal_figure(signal, MachineLimits())
    figure.draw_without_rendering()
    assert len(figure.axes) == 6
    dashed = [line.get_ydata()[0] for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert sorted(dashed) == [-0.05, 0.05]


def test_every_label_of_the_picture_is_plain_text():
    """Logarithmic axes write formulas by default, which this style shows as they are."""
    for signal in (belt_signals(1, 2.0)[4], validation_signals()[1]):
        figure = signal_figure(resample_signal(signal, 1000.0), MachineLimits())
        figure.draw_without_rendering()
        labels = [label.get_text() for axes in figure.axes for label in axes.get_yticklabels()]
        assert labels
        assert not any("$" in text for text in labels)


def test_belts_at_constant_speed_have_no_spectrum():
    figure = signal_figure(resample_signal(validation_signals()[1], 1000.0), MachineLimits())
    assert [text.get_text() for text in figure.axes[5].texts] == ["no acceleration"]
