"""Recordings as streams: every sample in order, whatever the chunks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbm.markers import Markers
from pipeline.io.recording import Analog, Recording
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


def test_a_recording_has_a_stream_per_device(trial):
    markers, plates, analog = recorded_streams(trial)
    assert markers.description.labels == trial.markers.names
    assert markers.description.kind == "markers"
    np.testing.assert_array_equal(markers.values.reshape(100, -1, 3), trial.markers.position)
    assert plates.description.labels[:6] == (
        "FP1.Fx",
        "FP1.Fy",
        "FP1.Fz",
        "FP1.Mx",
        "FP1.My",
        "FP1.Mz",
    )
    assert plates.description.units[:6] == ("N",) * 3 + ("N·m",) * 3
    np.testing.assert_array_equal(plates.values[:, 6:], trial.plates[1].wrench_in_plate)
    assert plates.description.rate_hz == pytest.approx(1000)
    assert analog.description.labels == ("Belt",)


def test_plates_of_several_rates_are_several_streams(trial):
    left, right = trial.plates
    slow = replace(right, time=right.time[::5], wrench_in_plate=right.wrench_in_plate[::5])
    names = [s.description.name for s in recorded_streams(replace(trial, plates=(left, slow)))]
    assert names == ["Markers", "Plates", "Plates 2", "Analog"]


def test_a_recording_of_markers_alone_has_one_stream():
    time = np.arange(10) / 100
    markers = Markers(time, ("A",), np.ones((10, 1, 3)))
    (only,) = RecordedSource(Recording("a.c3d", markers)).streams
    assert (only.name, only.labels) == ("Markers", ("A",))


@settings(deadline=None, max_examples=30)
@given(chunk_s=st.floats(1e-4, 2.0))
def test_every_sample_comes_once_and_in_order_whatever_the_chunks(trial, chunk_s):
    found = gather(RecordedSource(trial, chunk_s))
    for stream in recorded_streams(trial):
        times, values = found[stream.description.name]
        np.testing.assert_array_equal(times, stream.time)
        np.testing.assert_array_equal(values, stream.values)


def test_a_closed_source_gives_nothing_more(trial):
    source = RecordedSource(trial)
    assert source.receive(0.0)
    source.close()
    assert source.ended
    assert source.receive(0.0) == []
