"""A trial that the laboratory wrote comes back as it was, in our reader and in ezc3d."""

import numpy as np
import pytest

from hbm.markers import Markers
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Analog, Event, Metadata
from pipeline.virtual_lab.machine.c3d_file import write_c3d

ezc3d = pytest.importorskip("ezc3d", reason="ezc3d has no wheel for this system")

AXES = ["left,back,up", "forward,up,right"]
FLOAT32 = 2.0**-23


@pytest.fixture
def analog(plates):
    rng = np.random.default_rng(5)
    time = plates[0].time
    return Analog(time, ("Acc.1X", "Belt"), ("g", "m/s"), rng.normal(size=(len(time), 2)))


def assert_same_to_float32(found, expected, unit=1.0):
    """Numbers on disk have 24 bits; a wrench needs a few operations more."""
    largest = max(np.nanmax(np.abs(expected)), unit)
    np.testing.assert_allclose(found, expected, rtol=0, atol=4 * FLOAT32 * largest)


@pytest.mark.parametrize("axes", AXES)
def test_a_trial_comes_back_from_disk_as_it_was(tmp_path, subject, plates, analog, axes):
    position = subject.position.copy()
    position[3, 1] = np.nan
    markers = Markers(subject.time, subject.names, position)
    events = (Event(0.1, "foot_strike", "left"), Event(0.3, "foot_off", "right"))
    metadata = Metadata(
        mass_kg=74.6,
        height_m=1.78,
    )
    path = tmp_path / "trial.c3d"
    write_c3d(
        path,
        markers,
        plates,
        analog=analog,
        events=events,
        axes=axes,
        first_frame=12,
        metadata=metadata,
    )
    found = read_c3d(path)
    assert found.markers.names == markers.names
    assert found.first_frame == 12
    np.testing.assert_allclose(found.markers.time, markers.time, atol=1e-12)
    np.testing.assert_array_equal(np.isnan(found.markers.position), np.isnan(position))
    seen = ~np.isnan(position)
    assert_same_to_float32(found.markers.position[seen], position[seen])
    assert len(found.plates) == 2
    for plate, expected in zip(found.plates, plates, strict=True):
        assert_same_to_float32(plate.wrench, expected.wrench)
        assert_same_to_float32(plate.wrench_in_plate, expected.wrench_in_plate)
        np.testing.assert_allclose(plate.rotation, expected.rotation, atol=1e-9)
        np.testing.assert_allclose(plate.center, expected.center, atol=1e-9)
        np.testing.assert_allclose(plate.corners, expected.corners, atol=1e-7)
        np.testing.assert_allclose(plate.time, expected.time, atol=1e-12)
    assert found.analog.names == analog.names
    assert found.analog.units == analog.units
    assert_same_to_float32(found.analog.values, analog.values)
    assert [(e.label, e.side) for e in found.events] == [(e.label, e.side) for e in events]
    np.testing.assert_allclose([e.time for e in found.events], [0.1, 0.3], atol=1e-6)
    for name in metadata.__dataclass_fields__:
        assert getattr(found.metadata, name) == pytest.approx(getattr(metadata, name))


def test_ezc3d_reads_the_same_from_the_written_file(tmp_path, subject, plates, analog):
    path = tmp_path / "trial.c3d"
    write_c3d(path, subject, plates, analog=analog, axes="left,back,up", first_frame=12)
    theirs = ezc3d.c3d(str(path), extract_forceplat_data=True)
    lab = subject.position @ np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        theirs["data"]["points"][:3].transpose(2, 1, 0), lab * 1e3, rtol=1e-6, atol=1e-4
    )
    ours = read_c3d(path, "forward,left,up").plates
    for plate, oracle in zip(ours, theirs["data"]["platform"], strict=True):
        force = plate.wrench_in_plate[:, :3] @ plate.rotation.T
        np.testing.assert_allclose(force, oracle["force"].T, rtol=1e-9)
        np.testing.assert_allclose(oracle["force"][2].mean(), 350, atol=1)
    np.testing.assert_allclose(theirs["data"]["analogs"][0, -2:].T, analog.values, rtol=1e-6)


def test_twelve_minutes_are_written_and_read_whole(tmp_path):
    n_frames, n_markers = 72_000, 3
    time = np.arange(n_frames) / 100
    position = np.random.default_rng(3).normal(1, 0.5, size=(n_frames, n_markers, 3))
    markers = Markers(time, tuple(f"M{k}" for k in range(n_markers)), position)
    belt = Analog(time, ("Belt",), ("m/s",), time[:, None])
    path = tmp_path / "long.c3d"
    strikes = [Event(t, "foot_strike", "left") for t in np.arange(1, 720, 1.1)]
    write_c3d(path, markers, analog=belt, events=strikes)
    found = read_c3d(path, "left,back,up")
    assert found.markers.position.shape == position.shape
    assert_same_to_float32(found.markers.position, position)
    assert_same_to_float32(found.analog.channel("Belt"), time)
    np.testing.assert_allclose([e.time for e in found.events], [e.time for e in strikes], atol=1e-4)


def test_more_than_255_labels_and_channels_are_written_and_read(tmp_path):
    rng = np.random.default_rng(2)
    time = np.arange(5) / 100
    names = tuple(f"MARKER_NUMBER_{k}" for k in range(600))
    markers = Markers(time, names, rng.normal(size=(5, 600, 3)))
    channels = tuple(f"Emg.{k}" for k in range(300))
    analog = Analog(time, channels, ("V",) * 300, rng.normal(size=(5, 300)))
    path = tmp_path / "many.c3d"
    write_c3d(path, markers, analog=analog, first_frame=70_000)
    found = read_c3d(path, "left,back,up")
    assert found.first_frame == 70_000
    assert found.markers.names == names
    assert found.analog.names == channels
    assert_same_to_float32(found.markers.position, markers.position)
    assert_same_to_float32(found.analog.values, analog.values)
