"""The instrumented treadmill records what acts on it, with reproducible errors."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_trial import record


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


def test_a_replayed_platform_is_off_by_one_whole_number_of_frames_in_each_recording(perfect):
    """Its channels alone: markers and plates are of the recording that is replayed."""
    trial, _ = perfect("pitch")
    replayed = Faults.none().platform.model_copy(update={"replay_frames": 2})
    treadmill = make_treadmill(Faults.none().model_copy(update={"platform": replayed}), 1)
    true, found = trial.recording.analog.channel("Platform.Pitch"), set()
    for seed in range(8):
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
    assert found <= {-2, -1, 0, 1, 2}
    assert len(found) > 2


@pytest.mark.parametrize(
    ("table", "changes"),
    [
        ("plates", {"noise_scale": 0.0, "gain_scale": 0.0}),
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
