"""What all tests share: where real recordings lie, and when a test that needs them is skipped."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data():
    """Folder of real recordings; they are never part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real recordings are not here (../shared/data)")
    return SHARED_DATA
