"""People beside an empty plate add to what a calibration knows and take nothing from it.

The treadmill bends and yields in six modes, of which two accelerometers cannot show all; nothing of
it is of the package. Nobody is on the left plate, so that all that compensation leaves is error.
"""

from functools import cache, partial

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from pipeline.config.schema import Treadmill
from pipeline.trial.ground.calibrations import fit_calibration, plate_samples
from tests.flexible_treadmill import (
    BOARDS,
    RATE_HZ,
    RUNNING,
    SENSORS,
    WALKING,
    FlexibleTreadmill,
    as_recording,
)

SEED = 0
BESIDE = (WALKING, RUNNING, BOARDS)
SLOW = butter(2, 6.0, fs=RATE_HZ, output="sos")
INSIDE = slice(RATE_HZ, -RATE_HZ)


@cache
def recorded():
    """Of a treadmill: the signal, people beside, and trials that are not fitted."""
    machine = FlexibleTreadmill(SEED)
    record = partial(machine.record, seconds=20.0)
    signal = record(1, sway=0.7, pitch=2.2, highest_hz=5.0)
    beside = [record(2 + n, person=person) for n, person in enumerate(BESIDE)]
    commanded = [record(5, sway=0.5), record(6, sway=0.5, person=WALKING)]
    shaken = [record(7 + n, person=person) for n, person in enumerate(BESIDE)]
    return signal, beside, commanded, shaken


def treadmill(sensors):
    return Treadmill(accelerometers=dict(list(SENSORS.items())[:sensors]))


@cache
def calibrated(sensors, people):
    signal, beside, *_ = recorded()
    recordings = [as_recording(f"{n}.c3d", one) for n, one in enumerate(beside)] if people else ()
    return fit_calibration(as_recording("signal.c3d", signal), treadmill(sensors), None, recordings)


def left_and_sd(calibration, found, sensors):
    """Give what is left of the empty left plate below 6 Hz, and its standard deviation, (N, 6)."""
    model, one = calibration.in_use["plate 1"], as_recording("trial.c3d", found)
    felt, wrench = plate_samples(one, treadmill(sensors), calibration.sensors, None, model.lags_s)[
        "plate 1"
    ]
    left = sosfiltfilt(SLOW, model.compensate(felt, wrench), axis=0)[INSIDE]
    sd = model.uncertainty(felt, slow=True, zero=False)[INSIDE]
    return left - left.mean(axis=0), sd


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


@pytest.mark.parametrize("sensors", [2, 4])
def test_people_beside_an_empty_plate_leave_commanded_motion_no_worse(sensors):
    alone, beside = (calibrated(sensors, people) for people in (False, True))
    for trial in recorded()[2]:
        with_people, without = (rms(left_and_sd(one, trial, sensors)[0]) for one in (beside, alone))
        assert np.all(with_people < 1.2 * without)


@pytest.mark.parametrize("sensors", [2, 4])
def test_the_standard_deviation_covers_commanded_motion_and_people(sensors):
    _, _, commanded, shaken = recorded()
    calibration = calibrated(sensors, people=True)
    found = [left_and_sd(calibration, trial, sensors) for trial in (*commanded, *shaken)]
    left, sd = (np.concatenate(each) for each in zip(*found, strict=True))
    assert np.all(rms(sd) > 0.85 * rms(left))
    assert np.mean(np.abs(left) < 1.96 * sd) > 0.9


@pytest.mark.campaign
def test_the_standard_deviation_of_a_calibration_without_people_is_one():
    """Of three treadmills and six trials each, people in four: 68 and 95 % of a normal error."""
    held = []
    for seed in range(3):
        machine = FlexibleTreadmill(seed)
        signal = machine.record(100 + seed, sway=0.7, pitch=2.2, highest_hz=5.0)
        calibration = fit_calibration(as_recording("signal.c3d", signal), treadmill(4))
        trials = [
            machine.record(300 + seed, sway=0.5),
            machine.record(400 + seed, sway=0.5, person=WALKING),
            machine.record(600 + seed, pitch=1.0),
            *(machine.record(500 + 10 * seed + n, person=one) for n, one in enumerate(BESIDE)),
        ]
        for trial in trials:
            left, sd = left_and_sd(calibration, trial, 4)
            held.append([np.mean(np.abs(left) < factor * sd) for factor in (1, 2)])
    within_one, within_two = np.mean(held, axis=0)
    assert 0.63 < within_one < 0.75
    assert 0.92 < within_two < 0.97
