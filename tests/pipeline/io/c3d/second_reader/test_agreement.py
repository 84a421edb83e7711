"""Our reader and a second one hold the same content, or every difference is named."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.markers import Markers
from pipeline.io.c3d.second_reader import agreement
from pipeline.io.c3d.second_reader.agreement import compare_readers
from pipeline.io.c3d.second_reader.process import installed
from pipeline.io.c3d.second_reader.second_reading import SecondReading, second_reading
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Analog

needs_ezc3d = pytest.mark.skipif(not installed("ezc3d"), reason="no ezc3d wheel for this system")

MIPS = "MIPS processor type not supported yet"
REAL_FILES = {
    "c3d_samples/DEC_INT.C3D": None,
    "c3d_samples/Gait.c3d": None,
    "c3d_samples/TYPE-2.C3D": None,
    "c3d_samples/TYPE-4.C3D": None,
    "c3d_samples/parameterOverflow.c3d": None,
    "c3d_samples/pc_int.c3d": None,
    "c3d_samples/phasespace_sample.c3d": "it reads 0 of 701 frames",
    "c3d_samples/sgi_real.c3d": MIPS,
    "c3d_samples/type1.C3D": "it reads 0 of 6 analog channels",
    "broken/axes_flipped_by_one_bit_53172_3.c3d": MIPS,
    "broken/axes_flipped_by_one_bit_67360_3.c3d": MIPS,
    "full_body_standing/1min_CGM_HBM_static.c3d": None,
    "overground_walks/HC030A01.c3d": None,
    "overground_walks/HC030A05.c3d": None,
    "overground_walks/HC030A22.c3d": None,
    "overground_walks/HC031A01.c3d": None,
    "overground_walks/HC031A06.c3d": None,
    "overground_walks/HC031A23.c3d": None,
    "plug_in_gait/Movement_trial.c3d": None,
    "plug_in_gait/Static_trial.c3d": None,
    "treadmill_hbm2/treadmill_events.c3d": None,
}
"""Every C3D file that our reader does not refuse -> why ezc3d does not read it, if so."""
REFUSED = {
    "c3d_samples/Empty.c3d": "the file is empty",
    "c3d_samples/MACsample.c3d": "the header scales points by",
    "c3d_samples/bad_parameter_section.c3d": "the parameter section is broken",
}


@needs_ezc3d
@pytest.mark.parametrize(("name", "reason"), REAL_FILES.items())
def test_every_real_file_is_the_same_to_ezc3d_or_else_to_c3d(shared_data, name, reason):
    found = compare_readers(shared_data / name)
    assert found.disagreements == ()
    if reason is None:
        assert (found.reader.split()[0], found.refusals) == ("ezc3d", ())
    else:
        assert found.reader.startswith("c3d ")
        (refusal,) = found.refusals
        assert refusal.reader.startswith("ezc3d ")
        assert refusal.reason.startswith(reason)


def test_every_real_file_is_in_the_tests(shared_data):
    files = {path for path in shared_data.rglob("*") if path.suffix.lower() == ".c3d"}
    assert {path.relative_to(shared_data).as_posix() for path in files} == {*REAL_FILES, *REFUSED}


@pytest.mark.parametrize(("name", "message"), REFUSED.items())
def test_a_file_that_our_reader_refuses_is_not_compared(shared_data, name, message):
    with pytest.raises(ValueError, match=message):
        compare_readers(shared_data / name)


@pytest.fixture
def everything(raw_c3d):
    """A file with gaps, channels at three samples a frame, events; frames count from 11."""
    rng = np.random.default_rng(2)
    points = rng.normal(500, 400, size=(20, 5, 4)) * [1, 1, 1, 0]
    points[4:7, 2] = (0, 0, 0, -1)
    return raw_c3d(
        points,
        rng.normal(size=(20, 3, 8)),
        first_frame=11,
        POINT={"LABELS": list("ABCDE")},
        ANALOG={"OFFSET": np.arange(8), "SCALE": rng.normal(size=8), "GEN_SCALE": np.array([0.3])},
        EVENT={
            "USED": np.array([2]),
            "CONTEXTS": ["Left", "Right"],
            "LABELS": ["Foot Strike", "Foot Off"],
            "TIMES": np.array([[0.0, 0], [0.05, 0.1]]),
        },
    )


READINGS = {}
"""Library -> its reading of that file, which is the same in every test."""


def changed(**fields):
    """Change what the second reader reads, as arrays that may be written to."""

    def apply(reading):
        copies = {}
        for name, change in fields.items():
            value = getattr(reading, name)
            value = value.copy() if isinstance(value, np.ndarray) else dict(value)
            copies[name] = change(value) or value
        return replace(reading, **copies)

    return apply


@pytest.mark.parametrize("library", ["ezc3d", "c3d"])
@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            changed(analog=lambda a: a.__setitem__((16, 6), np.nextafter(a[16, 6] * 1.0001, 0))),
            "channel A6, frame 16, sample 2: ",
        ),
        (
            changed(points=lambda p: p.__setitem__((3, 1, 2), p[3, 1, 2] + 0.01)),
            "marker B, frame 14: (",
        ),
        (
            changed(residuals=lambda r: r.__setitem__((slice(3, 6), 0), -1)),
            ") here, missing by {reader}, and 2 further differ",
        ),
        (
            changed(points=lambda p: p.__setitem__((5, 2), 1), residuals=lambda r: r.fill(0)),
            "marker C, frame 16: missing here, (1, 1, 1) by {reader}",
        ),
        (
            changed(parameters=lambda p: p.update({"EVENT:TIMES": (*p["EVENT:TIMES"][:3], 0.2)})),
            "parameter EVENT:TIMES(4): 0.100000001 here, 0.2 by {reader}",
        ),
        (
            changed(parameters=lambda p: p.update({"POINT:LABELS": ("A", "X", "C", "D", "E")})),
            "parameter POINT:LABELS(2): 'B' here, 'X' by {reader}",
        ),
        (
            changed(parameters=lambda p: p.update({"POINT:UNITS": ("m",)})),
            "parameter POINT:UNITS: 'mm' here, 'm' by {reader}",
        ),
        (
            changed(parameters=lambda p: p.update({"FORCE_PLATFORM:LIST": (1.0,)})),
            "parameter FORCE_PLATFORM:LIST: 0 values here, 1 values by {reader}",
        ),
        (
            changed(parameters=lambda p: p.pop("EVENT:LABELS") and None),
            "parameter EVENT:LABELS: 2 values here, 0 values by {reader}",
        ),
        (lambda r: replace(r, rate_hz=99.0), "header frame rate: 100.0 here, 99.0 by {reader}"),
        (lambda r: replace(r, first_frame=1), "header first frame: 11 here, 1 by {reader}"),
        (lambda r: replace(r, events=(("RHS", 0.2),)), "header events: () here, (('RHS', 0.2),)"),
    ],
)
def test_any_difference_is_named_with_channel_frame_and_values(
    everything, monkeypatch, library, change, line
):
    if not installed(library):
        pytest.skip(f"no {library} wheel for this system")

    def altered(path, header):
        if library not in READINGS:
            READINGS[library] = second_reading(path, header, [library]).reading
        return SecondReading(change(READINGS[library]), ())

    monkeypatch.setattr(agreement, "second_reading", altered)
    found = compare_readers(everything)
    (printed,) = found.lines()
    assert line.format(reader=found.reader) in printed


@pytest.mark.parametrize("library", ["ezc3d", "c3d"])
@pytest.mark.parametrize("scale", [-1.0, 0.1])
def test_equal_content_has_no_difference(raw_c3d, monkeypatch, library, scale):
    """Scales are no powers of two and offsets differ, so the order of scaling would show."""
    if not installed(library):
        pytest.skip(f"no {library} wheel for this system")
    rng = np.random.default_rng(3)
    path = raw_c3d(
        rng.integers(-30000, 30000, size=(50, 7, 4)) * [1, 1, 1, 0],
        rng.integers(-30000, 30000, size=(50, 4, 6)),
        scale=scale,
        POINT={"LABELS": list("ABCDEFG")},
        ANALOG={
            "OFFSET": rng.integers(0, 30000, size=6),
            "SCALE": rng.normal(size=6),
            "GEN_SCALE": np.array([0.0123]),
        },
    )
    monkeypatch.setattr(agreement, "second_reading", lambda *file: second_reading(*file, [library]))
    found = compare_readers(path)
    assert found.reader.startswith(library)
    assert found.lines() == []


@needs_ezc3d
@pytest.mark.parametrize("scale", [-1.0, 0.1])
@pytest.mark.parametrize(("offset", "form"), [(-100, "SIGNED"), (40000, "UNSIGNED")])
def test_that_ezc3d_takes_offsets_without_sign_is_said_and_c3d_checks(raw_c3d, scale, offset, form):
    """The C3D user guide: signed, or unsigned with the samples where ANALOG:FORMAT says so."""
    samples = np.array([7.0, -3.0, 20000.0, -25536.0 if scale > 0 else 40000.0])
    path = raw_c3d(
        np.full((4, 1, 4), 500.0) * [1, 1, 1, 0],
        samples[:, None, None],
        scale=scale,
        POINT={"LABELS": ["A"]},
        ANALOG={"OFFSET": np.array([offset]), "SCALE": np.array([0.7]), "FORMAT": form},
    )
    found = compare_readers(path)
    assert found.lines() == []
    assert found.reader.startswith("c3d ")
    (refusal,) = found.refusals
    assert refusal.reason == "it takes ANALOG:OFFSET without its sign"


@needs_ezc3d
def test_what_offsets_without_sign_do_not_explain_is_a_disagreement(raw_c3d, monkeypatch):
    path = raw_c3d(
        np.full((4, 1, 4), 500.0) * [1, 1, 1, 0],
        np.arange(4.0)[:, None, None],
        POINT={"LABELS": ["A"]},
        ANALOG={"OFFSET": np.array([-100])},
    )

    def altered(*file):
        reading = second_reading(*file).reading
        return SecondReading(changed(analog=lambda a: a.__setitem__((2, 0), 5.0))(reading), ())

    monkeypatch.setattr(agreement, "second_reading", altered)
    (printed,) = compare_readers(path).lines()
    assert printed.startswith("channel A0, frame 1: 100 here, -100 by ezc3d ")


@needs_ezc3d
def test_that_others_count_frames_in_16_bits_is_said_and_no_disagreement(tmp_path):
    """ezc3d 1.7.2 reads 65,535 frames of its own files, which have a group ROTATION."""
    ezc3d = pytest.importorskip("ezc3d")
    made = ezc3d.c3d()
    made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    made["parameters"]["POINT"]["LABELS"]["value"] = ["A", "B"]
    made["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    made["data"]["points"] = np.ones((4, 2, 66_000))
    path = tmp_path / "long.c3d"
    made.write(str(path))
    found = compare_readers(path)
    assert (found.reader, found.lines()) == (None, [])
    assert [refusal.reason for refusal in found.refusals] == [
        "it reads 65535 of 66000 frames",
        "it reads 0 of 66000 frames",
    ]


@needs_ezc3d
def test_a_parameter_that_ezc3d_makes_from_the_header_is_no_difference(raw_c3d):
    path = raw_c3d(np.full((4, 1, 4), 500.0) * [1, 1, 1, 0], POINT={"LABELS": ["A"]})
    content = path.read_bytes()
    assert b"\x04\x01RATE" in content
    path.write_bytes(content.replace(b"\x04\x01RATE", b"\x04\x01RITE"))
    found = compare_readers(path)
    assert found.reader.startswith("ezc3d ")
    assert found.lines() == []


@pytest.mark.slow
def test_a_trial_of_twelve_minutes_is_read_twice(tmp_path):
    """72,000 frames of the files that this project writes: within the limits of memory and time."""
    time, sample_time = np.arange(72_000) / 100, np.arange(720_000) / 1000
    position = np.ones((72_000, 46, 3)) * time[:, None, None]
    markers = Markers(time, tuple(f"M{k}" for k in range(46)), position)
    names = tuple(f"A{k}" for k in range(12))
    values = np.ones((720_000, 12)) * sample_time[:, None]
    path = tmp_path / "long.c3d"
    write_c3d(path, markers, analog=Analog(sample_time, names, ("V",) * 12, values))
    found = compare_readers(path)
    assert found.reader.startswith("ezc3d " if installed("ezc3d") else "c3d ")
    assert found.lines() == []
