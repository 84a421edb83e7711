"""Fixtures for all tests: the real recordings; tests that need them skip where they are missing."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data():
    """Folder of real recordings; they are never part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real recordings are missing (../shared/data)")
    return SHARED_DATA
