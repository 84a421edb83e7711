"""Only regular files are opened, and none that is larger than any of its kind."""

import os
import threading

import pytest

from pipeline.budgets.explanation import Explanation, read_explanation
from pipeline.config.plate_correction import read_plate_correction
from pipeline.config.study import read_study
from pipeline.config.toml_file import read_segments
from pipeline.io.opensim import read_sto
from pipeline.io.read import read_recording
from pipeline.io.write import read_csv
from pipeline.run.store import read_trial
from pipeline.trial.ground.calibrations import read_laboratory
from pipeline.virtual_lab.protocol.walking_trial import simulate_trial


def opened_within_5_s(read, path):
    """Give what a reader raises; a writer frees it where it waits for the other end of a pipe."""
    raised = []

    def call():
        try:
            read(path)
        except (OSError, ValueError) as error:
            raised.append(error)

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(5)
    return raised


TRC = b"PathFileType\t4\t(X/Y/Z)\ta.trc\n" + b" \n" * 40_000
"""Longer than what a format is recognised by, as are those below."""
LARGE = {
    "a.c3d": (read_recording, b""),
    "a.trc": (read_recording, TRC),
    "a.mox": (read_recording, b"<moxie_viewer_datafile>" + b" \n" * 40_000),
    "a.txt": (read_recording, b"TimeStamp\tFrameNumber\tA.PosX\n" + b" \n" * 40_000),
    "a.csv": (read_recording, b"Trajectories\n100\n,,A,,\nFrame,Sub Frame,X\n" + b" \n" * 40_000),
    "a.xdf": (read_recording, b"XDF:"),
    "a.mot": (read_sto, b"endheader\n"),
    "segments.toml": (read_segments, b""),
    "study.toml": (read_study, b""),
    "plates.json": (read_plate_correction, b""),
    "calibration.json": (lambda path: read_laboratory(path, (), {}, None), b""),
    "a.parquet": (read_trial, b"PAR1"),
    "a_explained.json": (lambda path: read_explanation(path, Explanation), b""),
    "residuals.csv": (read_csv, b""),
}


@pytest.mark.skipif(os.name == "nt", reason="zeros take no place on other disks")
@pytest.mark.parametrize("name", LARGE)
def test_a_file_larger_than_any_of_its_kind_is_refused_by_its_size(tmp_path, name):
    read, head = LARGE[name]
    path = tmp_path / name
    if name == "a.c3d":
        simulate_trial(path, duration_s=2.0)
    else:
        path.write_bytes(head)
    os.truncate(path, 5 * 10**9)
    with pytest.raises((ValueError, OSError), match=r"5,000 MB.* (2,147|67) MB"):
        read(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize("read", [read_recording, read_sto, read_segments])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, read):
    pipe = tmp_path / "pipe.c3d"
    os.mkfifo(pipe)
    (error,) = opened_within_5_s(read, pipe)
    assert "pipe" in error.strerror
