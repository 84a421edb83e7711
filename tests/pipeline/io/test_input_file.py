"""Regular files only are opened."""

import os
import threading

import pytest

from pipeline.config.toml_file import read_segments
from pipeline.io.opensim import read_sto
from pipeline.io.read import read_recording


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


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize("read", [read_recording, read_sto, read_segments])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, read):
    pipe = tmp_path / "pipe.c3d"
    os.mkfifo(pipe)
    (error,) = opened_within_5_s(read, pipe)
    assert error.strerror.startswith("is a pipe or a device")
