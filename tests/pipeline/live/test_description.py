"""What is sent and what is recorded say the same of a stream, and it is read back as it was."""

from xml.etree.ElementTree import Element, fromstring, tostring

from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.live import Live
from pipeline.io.streams import Channel, parse_channels
from pipeline.live.output import describe, described_streams, description_of
from pipeline.live.replay import RecordedSource, recorded_streams
from pipeline.live.stream import LAB_AXES

words = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=8)


@settings(max_examples=25)
@given(st.lists(st.builds(Channel, words, words, words, words, words), min_size=1, max_size=5))
def test_channels_are_read_back_as_they_were_described(channels):
    info = described(describe(channels))
    assert parse_channels(info, len(channels)) == tuple(channels)


def described(desc):
    """The description as a stream's."""
    info = Element("info")
    info.append(desc)
    return fromstring(tostring(info))


def test_a_recorded_stream_is_described_as_a_replayed_one(walker):
    """The one is written into XDF, the other sent by Lab Streaming Layer."""
    recorded = described_streams(RecordedSource(walker).streams, Live(), walker.plates)
    for info, stream in zip(recorded, recorded_streams(walker), strict=True):
        parts = [("axes", LAB_AXES)] if stream.description.kind == "markers" else []
        _, _, channels, *_ = description_of(stream.description, Live(), stream.plates)
        sent = describe(channels, parts, stream.plates)
        assert tostring(info.find("desc")) == tostring(sent)
        assert info.findtext("channel_count") == str(stream.values.shape[1])
