"""How often a calibration check calls an unchanged laboratory changed, and misses a change.

``python -m tests.campaign.another_day --seeds FIRST END [--jobs N]``; FIRST is the first seed, END
one more than the last. Every laboratory has a calibration and one recording of another day without
a change and with each of `SPOILT` and `REBUILT`, all by the signal all_60s at 3 m/s with other
random numbers. Ends with 1 where more than 5 % of the unchanged recordings count as changed, or
fewer than 95 % of any change are found.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from multiprocessing import Pool
from typing import Final

import numpy as np
import pandas as pd

from compensation.protocol import platform_signal
from compensation.signals import MachineLimits
from hbm.spatial import Array, rotation_about
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.io.write import markdown
from pipeline.trial.ground.accelerometers import find_accelerometers
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.calibrations import check_recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial

RATE_HZ: Final = 100.0
BELTS_MPS: Final = 3.0
MAX_FALSE: Final = 0.05
MIN_FOUND: Final = 0.95
SECOND: Final = slice(3, 6)
"""Columns of the accelerometer that is changed."""
UNCHANGED: Final = "nothing"
Spoil = Callable[[Recording], Recording]
Rebuild = Callable[[InstrumentedTreadmill], InstrumentedTreadmill]


def sensor_reads(change: Array, recording: Recording) -> Recording:
    """Multiply what the second sensor reads by a matrix."""
    analog = recording.analog
    assert analog is not None
    values = analog.values.copy()
    values[:, SECOND] = values[:, SECOND] @ change.T
    return replace(recording, analog=replace(analog, values=values))


def plate_reads(gain: float, recording: Recording) -> Recording:
    """Multiply what the plate reads."""
    (plate,) = recording.plates
    louder = replace(plate, wrench_in_plate=gain * plate.wrench_in_plate)
    return replace(recording, plates=(louder,))


def sensor_late(seconds: float, treadmill: InstrumentedTreadmill) -> InstrumentedTreadmill:
    """Let the second sensor be later."""
    first, second, *others = treadmill.sensors
    clock = replace(second.clock, delay_s=second.clock.delay_s + seconds)
    return replace(treadmill, sensors=(first, replace(second, clock=clock), *others))


def sensor_shifted(metres: float, treadmill: InstrumentedTreadmill) -> InstrumentedTreadmill:
    """Put the second sensor elsewhere, to the rear."""
    first, second, *others = treadmill.sensors
    place = second.place - [metres, 0, 0]
    return replace(treadmill, sensors=(first, replace(second, place=place), *others))


def turn(degrees: float) -> Array:
    """Give the rotation of a sensor about its vertical axis."""
    return rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(degrees))


SPOILT: Final[dict[str, Spoil]] = {
    **{
        f"gain of a sensor {100 * (gain - 1):+.0f} %": partial(sensor_reads, gain * np.eye(3))
        for gain in (0.98, 1.01, 1.03)
    },
    **{
        f"sensor turned by {degrees:g}°": partial(sensor_reads, turn(degrees))
        for degrees in (1.0, 3.0, 90.0)
    },
    "gain of the plate +3 %": partial(plate_reads, 1.03),
}
REBUILT: Final[dict[str, Rebuild]] = {
    "sensor later by 2 ms": partial(sensor_late, 0.002),
    **{
        f"sensor shifted by {100 * metres:g} cm": partial(sensor_shifted, metres)
        for metres in (0.05, 0.1, 0.2)
    },
}


def laboratory(seed: int) -> dict[str, bool]:
    """Calibrate a laboratory; change -> whether the check is right about it."""
    treadmill = make_treadmill(Faults(), seed)

    def record(number: int, machine: InstrumentedTreadmill) -> Recording:
        signal = platform_signal("all", 60, 1000 * seed + number, BELTS_MPS, MachineLimits())
        return record_signal_trial(
            signal, seed=1000 * seed + number, rate_hz=RATE_HZ, treadmill=machine
        )

    empty = record(0, treadmill)
    stated = Treadmill(accelerometers=find_accelerometers(empty), inertia_model="static")
    known = Laboratory(stated, fit_calibration(empty, stated))
    unchanged = record(1, treadmill)
    others = {UNCHANGED: unchanged}
    others |= {name: spoil(unchanged) for name, spoil in SPOILT.items()}
    others |= {
        name: record(2 + number, rebuild(treadmill))
        for number, (name, rebuild) in enumerate(REBUILT.items())
    }
    return {
        name: check_recording(recording, known).valid == (name == UNCHANGED)
        for name, recording in others.items()
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.another_day", description=__doc__
    )
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 48), metavar=("FIRST", "END"))
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    with Pool(given.jobs) as pool:
        right = pd.DataFrame(pool.map(laboratory, range(*given.seeds), 1))
    share = right.mean().rename("right").rename_axis("changed").reset_index()
    print(markdown(share))
    least = np.where(share.changed == UNCHANGED, 1 - MAX_FALSE, MIN_FOUND)
    return int((share.right < least).any())


if __name__ == "__main__":
    sys.exit(main())
