"""What is sent and what is recorded say the same of a stream, and it is read back as it was."""

from xml.etree.ElementTree import fromstring, tostring

from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.live import Live
from pipeline.io.streams import Channel, parse_channels
from pipeline.live.output import describe, describe_stream
from pipeline.live.replay import recorded_streams

words = st.text("aZ0.&<>\"']µ·²é漢😀", max_size=8)
"""With all that XML writes otherwise, and letters of every length in UTF-8."""


@settings(max_examples=25)
@given(st.lists(st.builds(Channel, words, words, words, words, words), min_size=1, max_size=5))
def test_channels_are_read_back_as_they_were_described(channels):
    info = fromstring(tostring(describe("Plates", "Analog", channels, 100.0)))
    assert parse_channels(info, len(channels)) == tuple(channels)


def test_a_recorded_stream_is_described_as_a_replayed_one(walker):
    """The one is written into XDF, the other sent by Lab Streaming Layer."""
    for stream in recorded_streams(walker):
        recorded = describe_stream(stream.description, Live(), walker.plates)
        sent = describe_stream(stream.description, Live(), stream.plates)
        assert tostring(recorded) == tostring(sent)
        assert recorded.findtext("channel_count") == str(stream.values.shape[1])
