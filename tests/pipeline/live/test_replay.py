"""A recording that is replayed sends every sample in order, whatever the chunks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.io.recording import Analog
from pipeline.live.replay import RecordedSource, recorded_streams
from tests.pipeline.other_formats import excerpt


@pytest.fixture(scope="module")
def trial(walker):
    time = np.arange(250) / 250 + 0.0013
    analog = Analog(time, ("Belt",), ("m/s",), np.sin(time)[:, None])
    return replace(excerpt(walker, 500, 600), analog=analog)


def gather(source):
    """Samples of each stream in the order of arrival."""
    found = {each.name: [] for each in source.streams}
    while not source.ended:
        for samples in source.receive(0.0):
            found[samples.stream].append(samples)
    return {
        name: (np.concatenate([s.time for s in each]), np.concatenate([s.values for s in each]))
        for name, each in found.items()
    }


def test_plates_of_several_rates_are_several_streams(trial):
    left, right = trial.plates
    slow = replace(right, time=right.time[::5], wrench_in_plate=right.wrench_in_plate[::5])
    names = [s.description.name for s in recorded_streams(replace(trial, plates=(left, slow)))]
    assert names == ["Markers", "Plates", "Plates 2", "Analog"]


@settings(max_examples=10)
@given(chunk_s=st.floats(1e-4, 2.0))
def test_every_sample_comes_once_and_in_order_whatever_the_chunks(trial, chunk_s):
    found = gather(RecordedSource(trial, chunk_s))
    for stream in recorded_streams(trial):
        times, values = found[stream.description.name]
        np.testing.assert_array_equal(times, stream.time)
        np.testing.assert_array_equal(values, stream.values)
