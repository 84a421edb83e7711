"""A server that speaks Qualisys' protocol is received, and one that does not is told apart."""

import socket
import struct
import time

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.config.schema import Settings, Treadmill
from pipeline.io.read_options import ReadOptions
from pipeline.live import qualisys
from pipeline.live.ground import AnalogStreams, LiveGround
from pipeline.live.light import Kind
from pipeline.live.preparation import place_plates
from pipeline.live.qualisys import Packets, QualisysSource
from pipeline.live.stream import Samples
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline.live.qtm_server import (
    COMMAND,
    DATA,
    ERROR,
    XML,
    QtmServer,
    as_floats,
    composed,
    frame,
    location,
    packet,
    parameters,
    text,
)

NAMES = ("LASIS", "RASIS", "SACR")
AXES = ReadOptions(axes="left,back,up")
CHANNELS = (("Acc.X", "g"), ("Load", "kN"))
FORCE = np.array([30.0, -20.0, 700.0])
POINT_MM = np.array([120.0, -45.0, 0.0])


@pytest.fixture
def server():
    running = QtmServer(parameters(NAMES, plates=("Left", "Right"), channels=CHANNELS))
    yield running
    running.close()


@pytest.fixture
def said():
    """Notes that a source says."""
    return []


def connected(server, said=None, timeout_s=2.0):
    say = said.append if said is not None else lambda finding: None
    return QualisysSource("127.0.0.1", port=server.port, options=AXES, timeout_s=timeout_s, say=say)


@pytest.fixture
def source(server, said):
    received = connected(server, said)
    yield received
    received.close()


def acting_on_plate(count, point_mm=POINT_MM):
    """Force, moment about the centre of the surface and point of application, as sent."""
    moment = np.cross(point_mm / 1e3, FORCE) + np.array([0, 0, 3.0])
    return np.tile(np.concatenate([FORCE, moment, point_mm]), (count, 1))


def frames(numbers, start_s=0.0, point_mm=POINT_MM):
    """Frames at 100 Hz with ten samples of plates and channels each."""
    rng = np.random.default_rng(3)
    for k in numbers:
        positions = rng.uniform(-900, 900, (3, 3))
        analog = rng.uniform(-1, 1, (10, 2))
        forces = [(10 * k, acting_on_plate(10, point_mm))] * 2
        sent = frame(k, start_s + k / 100, positions, analog=(10 * k, analog), forces=forces)
        yield sent, positions, analog


def collect(source, count, timeout_s=3.0):
    """Samples by stream, once so many markers' frames have arrived."""
    found = {each.name: [] for each in source.streams}
    deadline = time.monotonic() + timeout_s
    while len(found["Markers"]) < count and time.monotonic() < deadline:
        for samples in source.receive(0.05):
            found[samples.stream].append(samples)
    return {
        name: (np.concatenate([s.time for s in each]), np.concatenate([s.values for s in each]))
        for name, each in found.items()
        if each
    }


def await_stream(source, server, timeout_s=5.0):
    """Receive until the source has connected again."""
    deadline = time.monotonic() + timeout_s
    while not server.streaming and time.monotonic() < deadline:
        source.receive(0.02)
    assert server.streaming


def test_markers_are_in_lab_axes_and_metres_and_unseen_ones_are_nan(source, server):
    sent = []
    for data, positions, _ in frames(range(5)):
        sent.append(positions)
        server.send(data)
    hidden = np.array([[100.0, 200.0, 300.0], [np.nan] * 3, [1.0, 2.0, 3.0]])
    server.send(frame(5, 0.05, hidden))
    times, values = collect(source, 6)["Markers"]
    np.testing.assert_allclose(times, np.arange(6) / 100, atol=1e-9)
    left, back, up = np.moveaxis(np.array(sent, np.float32) / 1e3, -1, 0)
    expected = np.stack([-back, left, up], axis=-1).reshape(5, -1)
    np.testing.assert_allclose(values[:5], expected, rtol=1e-6)
    assert np.isnan(values[5]).tolist() == [False] * 3 + [True] * 3 + [False] * 3


def test_plates_and_channels_have_the_times_of_their_sample_numbers(source, server):
    sent = []
    for data, _, analog in frames(range(1, 8)):
        sent.append(analog)
        server.send(data)
    found = collect(source, 7)
    for name in ("Left", "Board 1"):
        np.testing.assert_allclose(found[name][0], np.arange(10, 80) / 1000, atol=1e-9)
    channels = np.concatenate(sent).astype(np.float32) * [1, 1000]
    np.testing.assert_allclose(found["Board 1"][1], channels, rtol=1e-6)
    _, wrench = found["Left"]
    np.testing.assert_allclose(wrench[:, :3], np.tile(-FORCE, (70, 1)), rtol=1e-6)
    pressure = [-wrench[0, 4] / wrench[0, 2], wrench[0, 3] / wrench[0, 2]]
    np.testing.assert_allclose(pressure, POINT_MM[:2] / 1e3, atol=1e-6)


def test_moments_about_another_point_than_the_surface_are_refused(source, server):
    wrong = acting_on_plate(30)
    wrong[:, 3:6] += np.cross([0.0, 0.3, 0.0], FORCE)
    server.send(frame(0, 0.0, np.ones((3, 3)), forces=[(0, wrong)]))
    with pytest.raises(ValueError, match=r"'Left': moments .*disagree by 300"):
        collect(source, 9)


def test_other_markers_than_were_named_are_refused(source, server):
    server.send(frame(0, 0.0, np.ones((5, 3))))
    with pytest.raises(ValueError, match=r"5 markers.* 3"):
        collect(source, 9)


def test_a_connection_that_is_lost_is_taken_up_again(source, server, monkeypatch):
    monkeypatch.setattr(qualisys, "RETRY_S", 0.1)
    for data, *_ in frames(range(3)):
        server.send(data)
    assert len(collect(source, 3)["Markers"][0]) == 3
    server.drop_clients()
    await_stream(source, server)
    for data, *_ in frames(range(300, 303)):
        server.send(data)
    times, _ = collect(source, 3)["Markers"]
    np.testing.assert_allclose(times, np.arange(300, 303) / 100, atol=1e-9)


def test_plates_that_lie_elsewhere_when_the_program_is_back_are_refused(
    source, server, monkeypatch
):
    monkeypatch.setattr(qualisys, "RETRY_S", 0.1)
    corners = np.array([[250, -450, 0], [-250, -450, 0], [-250, 450, 0], [250, 450, 0]])
    moved = (location(corners + np.array([600, 0, 0])), location(corners))
    server.settings = parameters(
        NAMES, plates=("Left", "Right"), channels=CHANNELS, locations=moved
    )
    server.drop_clients()
    with pytest.raises(ValueError, match=r"another description .*plates"):
        collect(source, 1, timeout_s=5.0)


def test_time_goes_on_when_another_measurement_begins(source, server):
    for data, *_ in frames(range(200, 203)):
        server.send(data)
    for data, *_ in frames(range(3)):
        server.send(data)
    found = collect(source, 6)
    np.testing.assert_allclose(np.diff(found["Markers"][0]), 0.01, atol=1e-9)
    np.testing.assert_allclose(np.diff(found["Left"][0]), 1e-3, atol=1e-9)


def plates_of(*corners_mm):
    """What is said of plates whose corners are so in left, back, up."""
    sent = parameters(NAMES, plates=("Left", "Right"), locations=tuple(map(location, corners_mm)))
    return Packets(sent.encode(), AXES).plates


def test_places_of_plates_are_those_of_the_settings_in_lab_axes():
    """Of plates whose x points to the left and y to the front, so that z points down."""
    around = np.array([[1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]]) * [250, 450, 0]
    corners = around + np.array([600, -900, 12])
    left, right = plates_of(corners, corners - [1200, 0, 0])
    np.testing.assert_allclose(left.place.center, [0.9, 0.6, 0.012], atol=1e-9)
    np.testing.assert_allclose(right.place.center, [0.9, -0.6, 0.012], atol=1e-9)
    x, y, z = left.place.rotation.T
    np.testing.assert_allclose([x, y, z], [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-9)
    np.testing.assert_allclose(left.place.corners[0], [1.35, 0.85, 0.012], atol=1e-9)


def test_forces_arrive_in_the_lab_without_any_file():
    """Channels and places are those of the settings: the load is where it is applied."""
    around = np.array([[1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]]) * [250, 450, 0]
    placed_mm = [around + np.array([side_mm, -900, 0]) for side_mm in (300, -300)]
    sent = parameters(NAMES, plates=("Left", "Right"), locations=tuple(map(location, placed_mm)))
    server = QtmServer(sent)
    source = connected(server)
    placed = place_plates(source.plates, None, Live())
    analog = AnalogStreams(source.streams[1:])
    channels = [placed.live.channels_of(plate.number) for plate in placed.plates]
    still = Laboratory(Treadmill())
    ground = LiveGround(still, Settings(), placed.plates, channels, analog, source.streams[0])
    for data, *_ in frames(range(12)):
        server.send(data)
    for name, (times, values) in collect(source, 12).items():
        analog.append(Samples(name, times, values))
    source.close()
    server.close()
    (left, right) = ground.at(0.06, None)[0][0]
    x, y, z = FORCE
    x_mm, y_mm, _ = POINT_MM
    for wrench, side_m in ((left, 0.3), (right, -0.3)):
        force, moment = wrench[:3], wrench[3:]
        np.testing.assert_allclose(force, [-y, -x, z], rtol=1e-5)
        point = np.array([0.9 + y_mm / 1e3, side_m + x_mm / 1e3, 0])
        np.testing.assert_allclose(moment[:2], np.cross(point, force)[:2], rtol=1e-5)


def test_corners_that_are_not_set_or_in_another_order_are_no_place():
    order = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * 250.0
    unset, upwards = plates_of(np.zeros((4, 3)), order)
    crossed, unread = plates_of(order[[0, 2, 1, 3]], order * np.nan)
    assert (unset.place, upwards.place, crossed.place, unread.place) == (None,) * 4


SETTINGS = parameters(NAMES, plates=("Left", "Right"), channels=CHANNELS)
PARAMETERS = {
    "axes of its markers are unknown": (SETTINGS, ReadOptions()),
    "no labelled markers; apply an AIM model": parameters(()),
    "broken parameters: its description is no XML": "<QTM_Parameters",
    "broken parameters": b"\xff\xfe\x00\x80",
    "no General/Frequency of the cameras, but '0'": parameters(NAMES, rate=0),
    "no Frequency of Plate Left, but 'fast'": parameters(NAMES, plates=["Left"], force_rate="fast"),
    "Left states 1e\\+09 Hz, expected 1 to 50000": parameters(
        NAMES, plates=["Left"], force_rate=1e9
    ),
    "Board 1 states 0.001 Hz": parameters(NAMES, channels=CHANNELS, force_rate=1e-3),
    "Markers states 1e\\+09 Hz": parameters(NAMES, rate=10**9),
    "no Plate_ID of Plate Left, but ''": SETTINGS.replace("Plate_ID", "Number"),
    "no Device_ID of Device Board 1, but 'one'": SETTINGS.replace("Device_ID>1", "Device_ID>one"),
    "numbers two of Plate 1; change one": SETTINGS.replace("Plate_ID>2", "Plate_ID>1"),
    "streams of one name: Markers": parameters(NAMES, plates=["Markers"]),
}


@pytest.mark.parametrize("message", PARAMETERS)
def test_parameters_that_lack_something_or_cannot_be_are_one_line(message):
    settings, stated = each if isinstance(each := PARAMETERS[message], tuple) else (each, AXES)
    written = settings if isinstance(settings, bytes) else settings.encode()
    with pytest.raises(ValueError, match=message) as refusal:
        Packets(written, stated)
    assert "\n" not in str(refusal.value)


HIGH_BYTE_FIRST = struct.pack(">II", 35, COMMAND) + b"QTM RT Interface connected\0"
REPLIES = {
    "takes the connection, but says nothing in time": {"": b""},
    "sends what is not of its protocol: b'SSH-2.0-OpenSSH_'": {"": b"SSH-2.0-OpenSSH_9.2\r\n"},
    "sends the high byte first; the right port is one less": {"": HIGH_BYTE_FIRST},
    "is no Qualisys Track Manager: it says 'hello'": {"": text(COMMAND, "hello")},
    "it says 'Too many clients'": {"": text(ERROR, "Too many clients")},
    "refuses 'Version 1.25': Version NOT supported": {
        "version": text(ERROR, "Version NOT supported")
    },
    "has not version 1.25": {"version": text(COMMAND, "Version set to 1.0")},
    "does not answer 'Version 1.25' in time": {"version": b""},
    "does not answer 'GetParameters General 3D Analog Force'": {"getparameters": b""},
    "refuses 'GetParameters .*': Parse error": {"getparameters": text(ERROR, "Parse error")},
    "refuses to stream 3D Analog Force: Parse": {"streamframes": text(ERROR, "Parse error")},
    "broken parameters": {"getparameters": text(XML, "<QTM_Param")},
}


@pytest.mark.parametrize("message", REPLIES)
def test_what_fails_before_the_first_frame_is_one_line_that_says_what(message):
    server = QtmServer(SETTINGS, REPLIES[message])
    with pytest.raises((ConnectionError, ValueError), match=message) as failure:
        connected(server, timeout_s=0.3)
    assert "\n" not in str(failure.value)
    server.close()


def test_who_is_not_there_refuses_or_does_not_answer_is_told_apart():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        with pytest.raises(ConnectionError, match=f"127.0.0.1:{port} refuses the connection"):
            QualisysSource("127.0.0.1", port=port, options=AXES)
        unused.listen(0)
        with socket.create_connection(("127.0.0.1", port)), socket.socket() as second:
            second.setblocking(False)  # the queue is full: nobody answers
            second.connect_ex(("127.0.0.1", port))
            with pytest.raises(ConnectionError, match="not answer"):
                QualisysSource("127.0.0.1", port=port, options=AXES, timeout_s=0.2)
    with pytest.raises(ConnectionError, match="no computer"):
        QualisysSource("nobody.invalid", options=AXES)


GOOD = b"".join(data for data, *_ in frames(range(20, 23)))
STALLS = {
    "in the middle of a packet": GOOD[: len(GOOD) // 3 + 50],
    "after a size of 0": struct.pack("<II", 0, DATA),
    "after a size of 4 GB": struct.pack("<II", 0xFFFFFFFF, DATA),
    "after a size that never comes": struct.pack("<II", 1 << 20, DATA) + GOOD,
    "after an unknown kind": packet(77, b"????"),
    "after random bytes": np.random.default_rng(0).bytes(500),
    "after a text": b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "without an answer": b"",
}


@pytest.mark.parametrize("stall", STALLS)
def test_a_connection_that_stalls_with_its_socket_open_is_sought_again(
    source, server, said, monkeypatch, stall
):
    monkeypatch.setattr(qualisys, "SILENT_S", 0.2)
    monkeypatch.setattr(qualisys, "RETRY_S", 0.1)
    server.send(GOOD)
    assert len(collect(source, 3)["Markers"][0]) == 3
    server.replies["qtmversion"] = b""
    server.streaming = False
    server.send(STALLS[stall])
    await_stream(source, server)
    assert server.connections == 2
    for data, *_ in frames(range(40, 43)):
        server.send(data)
    times, _ = collect(source, 3)["Markers"]
    np.testing.assert_allclose(times, np.arange(40, 43) / 100, atol=1e-9)
    assert [finding.kind for finding in said] == [Kind.CONNECTION_LOST]


def test_a_program_that_is_idle_and_answers_keeps_its_connection(source, server, monkeypatch):
    monkeypatch.setattr(qualisys, "SILENT_S", 0.05)
    for _ in range(30):
        source.receive(0.02)
    server.send(GOOD)
    assert len(collect(source, 3)["Markers"][0]) == 3
    assert server.connections == 1


def counted(*numbers):
    return struct.pack(f"<{len(numbers)}i", *numbers)


MARKERS = counted(3, 0) + as_floats(np.ones((3, 3)))
MALFORMED = {
    "no header": packet(DATA, b"1234567"),
    "a count of components that are not there": composed((1, MARKERS), count=9),
    "four thousand million components": composed((1, MARKERS), count=0xFFFFFFFF),
    "a component of 0 bytes": packet(DATA, struct.pack("<qIIII", 0, 0, 1, 0, 1)),
    "a component beyond the packet": packet(DATA, struct.pack("<qIIII", 0, 0, 1, 9999, 1)),
    "an empty component": composed((1, b"")),
    "fewer markers than counted": composed((1, MARKERS[:-4])),
    "a negative number of markers": composed((1, counted(-1, 0) + MARKERS)),
    "two thousand million markers": composed((1, counted(2**31 - 1, 0) + MARKERS)),
    "a negative number of devices": composed((3, counted(-1))),
    "devices that are not there": composed((3, counted(2**31 - 1, 1, 2, 0))),
    "a negative number of channels": composed((3, counted(1, 1, -2, 10, 0))),
    "other channels than named": composed((3, counted(1, 1, 3, 1, 0) + as_floats(np.ones(3)))),
    "a negative number of samples": composed((3, counted(1, 1, 2, -10, 0))),
    "thousand millions of samples": composed((3, counted(1, 1, 2, 2**30, 0))),
    "a negative number of a sample": composed((3, counted(1, 1, 2, 1, -5) + as_floats(np.ones(2)))),
    "a negative number of plates": composed((4, counted(-1))),
    "fewer forces than counted": composed((4, counted(1, 1, 5, 0) + as_floats(np.ones(9)))),
    "a negative number of forces": composed((4, counted(1, 1, -5, 0))),
    "an error": text(ERROR, "No such component"),
}


@pytest.mark.parametrize("fault", MALFORMED)
def test_frames_that_are_malformed_are_left_out_and_said_once(source, server, said, capfd, fault):
    good = [data for data, *_ in frames(range(20, 23))]
    for data in (good[0], MALFORMED[fault], good[1], MALFORMED[fault], good[2]):
        server.send(data)
    times, _ = collect(source, 3)["Markers"]
    np.testing.assert_allclose(times, np.arange(20, 23) / 100, atol=1e-9)
    assert [finding.kind for finding in said] == [Kind.FRAMES_UNREAD]
    assert server.connections == 1
    assert capfd.readouterr() == ("", "")


def test_packets_of_other_kinds_and_components_that_nobody_asked_for_are_ignored(
    source, server, said
):
    server.send(packet(6, b"\x04") + packet(4, b"") + text(COMMAND, "QTM Version is 2024.3"))
    server.send(text(XML, "<QTM_Parameters/>") + composed((17, counted(1)), (9, b"??")) + GOOD)
    assert len(collect(source, 3)["Markers"][0]) == 3
    assert said == []


def test_two_plates_or_devices_of_one_name_are_two_streams():
    twice = parameters(NAMES, plates=("Plate", "Plate", ""), channels=CHANNELS)
    twice = twice.replace("</Device></Analog>", "</Device>{}</Analog>")
    device = twice[twice.index("<Device>") : twice.index("{}")]
    twice = twice.format(device.replace("Device_ID>1", "Device_ID>2"))
    server = QtmServer(twice)
    source = connected(server)
    names = [stream.name for stream in source.streams]
    assert names == ["Markers", "Plate 1", "Plate 2", "3", "Board 1 1", "Board 1 2"]
    assert len({label for stream in source.streams[1:4] for label in stream.labels}) == 18
    forces = [(0, factor * acting_on_plate(1)) for factor in (1, 2, 3)]
    server.send(frame(0, 0.0, np.ones((3, 3)), forces=forces))
    found = collect(source, 1)
    assert [found[name][1][0, 2] for name in names[1:4]] == [-700, -1400, -2100]
    source.close()
    server.close()


@pytest.mark.parametrize("behind", [0, 9])
@pytest.mark.parametrize("numbered", [True, False])
def test_plates_lie_beside_the_frames_whatever_their_numbers_count_from(
    source, server, said, behind, numbered
):
    """Time stamps began 100.3 s before; samples follow their frame, or go before it."""
    for k in range(1000, 1003):
        forces = [(10 * k - behind, acting_on_plate(10))] * 2
        number = k if numbered else 7 * k
        server.send(frame(number, 100.3 + k / 100, np.ones((3, 3)), forces=forces))
    found = collect(source, 3)
    late_s = found["Left"][0][behind] - found["Markers"][0][0]
    assert late_s == pytest.approx(0, abs=1e-6 if numbered else 0.005)
    starts = [finding.subject for finding in said if finding.kind is Kind.START_UNKNOWN]
    assert starts == [("Left",), ("Right",)]
