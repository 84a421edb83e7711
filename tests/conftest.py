"""For all tests: the real recordings, without which tests of them skip; no test by the clock.

What measures is a command with ``--help`` and no test.
"""

import gc
from pathlib import Path

import pytest
from hypothesis import settings

collect_ignore = ["benchmarks", "campaign", "validation", "virtual_gait", "virtual_machine"]

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"

# the same few examples every time: what fails, fails again; --hypothesis-profile random explores
settings.register_profile("same", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("few", deadline=None, derandomize=True, max_examples=5)
settings.register_profile("random", deadline=None)
settings.load_profile("same")

gc.set_threshold(50_000)  # as in `pipeline.cli.app.main`


@pytest.fixture(scope="session")
def shared_data():
    """Folder of real recordings; they are never part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real recordings are missing (../shared/data)")
    return SHARED_DATA
