"""Processes that work on trials."""

import platform
import subprocess
import sys

import pytest

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
