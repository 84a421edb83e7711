"""A subject's value over several recordings is the RMS of all that counts in them."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.statistics.recordings import pool_recordings

CELL = {"subject": "s1", "condition": "sway", "compensated": False, "axis": "Fx", "unit": "N"}


def recordings(rms, cycles, frames=1000, window="cycle"):
    """Rows of one subject in one condition."""
    table = pd.DataFrame({"rms": rms, "n_cycles": cycles}).assign(**CELL)
    sizes = {"rms_percent": table["rms"] / 7, "expected": 2 * table["rms"]}
    return table.assign(**sizes, n_frames=frames, window=window)


def value(table, weigh="cycle"):
    (row,) = pool_recordings(table, weigh).itertuples()
    return row


@given(st.lists(st.tuples(st.floats(0.1, 100), st.integers(1, 50)), min_size=2, max_size=6))
def test_a_value_over_recordings_is_the_rms_of_all_their_gait_cycles(found):
    rms, cycles = np.transpose(found)
    every_cycle = np.repeat(rms, cycles.astype(int))
    pooled = value(recordings(rms, cycles.astype(int)))
    assert pooled.rms == pytest.approx(np.sqrt(np.mean(every_cycle**2)))
    assert pooled.rms_percent == pytest.approx(pooled.rms / 7)
    assert pooled.expected == pytest.approx(2 * pooled.rms)
    assert (pooled.n_recordings, pooled.n_cycles) == (len(rms), len(every_cycle))


def test_a_recording_whose_markers_show_all_adds_nothing_to_what_is_expected():
    mixed = recordings([3.0, 3.0], [10, 10]).assign(expected=[np.nan, 4.0])
    assert value(mixed).expected == pytest.approx(np.sqrt(4.0**2 / 2))
    assert np.isnan(value(mixed.assign(expected=np.nan)).expected)


def test_recordings_are_equal_where_the_study_says_so():
    assert value(recordings([1.0, 7.0], [30, 10]), "recording").rms == pytest.approx(5.0)


def test_one_recording_keeps_its_value_to_the_last_bit():
    assert value(recordings([0.1], [3])).rms == 0.1


def test_recordings_without_gait_cycles_are_pooled_by_frames():
    pooled = value(recordings([1.0, 7.0], [0, 0], frames=[3000, 1000], window="span"))
    assert pooled.rms == pytest.approx(np.sqrt((3 * 1 + 49) / 4))


def test_steps_and_gait_cycles_are_pooled_by_frames():
    """They are units of different length."""
    mixed = recordings([1.0, 7.0], [10, 20], frames=[3000, 1000], window=["cycle", "step"])
    pooled = value(mixed)
    assert pooled.rms == pytest.approx(np.sqrt((3 * 1 + 49) / 4))
    assert pooled.window == "cycle and step"
