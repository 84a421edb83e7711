"""The vendor's client against a server that speaks its protocol, on the loopback."""

import socket
import time

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.config.schema import Settings, Treadmill
from pipeline.io.stated import Stated
from pipeline.live.ground import AnalogStreams, LiveGround
from pipeline.live.preparation import place_plates
from pipeline.live.stream import Samples
from pipeline.trial.ground.laboratory import Laboratory
from tests.pipeline.live.qtm_server import QtmServer, frame, location, parameters

pytest.importorskip("qtm_rt", reason="the extra live is not installed")

from pipeline.live.qualisys import Packets, QualisysSource

NAMES = ("LASIS", "RASIS", "SACR")
AXES = Stated(axes="left,back,up")
CHANNELS = (("Acc.X", "g"), ("Load", "kN"))
FORCE = np.array([30.0, -20.0, 700.0])
POINT_MM = np.array([120.0, -45.0, 0.0])


@pytest.fixture
def server():
    running = QtmServer(parameters(NAMES, plates=("Left", "Right"), channels=CHANNELS))
    yield running
    running.close()


@pytest.fixture
def source(server):
    received = QualisysSource("127.0.0.1", port=server.port, stated=AXES, timeout_s=2.0)
    server.await_stream()
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
    with pytest.raises(
        ValueError, match="'Left': moments and points of application disagree by 300"
    ):
        collect(source, 9)


def test_other_markers_than_were_named_are_refused(source, server):
    server.send(frame(0, 0.0, np.ones((5, 3))))
    with pytest.raises(ValueError, match="sends 5 markers, but named 3"):
        collect(source, 9)


def test_a_connection_that_is_lost_is_taken_up_again(source, server):
    for data, *_ in frames(range(3)):
        server.send(data)
    assert len(collect(source, 3)["Markers"][0]) == 3
    server.drop_clients()
    server.await_stream()
    for data, *_ in frames(range(300, 303)):
        server.send(data)
    times, _ = collect(source, 3)["Markers"]
    np.testing.assert_allclose(times, np.arange(300, 303) / 100, atol=1e-9)


def test_plates_that_lie_elsewhere_when_the_program_is_back_are_refused(source, server):
    corners = np.array([[250, -450, 0], [-250, -450, 0], [-250, 450, 0], [250, 450, 0]])
    moved = (location(corners + np.array([600, 0, 0])), location(corners))
    server.settings = parameters(
        NAMES, plates=("Left", "Right"), channels=CHANNELS, locations=moved
    )
    server.drop_clients()
    with pytest.raises(
        ValueError, match="back with another description of its plates; begin a new session"
    ):
        collect(source, 1, timeout_s=5.0)


def test_time_goes_on_when_another_measurement_begins(source, server):
    for data, *_ in frames(range(200, 203)):
        server.send(data)
    for data, *_ in frames(range(3)):
        server.send(data)
    found = collect(source, 6)
    np.testing.assert_allclose(np.diff(found["Markers"][0]), 0.01, atol=1e-9)
    np.testing.assert_allclose(np.diff(found["Left"][0]), 1e-3, atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (parameters(()), "no labelled markers"),
        ("<QTM_Parameters", "broken parameters"),
    ],
)
def test_parameters_that_lack_something_are_one_line(settings, message):
    server = QtmServer(settings)
    with pytest.raises(ValueError, match=message):
        QualisysSource("127.0.0.1", port=server.port, stated=AXES, timeout_s=2.0)
    server.close()


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
    source = QualisysSource("127.0.0.1", port=server.port, stated=AXES, timeout_s=2.0)
    server.await_stream()
    placed = place_plates(source.plates, None, Live())
    analog = AnalogStreams(source.streams[1:])
    channels = [placed.live.channels_of(plate.number) for plate in placed.plates]
    still = Laboratory(Treadmill())
    ground = LiveGround(still, Settings(), placed.plates, channels, analog, NAMES, 100.0)
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


def test_axes_have_to_be_stated_and_somebody_has_to_answer(server):
    with pytest.raises(ValueError, match="axes of its markers are unknown"):
        QualisysSource("127.0.0.1", port=server.port, stated=Stated(), timeout_s=2.0)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(ConnectionError, match=f"no Qualisys Track Manager answers at .*:{port}"):
        QualisysSource("127.0.0.1", port=port, stated=AXES, timeout_s=1.0)
