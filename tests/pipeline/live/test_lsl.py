"""What is sent by Lab Streaming Layer arrives, described, on one clock."""

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from contextlib import closing
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from socket import gethostname
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Analog
from tests.pipeline.other_formats import excerpt

pytest.importorskip("pylsl", reason="the extra live is not installed")

from pipeline.io.streams import Channel, parse_channels
from pipeline.live import lsl
from pipeline.live.lsl import ClockOffset, LslSource
from pipeline.live.output import (
    Outlet,
    append_description,
    describe,
    load_lsl,
    result_channels,
    result_outlet,
)
from pipeline.live.replay import Replay, recorded_streams
from pipeline.live.stream import known

QUICK = (
    "ContinuousResolveInterval = 0.1\nMulticastMinRTT = 0.1\nUnicastMinRTT = 0.1\n"
    "TimeProbeMaxRTT = 0.05\n"
)
"""Streams are asked five times as often as by default, and clocks sooner: tests wait less."""
AXES = ReadOptions(axes="forward,left,up")
NAMES = ("LASIS", "RASIS", "SACR")
MARKERS = tuple(
    Channel(f"{name}_{axis}", "mm", f"Position{axis}", marker=name)
    for name in NAMES
    for axis in "XYZ"
)
NUMBERS = itertools.count()


@pytest.fixture(scope="module", autouse=True)
def _quick_answers():
    """The library is told once per process; what waits for its answers waits less, too."""
    pylsl = import_module("pylsl")
    tell = pylsl.set_config_content
    with pytest.MonkeyPatch.context() as patch:
        quick = lambda text: tell(text.replace("[tuning]\n", f"[tuning]\n{QUICK}"))  # noqa: E731
        patch.setattr(pylsl, "set_config_content", quick)
        patch.setattr(lsl, "ANSWERS_S", 0.15)
        patch.setattr(lsl, "FORGET_S", 0.8)
        yield


@pytest.fixture
def prefix():
    """Tests in several processes do not receive each other's streams."""
    return f"{os.getpid()}.{next(NUMBERS)} "


@pytest.fixture
def trial(walker):
    clock = np.arange(250) / 250
    analog = Analog(clock, ("Belt",), ("m/s",), np.sin(clock)[:, None])
    some = excerpt(walker, 500, 600)
    return replace(some, analog=analog, source=Path("Anna.c3d"))


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
    outlet = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
    source = LslSource(prefix, options=ReadOptions(axes="left,back,up", rename={"SACR": "SACRUM"}))
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
    outlet = Outlet(describe(f"{prefix}a", "", channels, 1000.0))
    markers = Outlet(describe(f"{prefix}m", "MoCap", MARKERS, 100.0))
    source = LslSource(f"{prefix}m", [f"{prefix}a"], options=AXES)
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
    first = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
    source = LslSource(prefix, options=AXES)
    opened.append(source)
    first.push(np.array([load_lsl().local_clock()]), np.ones((1, 9)))
    assert len(receive(source, 1)[prefix][0]) == 1
    first.close()
    assert source.receive(0.3) == []
    second = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
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
    with closing(Outlet(describe(name, "MoCap", MARKERS, 100.0))) as outlet:
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
    first = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
    source = LslSource(prefix, options=AXES)
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


def test_no_sample_of_a_sender_that_comes_back_with_other_channels_is_taken(prefix, opened):
    channels = MARKERS[3:6] + MARKERS[:3] + MARKERS[6:]
    first = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
    source = LslSource(prefix, options=AXES)
    opened.append(source)
    first.push(np.array([load_lsl().local_clock()]), np.ones((1, 9)))
    assert len(receive(source, 1)[prefix][0]) == 1
    first.close()
    second = Outlet(describe(prefix, "MoCap", channels, 100.0))
    opened.append(second)
    with pytest.raises(ValueError, match="another description"):
        receive_nothing(source, second, np.full((1, len(channels)), 7.0))


def test_receiving_goes_on_while_a_sender_that_is_back_does_not_answer(prefix, opened, monkeypatch):
    """What waits for it is another thread."""
    first = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
    source = LslSource(prefix, options=AXES)
    opened.append(source)
    asked, answered = threading.Event(), threading.Event()
    monkeypatch.setattr(lsl, "require_like", lambda *_: (asked.set(), answered.wait(5.0)))
    first.close()
    second = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
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
        "import time; from tests.pipeline.live.test_lsl import MARKERS, Outlet, describe; "
        f"outlet = Outlet(describe({prefix!r}, 'MoCap', MARKERS, 100.0)); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as hung:
        try:
            source = LslSource(prefix, options=AXES, timeout_s=30.0)
            opened.append(source)
            hung.send_signal(signal.SIGSTOP)
            came, _ = await_return(source, prefix, 7.0, timeout_s=30.0)
            assert came.values[0, 0] == pytest.approx(7e-3)
        finally:
            hung.kill()


def test_a_stream_that_states_no_rate_has_the_one_of_its_time_stamps(prefix, opened):
    outlet = Outlet(describe(prefix, "MoCap", MARKERS, 0.0))
    opened.append(outlet)
    stop = threading.Event()

    def send():
        for k in itertools.count():
            if stop.wait(0.002):
                return
            outlet.push(np.array([k / 128]), np.ones((1, 9)))

    sending = threading.Thread(target=send, daemon=True)
    sending.start()
    try:
        source = LslSource(prefix, options=AXES)
    finally:
        stop.set()
        sending.join()
    opened.append(source)
    assert source.streams[0].rate_hz == pytest.approx(128, rel=1e-6)


def second(name, identity):
    """Open a stream of markers with a name that another one has, and an identity of its own."""
    lsl = load_lsl()
    info = lsl.StreamInfo(name, "MoCap", 9, 100.0, "double64", identity)
    append_description(info.desc(), describe("", "", MARKERS, 1.0).find("desc"))
    return lsl.StreamOutlet(info)


def test_of_several_senders_that_is_received_which_a_person_chooses(prefix, opened):
    """It stays the one: where it has gone, the other one is not taken in its place."""
    one, other = second(prefix, "cameras a"), second(prefix, "cameras b")
    source = LslSource(prefix, options=AXES, senders=["cameras b"])
    opened.append(source)
    assert source.streams[0].sender == gethostname()
    now = load_lsl().local_clock()
    one.push_sample([1.0] * 9, now)
    other.push_sample([2.0] * 9, now)
    ((_, values),) = receive(source, 1).values()
    np.testing.assert_allclose(values, 2e-3)
    del other
    deadline = time.monotonic() + 2.5 * lsl.FORGET_S
    while time.monotonic() < deadline:
        one.push_sample([1.0] * 9, load_lsl().local_clock())
        assert not source.receive(0.02)


def refused(match, markers, kind=ValueError, stated=AXES):
    with pytest.raises(kind, match=match):
        LslSource(markers, options=stated, timeout_s=0.5)


def test_streams_that_are_absent_not_told_apart_or_lack_something_are_one_line(prefix, opened):
    opened.append(Outlet(describe(f"{prefix}there", "MoCap", MARKERS, 100.0)))
    absent = "no stream is called '.*' within 0.5 s; streams there: .*there"
    refused(absent, prefix, ConnectionError)
    same = load_lsl().StreamInfo(f"{prefix}there", "", 1, 1, "float32", "another")
    other = load_lsl().StreamOutlet(same)
    several = f"2 streams are called .*: from {gethostname()} .*choose one: --sender COMPUTER"
    refused(several, f"{prefix}there")
    del other
    opened.append(Outlet(describe(f"{prefix}b", "", (Channel("Fz", "N"),), 10.0)))
    refused("no markers: no channel of type PositionX", f"{prefix}b")
    opened.append(Outlet(describe(f"{prefix}c", "MoCap", MARKERS, 10.0)))
    refused("axes of its markers are unknown", f"{prefix}c", stated=ReadOptions())


def test_the_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(ValueError, match=r"pip install 'hbm-residuals\[live\]'"):
        load_lsl()


def test_results_arrive_as_they_were_sent_with_their_labels_and_times(prefix, opened):
    delays = {"filter_delay_s": 0.0375, "resampling_delay_s": 0.02}
    outlet = result_outlet(100.0, **delays, name=prefix)
    opened.append(outlet)
    (info,) = load_lsl().resolve_byprop("name", prefix, timeout=5.0)
    inlet = load_lsl().StreamInlet(info)
    said = ElementTree.fromstring(inlet.info(5.0).as_xml())
    assert {name: float(said.findtext(f"desc/{name}")) for name in delays} == delays
    assert parse_channels(said, 106) == result_channels()
    inlet.open_stream(5.0)
    row = np.arange(106.0)
    outlet.push(np.array([123.25]), row[None])
    values, stamps = inlet.pull_chunk(2.0, min_samples=1, as_numpy=True)
    np.testing.assert_array_equal(values, [row])
    np.testing.assert_allclose(stamps, [123.25])


@pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="lists sockets as Linux does")
def test_discovery_listens_on_the_loopback_alone(prefix, opened):
    opened.append(Outlet(describe(prefix, "MoCap", MARKERS, 100.0)))
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


def test_a_replay_does_not_wait_for_receivers_of_streams_that_nobody_wants(trial, prefix, opened):
    replay = Replay(trial, 20.0, prefix=prefix)
    source = LslSource(replay.names[0], replay.names[1:-1])
    opened += [replay, source]
    assert not replay.start(60.0)
    assert replay.without_receiver == (replay.names[-1],)
    assert set(receive(source, 1)) == set(replay.names[:-1])


def test_infinite_values_arrive_as_gaps_without_a_warning(prefix, opened):
    outlet = Outlet(describe(prefix, "MoCap", MARKERS, 100.0))
    source = LslSource(prefix, options=ReadOptions(axes="left,back,up"))
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
