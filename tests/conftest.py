"""For all tests: the real recordings, without which tests of them skip; no test by the clock."""

from pathlib import Path

import pytest
from hypothesis import settings

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(scope="session")
def shared_data():
    """Folder of real recordings; they are never part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real recordings are missing (../shared/data)")
    return SHARED_DATA
