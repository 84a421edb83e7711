"""An unbalanced roller in a recording of empty belts, whose place and force are known."""

from dataclasses import replace

import numpy as np
import pytest

from compensation import belt_signals
from pipeline.config.schema import Belt
from pipeline.trial.ground.belt_calibration import WALKING_MPS, fit_belts, roller_notes
from pipeline.virtual_lab.faults import BeltFaults, Faults, MachineFaults
from pipeline.virtual_lab.machine.belts import (
    ROLLER_AHEAD_M,
    ROLLER_CIRCUMFERENCE_M,
    ROLLER_HEIGHT_M,
)
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial

BELT = Belt(calibration="belts.c3d", speed_channels=("BeltSpeed",))


def notes_of(unbalance, seed=1, seconds=None):
    signal = belt_signals(1, 2.0)[0]
    faults = Faults(
        machine=MachineFaults(flexibility=0.0),
        belts=BeltFaults(drive="linear", unbalance_kg_per_m=unbalance),
    )
    recording = record_signal_trial(signal, seed=seed, faults=faults)
    models = fit_belts(recording, BELT)
    if seconds is not None:
        count = round(1000 * seconds)
        plate, analog = recording.plates[0], recording.analog
        recording = replace(
            recording,
            plates=(
                replace(
                    plate,
                    time=plate.time[:count],
                    wrench_in_plate=plate.wrench_in_plate[:count],
                ),
            ),
            analog=replace(analog, time=analog.time[:count], values=analog.values[:count]),
        )
    return roller_notes(recording, models, BELT)


@pytest.mark.parametrize("unbalance", [0.2, 0.5])
def test_circumference_and_moment_of_an_unbalanced_roller_are_found(unbalance):
    (note,) = notes_of(unbalance)
    assert note.code == "belt_roller"
    assert note.values["circumference_m"] == pytest.approx(ROLLER_CIRCUMFERENCE_M, rel=0.002)
    moment = np.hypot(ROLLER_AHEAD_M, ROLLER_HEIGHT_M) * unbalance * WALKING_MPS**2
    # the belt model leaves some hundredths of a newton-metre at the roller's frequency
    assert note.values["moment_nm"] == pytest.approx(moment, abs=0.05)


def test_balanced_rollers_are_not_noted():
    assert notes_of(0.0) == ()


def test_a_belt_that_ran_too_little_shows_no_roller():
    (note,) = notes_of(0.2, seconds=20.0)
    assert note.code == "belt_roller_unknown"
    assert "too little to find a roller" in note.text
