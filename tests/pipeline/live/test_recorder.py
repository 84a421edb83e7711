"""What is recorded live is the recording, up to the last half second if the process is killed."""

import signal
import subprocess
import sys
import time
from contextlib import closing
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.io.read import read_recording
from pipeline.live import output as module
from pipeline.live.output import RESULTS_FOLDER, STREAMS, Recorder, XdfWriter
from pipeline.live.stream import Samples
from tests.pipeline import xdf_file as xdf
from tests.pipeline.other_formats import excerpt

COLUMNS = ("time_s", "residual.Fz")


@pytest.fixture(scope="module")
def trial(walker):
    return excerpt(walker, 500, 700)


@pytest.fixture(scope="module")
def streams(trial):
    return xdf.recorded(trial)


def described(streams):
    return [ElementTree.fromstring(xdf.header(of)) for of in streams]


def in_chunks(streams, each):
    """The streams' samples as they arrive, so many frames of the cameras at a time."""
    cameras = len(streams[0]["stamps"])
    for start in range(0, cameras, each):
        for of in streams:
            ratio = len(of["stamps"]) // cameras
            part = slice(start * ratio, (start + each) * ratio)
            yield Samples(of["name"], of["stamps"][part], of["values"][part])


def write(path, streams, each=7):
    with closing(XdfWriter(path, described(streams))) as writer:
        for samples in in_chunks(streams, each):
            writer.write(samples)
    return path


@pytest.mark.parametrize("each", [1, 200])
def test_recorded_streams_are_the_trial(trial, streams, tmp_path, each):
    read = read_recording(write(tmp_path / "a.xdf", streams, each))
    np.testing.assert_array_equal(read.markers.position, trial.markers.position)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-12)
    assert {note.code for note in read.notes} == {"axes", "sample_clock"}


@settings(max_examples=10)
@given(share=st.floats(0.1, 1, exclude_max=True))
def test_a_recording_cut_short_holds_all_complete_chunks(streams, trial, tmp_path_factory, share):
    """As after a kill: the file ends anywhere."""
    path = write(tmp_path_factory.mktemp("cut") / "a.xdf", streams)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    read = read_recording(path)
    frames = len(read.markers.time)
    assert frames > share * len(trial.markers.time) - 15
    np.testing.assert_array_equal(read.markers.position, trial.markers.position[:frames])
    assert "cut_short" in [note.code for note in read.notes]


def test_a_file_that_exists_is_not_overwritten(streams, tmp_path):
    path = write(tmp_path / "a.xdf", streams)
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        XdfWriter(path, described(streams))
    assert path.read_bytes() == before


def test_memory_stays_bounded_where_the_disk_stalls(streams, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_WAITING", 10)
    recorder = Recorder(tmp_path, described(streams), COLUMNS)
    for number in range(30):
        recorder.take(np.array([number, 0.0]))
    assert recorder.lost >= 10
    recorder.close()


KILLED = """
import sys, time
from pathlib import Path
from xml.etree import ElementTree
import numpy as np
from pipeline.live.output import Recorder
from pipeline.live.stream import Samples
info = ElementTree.fromstring(sys.argv[2])
recorder = Recorder(Path(sys.argv[1]), [info], ["time_s"])
start = time.monotonic()
for frame in range(100_000):
    while time.monotonic() < start + frame / 100:
        time.sleep(1e-3)
    position = np.array([[0.1, 0.2, 1, 0.1, -0.2, 1]]) + 1e-4 * frame
    recorder.take(Samples("Cameras", np.array([frame / 100]), position))
    recorder.take(np.array([frame / 100]))
    print(frame, flush=True)
"""


def test_of_a_killed_process_at_most_the_last_second_is_missing(tmp_path):
    names = ("LASI", "RASI")
    of = xdf.stream(
        "Cameras",
        "MoCap",
        np.zeros(1),
        np.zeros((1, 6)),
        xdf.described(xdf.marker_channels(names), xdf.tags(axes="forward,left,up")),
        rate=100,
    )
    command = [sys.executable, "-c", KILLED, str(tmp_path / "live"), xdf.header(of).decode()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        # the first file takes as long as its libraries take to load
        results = tmp_path / "live" / RESULTS_FOLDER
        deadline = time.monotonic() + 30
        while len([*results.glob("*.parquet")]) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.4)
        process.send_signal(signal.SIGKILL)
        frames = 2 + process.stdout.read().count("\n")
    read = read_recording(tmp_path / "live" / STREAMS)
    assert len(read.markers.time) > frames - 100
    assert len(pd.read_parquet(tmp_path / "live" / RESULTS_FOLDER)) > frames - 100
