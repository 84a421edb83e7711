"""A second reader reads the same content, or every difference is named; it may crash."""

import sys

import numpy as np
import pytest

from pipeline.io.c3d import second_reader
from pipeline.io.c3d.second_reader import compare_readers, installed

needs_ezc3d = pytest.mark.skipif(not installed(), reason="no ezc3d wheel for this system")
UNREAD = {
    "axes_flipped_by_one_bit_53172_3.c3d": "MIPS processor type not supported",
    "axes_flipped_by_one_bit_67360_3.c3d": "MIPS processor type not supported",
    "phasespace_sample.c3d": "it reads 0 of 701 frames",
    "sgi_real.c3d": "MIPS processor type not supported",
    "type1.C3D": "it reads 0 of 6 analog channels",
}
REFUSED = {
    "Empty.c3d": "the file is empty",
    "MACsample.c3d": "the header scales points by",
    "bad_parameter_section.c3d": "the parameter section is broken",
}
BLOCK = 512


@needs_ezc3d
def test_every_real_file_is_the_same_to_both_readers(shared_data):
    """One of the six walks over ground stands for them."""
    for path in shared_data.rglob("*"):
        if path.suffix.lower() != ".c3d" or (path.match("HC03*") and path.name != "HC030A22.c3d"):
            continue
        if path.name in REFUSED:
            with pytest.raises(ValueError, match=REFUSED[path.name]):
                compare_readers(path)
            continue
        found = compare_readers(path)
        assert found.disagreements == (), path.name
        assert found.refusal.startswith(UNREAD.get(path.name, "")), path.name
        assert bool(found.refusal) == (path.name in UNREAD), path.name


@needs_ezc3d
@pytest.mark.parametrize(
    ("name", "place", "value", "line"),
    [
        ("analog", (16, 6), 7.5, "channel A6, frame 16: "),
        ("points", (3, 1, 2), 7.5, "marker B, frame 14: ["),
        ("points", (5, 2), 1.0, None),
        ("EVENT:TIMES", 3, 0.2, "parameter EVENT:TIMES: "),
    ],
)
def test_any_difference_is_named_with_channel_frame_and_values(
    everything, monkeypatch, name, place, value, line
):
    read = second_reader._read_by_ezc3d

    def altered(path):
        arrays = {key: np.array(array) for key, array in read(path).items()}
        arrays[name][place] = value
        return arrays

    monkeypatch.setattr(second_reader, "_read_by_ezc3d", altered)
    found = compare_readers(everything)
    assert not found.refusal
    if line is None:  # the residual says that the point is a gap
        assert found.disagreements == ()
    else:
        (printed,) = found.disagreements
        assert printed.startswith(line)


@needs_ezc3d
@pytest.mark.parametrize("scale", [-1.0, 0.1])
@pytest.mark.parametrize("offset", [30_000, -100])
def test_equal_content_has_no_difference(raw_c3d, scale, offset):
    """Scales are no powers of two, so the order of scaling would show; ezc3d drops signs."""
    rng = np.random.default_rng(3)
    path = raw_c3d(
        rng.integers(-30000, 30000, size=(50, 7, 4)) * [1, 1, 1, 0],
        rng.integers(-30000, 30000, size=(50, 4, 6)),
        scale=scale,
        POINT={"LABELS": list("ABCDEFG")},
        ANALOG={
            "OFFSET": np.full(6, offset),
            "SCALE": rng.normal(size=6),
            "GEN_SCALE": np.array([0.0123]),
        },
    )
    found = compare_readers(path)
    assert found.disagreements == ()
    assert ("ANALOG:OFFSET" in found.refusal) == (offset < 0)


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        pytest.param(
            "import ctypes; ctypes.string_at(0)",
            "SIGSEGV",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="signals only on POSIX"),
        ),
        ("import time; time.sleep(60)", "more than 1 s"),
        ("import sys; open(sys.argv[2], 'w').write('{')", "without a result"),
    ],
)
def test_a_program_that_crashes_hangs_or_leaves_nothing_costs_one_line(
    everything, monkeypatch, tmp_path, code, reason
):
    program = tmp_path / "program.py"
    program.write_text(code, encoding="utf-8")
    monkeypatch.setattr(second_reader, "PROGRAM", program)
    monkeypatch.setattr(second_reader, "installed", lambda: True)
    monkeypatch.setattr(second_reader, "version", lambda _: "0")
    monkeypatch.setattr(second_reader, "SECONDS", 1.0 if "more than 1 s" in reason else 60.0)
    found = compare_readers(everything)
    assert (found.reader, found.disagreements) == ("ezc3d 0", ())
    assert found.refusal.endswith(reason)


@needs_ezc3d
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited only on Linux")
def test_memory_is_limited(shared_data):
    """Without a limit, ezc3d 1.7.2 takes 12.6 GB and half a minute for this file."""
    path = shared_data / "c3d_samples" / "bad_parameter_section.c3d"
    with pytest.raises(ValueError, match=r"1\.1 GB of memory"):
        second_reader._read_by_ezc3d(path)


def test_a_library_whose_import_is_blocked_is_not_installed(everything, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    found = compare_readers(everything)
    assert found.reader == "ezc3d"
    assert "not installed" in found.refusal
