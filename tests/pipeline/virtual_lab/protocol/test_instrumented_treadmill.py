"""The instrumented treadmill: reproducible errors, and what it records."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import PLATFORM_MARKERS_M, make_treadmill
from pipeline.virtual_lab.machine.instruments import SENSOR_NAMES
from pipeline.virtual_lab.protocol.walking_trial import record


def test_equal_seeds_give_equal_instruments():
    first, again = make_treadmill(Faults(), 3), make_treadmill(Faults(), 3)
    np.testing.assert_array_equal(first.plates[0].gain, again.plates[0].gain)
    other = make_treadmill(Faults(), 4)
    assert not np.array_equal(first.plates[0].gain, other.plates[0].gain)
    assert len(PLATFORM_MARKERS_M) == 5


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_there_are_as_many_accelerometers_as_stated(count):
    accelerometers = Faults().accelerometers.model_copy(update={"sensors": count})
    treadmill = make_treadmill(Faults().model_copy(update={"accelerometers": accelerometers}), 1)
    assert [sensor.name for sensor in treadmill.sensors] == list(SENSOR_NAMES[:count])


def test_belt_speed_is_recorded_in_steps_of_200_hz(perfect):
    trial, _ = perfect("baseline")
    recorded = trial.recording.analog.channel("Belt.Left")
    starting = slice(5000, 7000)
    steps = recorded[starting].reshape(-1, 5)
    assert np.abs(steps - steps[:, :1]).max() < 10 * 0.005  # noise alone
    true = trial.response.belts[0].speed[starting].reshape(-1, 5)[:, 0]
    assert np.std(steps.mean(axis=1) - true) < 0.005


@pytest.mark.parametrize("instruments", ["plates", "accelerometers", "platform"])
def test_late_instruments_record_what_was_there_before(perfect, instruments):
    """Plates, accelerometers and the platform's channels, each by its own delay."""
    channels = {
        "plates": lambda r: r.plates[1].wrench_in_plate,
        "accelerometers": lambda r: r.analog.values[:, :6],
        "platform": lambda r: r.analog.values[:, 8:10],
    }[instruments]
    trial, _ = perfect("pitch")
    delayed = getattr(Faults.none(), instruments).model_copy(update={"delay_s": 0.03})
    treadmill = make_treadmill(Faults.none().model_copy(update={instruments: delayed}), 1)
    recorded = record(treadmill, trial.motion, trial.walk, "x.c3d", np.random.default_rng(0))
    expected = channels(trial.recording)[10_000:20_000]
    np.testing.assert_allclose(channels(recorded)[10_030:20_030], expected, atol=1e-6)


def test_each_plate_is_late_by_its_own_delay(perfect):
    trial, _ = perfect("sway")
    late = Faults.none().plates.model_copy(update={"delay_s": 0.004, "right_later_s": -0.002})
    treadmill = make_treadmill(Faults.none().model_copy(update={"plates": late}), 1)
    recorded = record(treadmill, trial.motion, trial.walk, "x.c3d", np.random.default_rng(0))
    for now, before, samples in zip(recorded.plates, trial.recording.plates, (4, 2), strict=True):
        expected = before.wrench_in_plate[10_000:20_000]
        found = now.wrench_in_plate[10_000 + samples : 20_000 + samples]
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_replayed_platform_is_off_by_one_whole_number_of_frames_in_each_recording(perfect):
    """Its channels alone: markers and plates are of the recording that is replayed."""
    trial, _ = perfect("pitch")
    replayed = Faults.none().platform.model_copy(update={"replay_frames": 2})
    treadmill = make_treadmill(Faults.none().model_copy(update={"platform": replayed}), 1)
    true, found = trial.recording.analog.channel("Platform.Pitch"), set()
    for seed in range(24):
        rng = np.random.default_rng(seed)
        recorded = record(treadmill, trial.motion, None, "x.c3d", rng)
        channel = recorded.analog.channel("Platform.Pitch")[10_000:20_000]
        errors = {
            frames: np.abs(channel - true[10_000 - 10 * frames : 20_000 - 10 * frames]).max()
            for frames in range(-3, 4)
        }
        frames = min(errors, key=errors.get)
        assert errors[frames] < 1e-9
        found.add(frames)
        np.testing.assert_array_equal(
            recorded.markers.position[:, 0], trial.recording.markers.position[:, -5]
        )
    assert found == {-2, -1, 0, 1, 2}


@pytest.mark.parametrize(
    ("table", "changes"),
    [
        ("plates", {"noise_scale": 0.0, "gain_scale": 0.0}),
        ("accelerometers", {"noise_scale": 0.0, "error_scale": 0.0}),
        ("cameras", {"noise_m": 0.0, "gaps_per_minute": 0.0}),
    ],
)
def test_a_fault_that_is_switched_off_changes_its_own_device_alone(perfect, table, changes):
    """Every device has its own random numbers."""
    trial, _ = perfect("baseline")

    def recorded(faults):
        treadmill = make_treadmill(faults, 1)
        result = record(treadmill, trial.motion, None, "x.c3d", np.random.default_rng(0))
        values = result.analog.values
        return {
            "plates": np.hstack([plate.wrench_in_plate for plate in result.plates]),
            "accelerometers": values[:, :6],
            "belts": values[:, 6:8],
            "cameras": result.markers.position.reshape(len(result.markers.time), -1),
        }

    without = getattr(Faults(), table).model_copy(update=changes)
    default, changed = (
        recorded(faults) for faults in (Faults(), Faults().model_copy(update={table: without}))
    )
    for device, values in default.items():
        assert np.array_equal(values, changed[device], equal_nan=True) is (device != table)


def test_equal_seeds_give_equal_recordings(perfect):
    trial, _ = perfect("baseline")
    treadmill = make_treadmill(Faults(), 1)
    one, other = (
        record(treadmill, trial.motion, None, "x.c3d", np.random.default_rng(3)) for _ in range(2)
    )
    assert one.analog.values.tobytes() == other.analog.values.tobytes()
    for a, b in zip(one.plates, other.plates, strict=True):
        assert a.wrench_in_plate.tobytes() == b.wrench_in_plate.tobytes()
