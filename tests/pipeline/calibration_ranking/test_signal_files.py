"""Signals reach the machine as files that hold what was computed."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compensation import (
    MachineLimits,
    pitch_and_sway_signals,
)
from compensation.protocol import ADVISED_BELT_SIGNAL, ADVISED_PLATFORM_SIGNAL
from pipeline.calibration_ranking import signal_files
from pipeline.calibration_ranking.signal_files import (
    protocol_signals,
    write_signals,
)
from pipeline.cli.app import main


def test_files_hold_the_signal_at_the_rate_asked_for(tmp_path):
    signal = pitch_and_sway_signals(1, 3.0)[1]
    (path,) = write_signals([signal], tmp_path / "signals", 200.0)
    assert path.name == "square_sway_60s_3mps.csv"
    assert path.read_text(encoding="utf-8").startswith("time_s,sway_m,pitch_deg,belt_speed_m_per_s")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.allclose(np.diff(table[:, 0]), 1 / 200)
    every_second = slice(None, None, 2)
    np.testing.assert_allclose(table[every_second, 1], signal.sway, atol=1e-4)
    np.testing.assert_allclose(table[every_second, 2], np.degrees(signal.pitch), atol=2e-2)
    np.testing.assert_array_equal(table[:, 3], 3)


def names(signals):
    return {signal.name for signal in signals[0]}


def test_signals_that_a_machine_cannot_do_are_named_with_their_limit():
    """Belts up to 2.5 m/s: no squares of ± 3 m/s, alone or in all variations, and all else."""
    found = protocol_signals("belt", 1, MachineLimits(belt_m_per_s=2.5, belt_m_per_s2=3))
    assert len(found[0]) == 16
    assert not any("square" in name or "_all_" in name for name in names(found))
    assert ADVISED_BELT_SIGNAL in names(found)
    assert len(found[1]) == 8
    assert all(re.search(r"belt_m_per_s .*3, .*2\.5$", line) for line in found[1])


@given(
    kind=st.sampled_from(["pitch_sway", "belt"]),
    slow=st.sampled_from(list(MachineLimits.__dataclass_fields__)),
    share=st.floats(0.02, 1),
)
@settings(max_examples=3)
def test_every_signal_of_the_protocol_is_either_possible_or_named(kind, slow, share):
    limits = MachineLimits()
    found = protocol_signals(kind, 0, replace(limits, **{slow: share * getattr(limits, slow)}))
    every = names(protocol_signals(kind, 0, limits))
    beyond = [line.split(":")[0] for line in found[1]]
    assert sorted([*names(found), *beyond]) == sorted(every)


@pytest.fixture
def written(monkeypatch):
    """The names that a command would write, without writing them."""
    asked = {}

    def remember(signals, folder, rate_hz):
        asked[folder.name] = [signal.name for signal in signals]
        return asked[folder.name]

    monkeypatch.setattr(signal_files, "write_signals", remember)
    return asked


def test_an_advised_signal_beyond_the_machine_is_said_in_one_line(written, capsys):
    command = ["calibration", "signals", "--kind", "pitch_sway", "--belt-m-per-s", "2"]
    assert main(command) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(f"not written.*: pitch_sway {ADVISED_PLATFORM_SIGNAL}: belt", said)
    assert "next: " in said
    assert len(written["pitch_sway"]) == 14


def test_a_machine_that_can_do_nothing_gives_one_clear_line(written, capsys):
    command = ["calibration", "signals", "--kind", "belt", "--belt-m-per-s", "1"]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert re.search("can do none .*: belt_random_60s_1mps: belt_m_per_s ", said)
    assert written == {}
