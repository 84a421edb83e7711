"""A rewritten file is accepted only where nothing differs but what was to change."""

import struct
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.io.c3d.header import read_header
from pipeline.io.c3d.parameters import parameter_records
from pipeline.io.c3d.second_reader.rewritten import check_rewritten

SECOND = "ezc3d" if find_spec("ezc3d") else "c3d"


@pytest.fixture
def original(raw_c3d):
    """A file with five points, eight channels at three samples a frame, and events."""
    rng = np.random.default_rng(1)
    return raw_c3d(
        rng.normal(500, 400, size=(20, 5, 4)) * [1, 1, 1, 0],
        rng.normal(size=(20, 3, 8)),
        first_frame=11,
        POINT={"LABELS": list("ABCDE")},
        EVENT={
            "USED": np.array([2]),
            "CONTEXTS": ["Left", "Right"],
            "LABELS": ["Foot Strike", "Foot Off"],
            "TIMES": np.array([[0.0, 0], [0.05, 0.1]]),
        },
    )


def rewritten(original, change):
    """Copy a file and change its bytes, given them and where the data begin."""
    header, _ = read_header(original)
    content = bytearray(original.read_bytes())
    change(content, header.data_start, header.frame.bytes)
    path = original.with_name("written.c3d")
    path.write_bytes(content)
    return path


def test_a_copy_is_accepted_and_the_second_reader_is_named(original):
    found = check_rewritten(original, rewritten(original, lambda *_: None), changed_channels=())
    assert found.reader.startswith(f"{SECOND} ")


def flipped(word, frame):
    """Flip the lowest bit of a word of one frame."""

    def change(content, start, size):
        content[start + frame * size + 4 * word] ^= 1

    return change


@pytest.mark.parametrize(
    ("word", "message"),
    [
        (4 + 1, "marker B y, frame 14: "),
        (4 + 3, "marker B residual, frame 14: "),
        (20 + 8 + 6, "channel A6, frame 14, sample 2: "),
    ],
)
def test_one_bit_outside_the_changed_channels_is_named(original, word, message):
    written = rewritten(original, flipped(word, 3))
    with pytest.raises(ValueError, match=r"^the copy is not made_to_order") as caught:
        check_rewritten(original, written, changed_channels=(0, 1, 5))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_changed_channel_may_differ(original):
    written = rewritten(original, flipped(20 + 8 + 6, 3))
    assert check_rewritten(original, written, changed_channels=(6,)).reader


def test_a_parameter_may_differ_only_where_it_is_named(original):
    def change(content, *_):
        at = content.index(struct.pack("<f", 0.05))
        content[at : at + 4] = struct.pack("<f", 0.06)

    written = rewritten(original, change)
    with pytest.raises(ValueError, match=r"EVENT:TIMES\(2\): 0.05\d* in the original, 0.0599"):
        check_rewritten(original, written, changed_channels=())
    assert check_rewritten(
        original, written, changed_channels=(), changed_parameters=["EVENT:TIMES"]
    ).reader


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"\x05LABELS", b"\x05LOBELS", "parameter POINT:LABELS: 5 values in the original, 0"),
        (b"\x04UNITS", b"\xfbUNITS", "parameter "),  # locked
        (b"Foot Strike", b"Foot Strick", "EVENT:LABELS"),
    ],
)
def test_names_locks_and_texts_of_parameters_are_compared(original, old, new, message):
    def change(content, *_):
        at = content.index(old[1:])
        content[at - 1 : at - 1 + len(old)] = new

    with pytest.raises(ValueError, match=message):
        check_rewritten(original, rewritten(original, change), changed_channels=())


def test_the_start_of_the_data_in_the_parameters_moves_as_the_headers(original):
    def change(content, *_):
        at = content.index(b"DATA_START") + len(b"DATA_START") + 5
        content[at] += 1

    with pytest.raises(ValueError, match=r"POINT:DATA_START: \d+ after the move in the original"):
        check_rewritten(original, rewritten(original, change), changed_channels=())


@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_no_bit_may_change_but_the_place_of_the_data_and_the_end_of_the_parameters(
    original, place, bit
):
    """Free are bytes 17 and 18, POINT:DATA_START, the length of the section, and what ends it."""
    content = original.read_bytes()
    header, _ = read_header(original)
    section, start = ((k - 1) * 512 for k in (header.parameter_block, header.data_block))
    records = list(parameter_records(content[section + 4 : start], header.byte_order))
    (data_start,) = (record for record in records if record.name == "DATA_START")
    free = {16, 17, *range(section, section + 3)}
    first = section + 4
    free |= set(range(first + data_start.start, first + data_start.pointer + data_start.step))
    free |= {first + records[-1].pointer, first + records[-1].pointer + 1}
    free |= set(range(len(content[:start].rstrip(b"\0")), start))
    at = int(place * len(content))
    written = rewritten(original, lambda c, *_: c.__setitem__(at, c[at] ^ (1 << bit)))
    if at in free:
        return
    with pytest.raises(ValueError, match=r"^the copy is not ") as caught:
        check_rewritten(original, written, changed_channels=())
    assert "\n" not in str(caught.value)


def test_a_file_cut_short_is_not_the_original(original):
    def change(content, *_):
        del content[-8:]

    written = rewritten(original, change)
    with pytest.raises(
        ValueError,
        match=r"written again: the file says it has 20 frames",
    ):
        check_rewritten(original, written, changed_channels=())
