"""The empty, moving treadmill: samples of its plates and of what the accelerometers felt."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from compensation import Sensor, Setup
from compensation.inertia.choice import EmptyPlate
from hbm.signals.filtering import Method
from hbm.signals.resampling import resample
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import accelerations, at_plate_times
from pipeline.trial.ground.corrected_plates import relative_delays_s

FILTER: Final[Method] = "zero_phase"
"""A delay of what is subtracted would leave an artefact wherever platform or belt accelerate."""


def empty_plates(
    recording: Recording,
    treadmill: Treadmill,
    sensors: Sequence[Sensor],
    correction: PlateCorrection | None,
    lags_s: Sequence[float] = (),
) -> list[EmptyPlate]:
    """Give the samples of every plate of a recording, whose plates are corrected already.

    Parameters
    ----------
    recording
        The empty treadmill, moving.
    treadmill
        Names of its accelerometers' channels and the cut-off.
    sensors
        Of which delays and gains are undone.
    correction
        Of the plates, which may state their delays.
    lags_s
        Of the differences that a dynamic model needs [s].

    Returns
    -------
    list of EmptyPlate
        In the order of the plates.

    Raises
    ------
    ValueError
        A channel is missing, or its unit is unknown.
    """
    clock, readings = accelerations(recording, treadmill)
    setup = setup_of(recording, treadmill)
    filtered = setup.low_pass(readings, clock)
    wrenches = wrenches_in_time(recording, setup, correction)
    return [
        EmptyPlate(
            f"plate {plate.number}",
            at_plate_times(clock, filtered, plate.time, treadmill, sensors, lags_s),
            wrench,
        )
        for plate, wrench in zip(recording.plates, wrenches, strict=True)
    ]


def setup_of(recording: Recording, treadmill: Treadmill) -> Setup:
    """Give how a recording's plates and accelerometers were recorded and are to be filtered."""
    rate = float(1 / np.median(np.diff(recording.plates[0].time)))
    return Setup(
        tuple(treadmill.accelerometers), round(rate, 6), treadmill.cutoff_hz, filter_method=FILTER
    )


def wrenches_in_time(
    recording: Recording, setup: Setup, correction: PlateCorrection | None
) -> list[Array]:
    """Give the low-passed plates (N, 6), each read ahead by how much later it is than the first."""
    late = relative_delays_s(recording.plates, correction)
    wrenches = [setup.low_pass(plate.wrench_in_plate, plate.time) for plate in recording.plates]
    return [
        wrench if late_s == 0 else resample(plate.time, wrench, plate.time + late_s)
        for plate, wrench, late_s in zip(recording.plates, wrenches, late, strict=True)
    ]
