"""Every frame of a minute of spoilt streams is accounted for."""

import pytest

from tests.campaign.live import attacked, summary


@pytest.mark.slow
def test_every_frame_of_spoilt_streams_is_accounted_for():
    tally = attacked(seed=1, minutes=1.0)
    assert (tally.faults, tally.unaccounted, tally.finite) == ([], 0, True)
    assert tally.received == tally.solved + tally.marked > 1000
    assert "no crash" in summary([tally])
