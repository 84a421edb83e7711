"""A few rounds of the campaign of faults of live streams; ``tests.campaign.live`` plays more."""

import pytest

from tests.campaign import live


@pytest.fixture(scope="module")
def walk():
    return live.walk_on_platform()


@pytest.mark.parametrize("seed", range(3))
def test_every_frame_is_accounted_for_whatever_goes_wrong(walk, seed):
    counts = live.play_with_faults(walk, seed).counts
    assert counts.received > 100
