"""The instrumented treadmill: reproducible errors, and what it records."""

import numpy as np
import pytest

from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instruments.accelerometer import SENSOR_NAMES
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    PLATFORM_MARKERS_M,
    make_treadmill,
    record,
)


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
    true = trial.motion.belt[starting].reshape(-1, 5)[:, 0]
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
