"""Lab Streaming Layer on the loopback: what is sent arrives, described, on one clock."""

import itertools
import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.io.read import read_recording
from pipeline.io.recording import Analog, Metadata
from pipeline.io.stated import Stated
from tests.pipeline import xdf_file as xdf
from tests.pipeline.other_formats import excerpt

pytest.importorskip("pylsl", reason="the extra live is not installed")

from pipeline.io.xdf.channels import Channel, parse_channels
from pipeline.live.arrival import known
from pipeline.live.frames.chain import LiveFrame
from pipeline.live.outlet import Outlet, load_lsl, result_channels, result_outlet, result_row
from pipeline.live.replay import Replay, recorded_streams
from pipeline.live.sources import lsl
from pipeline.live.sources.lsl import ClockOffset, LslSource
from pipeline.trial.quality import Quality

AXES = Stated(axes="forward,left,up")
NAMES = ("LASIS", "RASIS", "SACR")
MARKERS = tuple(
    Channel(f"{name}_{axis}", "mm", f"Position{axis}", marker=name)
    for name in NAMES
    for axis in "XYZ"
)
NUMBERS = itertools.count()


@pytest.fixture
def prefix():
    """Tests in several processes do not receive each other's streams."""
    return f"{os.getpid()}.{next(NUMBERS)} "


@pytest.fixture
def trial(walker):
    clock = np.arange(250) / 250
    analog = Analog(clock, ("Belt",), ("m/s",), np.sin(clock)[:, None])
    some = excerpt(walker, 500, 600)
    return replace(some, analog=analog, metadata=Metadata(subject="Anna"), source=Path("Anna.c3d"))


@pytest.fixture
def opened():
    """Sources and outlets to be closed after the test."""
    kept = []
    yield kept
    for each in kept:
        each.close()


def receive(source, count=0, until=lambda: True, timeout_s=10.0):
    """Samples by stream, once every stream has sent so many and it is time."""
    found = {each.name: ([], []) for each in source.streams}
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        for samples in source.receive(0.02):
            found[samples.stream][0].append(samples.time)
            found[samples.stream][1].append(samples.values)
        if until() and all(sum(map(len, times)) >= count for times, _ in found.values()):
            break
    return {name: tuple(map(np.concatenate, both)) for name, both in found.items() if both[0]}


def test_a_replay_arrives_sample_for_sample_with_its_own_intervals(trial, prefix, opened):
    replay = Replay(trial, 5.0, prefix=prefix)
    opened.append(replay)
    source = LslSource(replay.names[0], replay.names[1:])
    opened.append(source)
    assert replay.start(5.0)
    found = receive(source, until=lambda: replay.ended)
    for stream, description in zip(recorded_streams(trial), source.streams, strict=True):
        times, values = found[description.name]
        np.testing.assert_array_equal(values, stream.values)
        np.testing.assert_allclose(times - replay.start_s, stream.time, atol=1e-9)
        own = stream.description
        assert description.name == prefix + own.name
        assert (description.kind, description.labels) == (own.kind, own.labels)
        assert description.units == own.units
        assert description.rate_hz == pytest.approx(own.rate_hz)
    for ours, true in zip(source.plates, trial.plates, strict=True):
        assert (ours.number, ours.channels) == (str(true.number), Live().channels_of(true.number))
        np.testing.assert_array_equal(ours.place.corners, true.corners)
        np.testing.assert_array_equal(ours.place.rotation, true.rotation)
        np.testing.assert_array_equal(ours.place.center, true.center)


def test_positions_are_in_lab_axes_and_metres_and_unseen_markers_are_nan(prefix, opened):
    outlet = Outlet(prefix, "MoCap", MARKERS, 100.0)
    source = LslSource(prefix, stated=Stated(axes="left,back,up", rename={"SACR": "SACRUM"}))
    opened += [outlet, source]
    sent = np.arange(1.0, 10.0)[None] * [[1.0], [2.0], [3.0]]
    sent[1, 3:6] = 0
    sent[2, 6] = np.nan
    outlet.push(load_lsl().local_clock() + np.arange(3) / 100, sent)
    assert source.streams[0].labels == ("LASIS", "RASIS", "SACRUM")
    _, values = receive(source, 3)[prefix]
    np.testing.assert_allclose(values[0], np.array([-2, 1, 3, -5, 4, 6, -8, 7, 9]) / 1e3)
    assert np.isnan(values).sum(axis=0).tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 1]


def test_forces_and_moments_arrive_in_si_units_and_other_units_as_they_are(prefix, opened):
    channels = (Channel("Fz", "kN"), Channel("Mx", "Nmm"), Channel("Acc", "g"), Channel("?"))
    outlet = Outlet(f"{prefix}a", "", channels, 1000.0)
    markers = Outlet(f"{prefix}m", "MoCap", MARKERS, 100.0)
    source = LslSource(f"{prefix}m", [f"{prefix}a"], stated=AXES)
    opened += [outlet, markers, source]
    now = load_lsl().local_clock()
    outlet.push(np.array([now]), np.ones((1, 4)))
    markers.push(np.array([now]), np.ones((1, 9)))
    found = receive(source, 1)
    np.testing.assert_allclose(found[f"{prefix}a"][1], [[1000, 1e-3, 1, 1]])
    assert source.streams[1].units == ("N", "N·m", "g", "")


def test_after_a_pause_no_stream_runs_ahead(trial, prefix, opened):
    """A receiver that was busy for a second gets all streams alike."""
    replay = Replay(trial, 20.0, prefix=prefix)
    source = LslSource(replay.names[0], replay.names[1:])
    opened += [replay, source]
    assert replay.start(5.0)
    while not replay.ended:
        time.sleep(0.05)
    newest = dict.fromkeys(replay.names, replay.start_s)
    while found := source.receive(0.1):
        newest |= {samples.stream: samples.time[-1] for samples in found}
        if min(newest.values()) < replay.start_s + 0.9:
            assert max(newest.values()) - min(newest.values()) < 0.06
    assert min(newest.values()) - replay.start_s > 0.98


def test_a_stream_that_goes_away_and_returns_is_taken_up_again(prefix, opened):
    first = Outlet(prefix, "MoCap", MARKERS, 100.0)
    source = LslSource(prefix, stated=AXES)
    opened.append(source)
    first.push(np.array([load_lsl().local_clock()]), np.ones((1, 9)))
    assert len(receive(source, 1)[prefix][0]) == 1
    first.close()
    assert source.receive(0.3) == []
    second = Outlet(prefix, "MoCap", MARKERS, 100.0)
    opened.append(second)
    for _ in range(100):
        second.push(np.array([load_lsl().local_clock()]), np.full((1, 9), 7.0))
        came = source.receive(0.05)
        if came:
            break
    assert came[0].values[0, 0] == pytest.approx(7e-3)


def await_return(source, name, value, timeout_s=10.0):
    """Send until something arrives; gives it, and the outlet's own times."""
    sent = []
    deadline = time.monotonic() + timeout_s
    with closing(Outlet(name, "MoCap", MARKERS, 100.0)) as outlet:
        while time.monotonic() < deadline:
            sent.append(load_lsl().local_clock())
            outlet.push(np.array(sent[-1:]), np.full((1, 9), value))
            if came := source.receive(0.05):
                return came[0], sent
    raise AssertionError("nothing arrived")


def test_a_sender_whose_clock_began_anew_is_on_this_computers_clock_from_its_first_sample(
    prefix, opened
):
    """As if the clock had been an hour behind before the sender's computer started anew."""
    first = Outlet(prefix, "MoCap", MARKERS, 100.0)
    source = LslSource(prefix, stated=AXES)
    opened.append(source)
    (inlet,) = source._inlets
    inlet.offset = ClockOffset()
    inlet.offset.measure(load_lsl().local_clock(), 3600.0)
    first.close()
    came, sent = await_return(source, prefix, 7.0)
    assert min(abs(came.time[0] - stamp) for stamp in sent) < 0.01


def receive_nothing(source, outlet, values, timeout_s=10.0):
    """Send the same values; nothing may arrive."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        outlet.push(np.array([load_lsl().local_clock()]), values)
        assert source.receive(0.02) == []


@pytest.mark.parametrize("channels", [MARKERS[3:6] + MARKERS[:3] + MARKERS[6:], MARKERS[:6]])
def test_no_sample_of_a_sender_that_comes_back_with_other_channels_is_taken(
    channels, prefix, opened
):
    first = Outlet(prefix, "MoCap", MARKERS, 100.0)
    source = LslSource(prefix, stated=AXES)
    opened.append(source)
    first.push(np.array([load_lsl().local_clock()]), np.ones((1, 9)))
    assert len(receive(source, 1)[prefix][0]) == 1
    first.close()
    second = Outlet(prefix, "MoCap", channels, 100.0)
    opened.append(second)
    expected = (
        f"stream '{prefix}' came back with another description of its channels; begin a new session"
    )
    with pytest.raises(ValueError, match=re.escape(expected)):
        receive_nothing(source, second, np.full((1, len(channels)), 7.0))


def test_receiving_goes_on_while_a_sender_that_is_back_does_not_answer(prefix, opened, monkeypatch):
    """What waits for it is another thread."""
    first = Outlet(prefix, "MoCap", MARKERS, 100.0)
    source = LslSource(prefix, stated=AXES)
    opened.append(source)
    asked, answered = threading.Event(), threading.Event()
    monkeypatch.setattr(lsl, "require_like", lambda *_: (asked.set(), answered.wait(5.0)))
    first.close()
    second = Outlet(prefix, "MoCap", MARKERS, 100.0)
    opened.append(second)
    deadline = time.monotonic() + 10.0
    while not asked.is_set() and time.monotonic() < deadline:
        source.receive(0.02)
    begun = time.monotonic()
    for _ in range(5):
        assert source.receive(0.02) == []
    assert time.monotonic() - begun < 2.0
    answered.set()


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="stops a process as POSIX does")
def test_a_sender_that_hangs_is_replaced_by_one_of_its_name(prefix, opened):
    """A process that is stopped keeps its connection, as a computer without power does."""
    code = (
        "import time; from tests.pipeline.live.test_lsl import MARKERS, Outlet; "
        f"outlet = Outlet({prefix!r}, 'MoCap', MARKERS, 100.0); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as hung:
        try:
            source = LslSource(prefix, stated=AXES, timeout_s=30.0)
            opened.append(source)
            hung.send_signal(signal.SIGSTOP)
            came, _ = await_return(source, prefix, 7.0, timeout_s=30.0)
            assert came.values[0, 0] == pytest.approx(7e-3)
        finally:
            hung.kill()


def test_streams_that_come_later_are_waited_for_and_meanwhile_named(prefix, opened):
    told = []

    def searching(absent, there):
        told.append((absent, [name for name in there if name.startswith(prefix)]))
        if len(told) == 20:
            opened.append(Outlet(f"{prefix}m", "MoCap", MARKERS, 100.0))
        if len(told) > 20 and len(opened) == 1 and told[-1][1]:
            opened.append(Outlet(f"{prefix}a", "", (Channel("Fz", "N"),), 1000.0))

    source = LslSource(
        f"{prefix}m", [f"{prefix}a"], stated=AXES, timeout_s=20.0, searching=searching
    )
    opened.append(source)
    assert told[0] == ([f"{prefix}m", f"{prefix}a"], [])
    assert ([f"{prefix}a"], [f"{prefix}m"]) in told


def test_a_stream_that_states_no_rate_has_the_one_of_its_time_stamps(prefix, opened):
    outlet = Outlet(prefix, "MoCap", MARKERS, 0.0)
    opened.append(outlet)
    stop = threading.Event()

    def send():
        for k in itertools.count():
            if stop.wait(0.01):
                return
            outlet.push(np.array([k / 128]), np.ones((1, 9)))

    sending = threading.Thread(target=send, daemon=True)
    sending.start()
    try:
        source = LslSource(prefix, stated=AXES)
    finally:
        stop.set()
        sending.join()
    opened.append(source)
    assert source.streams[0].rate_hz == pytest.approx(128, rel=1e-6)


def refused(match, markers, kind=ValueError, stated=AXES, **options):
    with pytest.raises(kind, match=match) as error:
        LslSource(markers, stated=stated, timeout_s=1.0, **options)
    assert str(error.value).isprintable()


def test_streams_that_are_absent_or_not_told_apart_are_one_line(prefix, opened):
    opened.append(Outlet(f"{prefix}there", "MoCap", MARKERS, 100.0))
    absent = "no stream is called '.*' within 1 s; streams there: .*there"
    refused(absent, prefix, ConnectionError)
    refused("named more than once", prefix, analog=[prefix])
    same = load_lsl().StreamInfo(f"{prefix}there", "", 1, 1, "float32", "another")
    other = load_lsl().StreamOutlet(same)
    refused("2 streams are called .*; close all but one of the programs", f"{prefix}there")
    del other


def test_streams_that_lack_something_are_one_line(prefix, opened):
    words = load_lsl().StreamOutlet(load_lsl().StreamInfo(f"{prefix}w", "", 1, 0, "string", "w"))
    opened += [
        Outlet(f"{prefix}b", "", (Channel("Fz", "N"),), 10.0),
        Outlet(f"{prefix}c", "MoCap", MARKERS, 10.0),
    ]
    refused("it sends text, not numbers", f"{prefix}w")
    refused("no markers: no channel of type PositionX", f"{prefix}b")
    refused("axes of its markers are not known", f"{prefix}c", stated=Stated())
    del words


def test_an_address_that_cannot_be_listened_on_is_one_line(prefix):
    refused("no IPv4 address", prefix, listen="everywhere")
    load_lsl()
    refused("listens on 127.0.0.1 already, not on 10.0.0.1", prefix, listen="10.0.0.1")


def test_an_address_of_another_computer_is_one_line(prefix, monkeypatch):
    monkeypatch.setattr("pipeline.live.outlet._listening", [])
    refused("192.0.2.1 is not an address of this computer", prefix, listen="192.0.2.1")


def test_the_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(
        ValueError, match=r"needs the extra live: pip install 'hbm-residuals\[live\]'"
    ):
        load_lsl()


def test_results_are_described_by_labels_and_units(prefix, opened):
    delays = {"filter_delay_s": 0.0375, "resampling_delay_s": 0.02}
    outlet = result_outlet(100.0, **delays, name=prefix)
    opened.append(outlet)
    library = load_lsl()
    (info,) = library.resolve_byprop("name", prefix, timeout=5.0)
    inlet = library.StreamInlet(info)
    info = ElementTree.fromstring(inlet.info(5.0).as_xml())
    assert {name: float(info.findtext(f"desc/{name}")) for name in delays} == delays
    described = parse_channels(info, 106)
    assert described == result_channels()
    inlet.open_stream(5.0)
    q, tau, measured = np.arange(46.0), 100 + np.arange(46.0), np.arange(6.0)
    uncompensated = LiveFrame(
        number=0,
        time=123.26,
        q=q,
        tau={"measured": tau},
        residual={"measured": measured},
        by_foot={},
        contact=np.zeros(2, bool),
        marker_error=np.zeros(1),
        quality=Quality(0),
        computing_s=0.0004,
    )
    both = {"measured": measured, "compensated": -measured}
    tau_of = {"measured": -tau, "compensated": tau}
    compensated = replace(uncompensated, residual=both, tau=tau_of, quality=Quality(3))
    outlet.push_one(123.25, result_row(compensated))
    outlet.push_one(123.26, result_row(uncompensated))
    values, stamps = inlet.pull_chunk(2.0, min_samples=2, as_numpy=True)
    by_label = dict(zip((c.label for c in described), values[0], strict=True))
    assert by_label["q.PelvisX"] == 0
    assert by_label["tau.PelvisY"] == 101
    assert by_label["residual.measured.Fz"] == 2
    assert by_label["residual.compensated.Mz"] == -5
    assert (by_label["quality"], by_label["computing_time"]) == (3, 0.0004)
    assert np.isnan(values[1]).sum() == 6
    np.testing.assert_allclose(stamps, [123.25, 123.26])


@pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="lists sockets as Linux does")
def test_discovery_listens_on_the_loopback_alone(prefix, opened):
    opened.append(Outlet(prefix, "MoCap", MARKERS, 100.0))
    own = {str(f.readlink()) for f in Path("/proc/self/fd").iterdir() if f.is_symlink()}
    rows = [
        line.split()
        for table in ("udp", "udp6")
        for line in Path("/proc/net", table).read_text().splitlines()[1:]
    ]
    addresses = [row[1] for row in rows if f"socket:[{row[9]}]" in own]
    discovery = [a for a in addresses if a.endswith(f":{16571:04X}")]
    assert discovery
    assert set(discovery) == {f"0100007F:{16571:04X}"}


def test_what_labrecorder_writes_of_a_replay_is_the_recording(trial, prefix, tmp_path, opened):
    """The descriptions are those that the replay sends."""
    replay = Replay(trial, prefix=prefix)
    opened.append(replay)
    library = load_lsl()
    streams = []
    for name, stream in zip(replay.names, recorded_streams(trial), strict=True):
        (info,) = library.resolve_byprop("name", name, timeout=5.0)
        said = library.StreamInlet(info).info(5.0).as_xml()
        assert "Anna" not in said
        sent = ElementTree.fromstring(said).find("desc")
        desc = "".join(ElementTree.tostring(part, encoding="unicode") for part in sent)
        own = stream.description
        content = "MoCap" if own.kind == "markers" else "Analog"
        streams.append(
            xdf.stream(own.name, content, stream.time, stream.values, desc, rate=own.rate_hz)
        )
    read = read_recording(xdf.write_xdf(tmp_path / "replay.xdf", streams))
    assert read.markers.names == trial.markers.names
    np.testing.assert_array_equal(read.markers.position, trial.markers.position)
    for ours, true in zip(read.plates, trial.plates, strict=True):
        assert ours.number == true.number
        np.testing.assert_allclose(ours.wrench, true.wrench, atol=1e-12)
    np.testing.assert_array_equal(read.analog.values, trial.analog.values)
    assert read.analog.names == trial.analog.names


def test_the_bridge_of_the_documentation_sends_what_is_understood(prefix, opened):
    page = Path(__file__).parents[3] / "docs" / "live.md"
    (code,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    load_lsl()
    bridge = {}
    exec(code.replace('"Cameras"', f'"{prefix}C"').replace('"Plates"', f'"{prefix}P"'), bridge)
    source = LslSource(f"{prefix}C", [f"{prefix}P"])
    opened.append(source)
    markers, plates = source.streams
    assert (markers.labels, markers.rate_hz) == (("LASIS", "RASIS"), 100)
    assert plates.labels[:4] == ("FP1.ForX", "FP1.ForY", "FP1.ForZ", "FP1.MomX")
    assert plates.units == ("N",) * 3 + ("N·m",) * 3 + ("m",) * 3
    bridge["cameras"].push_sample([10, 20, 30, 40, 50, 60], 1.0)
    bridge["plates"].push_sample(np.arange(1.0, 10.0), 1.0)
    found = receive(source, 1)
    _, values = found[f"{prefix}C"]
    np.testing.assert_allclose(values, [[-0.03, -0.01, 0.02, -0.06, -0.04, 0.05]], atol=1e-9)
    _, values = found[f"{prefix}P"]
    np.testing.assert_allclose(values, [[-3, -1, 2, -6, -4, 5, -9, -7, 8]], atol=1e-9)


def test_a_replay_does_not_wait_for_receivers_of_streams_that_nobody_wants(trial, prefix, opened):
    replay = Replay(trial, 20.0, prefix=prefix)
    source = LslSource(replay.names[0], replay.names[1:-1])
    opened += [replay, source]
    assert not replay.start(60.0)
    assert replay.without_receiver == (replay.names[-1],)
    assert set(receive(source, 1)) == set(replay.names[:-1])


@pytest.mark.parametrize("letter", ["\x07", "\x1b", "\x01"])
def test_a_control_character_in_a_label_is_shown_as_a_question_mark(prefix, opened, letter):
    channels = (Channel(f"F{letter}z", "N"), Channel("Belt", f"m{letter}/s"))
    outlet = Outlet(f"{prefix}a", "", channels, 1000.0)
    markers = Outlet(f"{prefix}m", "MoCap", MARKERS, 100.0)
    opened += [outlet, markers]
    source = LslSource(f"{prefix}m", [f"{prefix}a"], stated=AXES)
    opened.append(source)
    assert source.streams[1].labels == ("F?z", "Belt")
    assert source.streams[1].units == ("N", "m?/s")


def test_infinite_values_arrive_as_gaps_without_a_warning(prefix, opened):
    outlet = Outlet(prefix, "MoCap", MARKERS, 100.0)
    source = LslSource(prefix, stated=Stated(axes="left,back,up"))
    opened += [outlet, source]
    sent = np.ones((2, 9))
    sent[1, :4] = np.inf, -np.inf, 1e300, np.inf
    outlet.push(load_lsl().local_clock() + np.arange(2) / 100, sent)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = known(receive(source, 2)[prefix][1])
    assert np.isfinite(values[0]).all()
    assert np.isnan(values[1, :6]).all() or np.isnan(values[1, [0, 1, 2, 3]]).all()
    assert np.isfinite(values[1, 6:]).all()
