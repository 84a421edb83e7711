"""Processes that work on trials."""

import platform
import subprocess
import sys

import numpy as np
import pytest
from joblib import delayed
from threadpoolctl import threadpool_info, threadpool_limits

from pipeline.run.processes import MANAGER, in_processes

ARRAYS_TWICE = """
import resource, numpy as np
from pipeline.run.processes import keep_freed_memory
keep_freed_memory()
np.ones(4_000_000)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
np.ones(4_000_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


LIBC, VERSION = platform.libc_ver()
OTHER = LIBC != "glibc" or tuple(map(int, VERSION.split("."))) < (2, 36)


@pytest.mark.skipif(OTHER, reason="the C library keeps memory in its own way")
def test_an_array_takes_the_place_of_a_freed_one_without_new_pages():
    done = subprocess.run([sys.executable, "-c", ARRAYS_TWICE], capture_output=True, text=True)
    assert int(done.stdout) < 100, done.stderr


THREADS_THAT_FAIL = f"""
import threading
from pipeline.run.processes import _ignore_failing_manager
_ignore_failing_manager()
installed = threading.excepthook
_ignore_failing_manager()
assert threading.excepthook is installed
for name in ({MANAGER!r}, "another"):
    thread = threading.Thread(target={{}}.__getitem__, args=("worker",), name=name)
    thread.start()
    thread.join()
"""


def test_only_the_thread_that_manages_killed_workers_prints_no_traceback():
    """It may meet a worker that is gone; other threads report what fails, once."""
    done = subprocess.run([sys.executable, "-c", THREADS_THAT_FAIL], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("Traceback") == 1
    assert "Exception in thread another" in done.stderr


def threads_of_linear_algebra():
    np.ones((50, 50)) @ np.ones((50, 50))
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.mark.parametrize("workers", [1, 2])
def test_linear_algebra_uses_one_thread_in_any_number_of_processes(workers):
    """Sums in another order would make results differ with the number of processes."""
    if not threads_of_linear_algebra():
        pytest.skip("the threads of this linear algebra cannot be counted")
    with threadpool_limits(2):
        assert list(in_processes([delayed(threads_of_linear_algebra)()] * 2, workers)) == [{1}] * 2
        assert threads_of_linear_algebra() == {2}
