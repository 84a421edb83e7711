"""Processes that work on trials."""

import os
import subprocess
import sys

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


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_no_interrupt_is_lost_while_libraries_of_linear_algebra_are_searched():
    command = [sys.executable, "-c", INTERRUPTED_IN_THE_SEARCH]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout == "interrupted\n", done.stderr


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


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_request_to_end_waits_until_processes_have_started():
    """Half-started, they could not be ended; any other thread may be the one that it reaches."""
    command = [sys.executable, "-c", STOPPED_AS_PROCESSES_START]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stdout == "started\nstopped\n", done.stderr


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
