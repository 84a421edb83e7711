"""Processes that work on trials start where they pay, end when asked, and leave no file."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from joblib import delayed
from threadpoolctl import threadpool_info, threadpool_limits

from pipeline.run.processes import in_processes

INTERRUPTED_IN_THE_SEARCH = """
import os, signal, time
import scipy.linalg
from joblib import delayed
from pipeline.run.processes import in_processes
realpath = os.path.realpath
def interrupt(path, **options):
    os.path.realpath = realpath
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.1)
    return realpath(path, **options)
signal.signal(signal.SIGINT, signal.default_int_handler)
os.path.realpath = interrupt
try:
    print(*in_processes([delayed(int)()], 1))
except KeyboardInterrupt:
    print("interrupted")
"""


STOPPED_AS_PROCESSES_START = """
import os, signal, threading, time
from joblib import delayed
from pipeline.run.processes import in_processes
class Request(BaseException):
    pass
def stop(number, frame):
    raise Request
def tasks():
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.2)
    print("started", flush=True)
    yield delayed(int)()
    yield delayed(int)()
threading.Thread(target=time.sleep, args=(1.0,)).start()
signal.signal(signal.SIGTERM, stop)
try:
    print(*in_processes(tasks(), 2))
except Request:
    print("stopped")
"""

KILLED_AS_A_WORKER_WRITES = """
import os, signal, sys, time
from pathlib import Path
from joblib import delayed
from pipeline.io.write import whole_file
from pipeline.run.processes import in_processes
def write(path):
    with whole_file(path) as temporary:
        temporary.write_text("a half")
        time.sleep(60.0)
def tasks():
    for name in ("one", "two"):
        yield delayed(write)(Path(sys.argv[1]) / name)
    while len(list(Path(sys.argv[1]).glob(".*.part"))) < 2:
        time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGKILL)
print(*in_processes(tasks(), 2))
"""


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize(
    ("program", "printed"),
    [
        (INTERRUPTED_IN_THE_SEARCH, "interrupted\n"),
        (STOPPED_AS_PROCESSES_START, "started\nstopped\n"),
    ],
    ids=["while libraries of linear algebra are searched", "while processes start"],
)
def test_no_request_to_end_is_lost_and_processes_that_start_are_awaited(program, printed):
    """Half-started, they could not be ended; any other thread may be the one that it reaches."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == printed, done.stderr


@pytest.mark.parametrize(("tasks", "started"), [(9, False), (12, True)])
def test_no_process_starts_for_fewer_than_five_tasks(tasks, started, monkeypatch):
    monkeypatch.setattr("joblib.cpu_count", lambda: 2)
    elsewhere = {*in_processes([delayed(os.getpid)()] * tasks)} - {os.getpid()}
    assert bool(elsewhere) == started


def threads_of_linear_algebra():
    np.ones((50, 50)) @ np.ones((50, 50))
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


threads_counted = pytest.mark.skipif(
    not threads_of_linear_algebra(),
    reason="the threads of this linear algebra cannot be counted",
)


@threads_counted
@pytest.mark.parametrize("workers", [1, 2])
def test_linear_algebra_uses_one_thread_in_any_number_of_processes(workers):
    """Sums in another order would make results differ with the number of processes."""
    with threadpool_limits(2):
        assert list(in_processes([delayed(threads_of_linear_algebra)()] * 2, workers)) == [{1}] * 2
        assert threads_of_linear_algebra() == {2}


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_workers_of_a_killed_process_leave_no_file_that_they_were_writing(tmp_path):
    command = [sys.executable, "-c", KILLED_AS_A_WORKER_WRITES, tmp_path]
    assert subprocess.run(command, check=False, timeout=60).returncode == -signal.SIGKILL
    give_up = time.monotonic() + 20.0
    while (unfinished := list(tmp_path.iterdir())) and time.monotonic() < give_up:
        time.sleep(0.05)
    assert unfinished == []
