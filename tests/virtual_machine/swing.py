"""What a plate measures beside a walking person in the middle of swing, by a real treadmill's.

``python -m tests.virtual_machine.swing FILE`` prints the table of validation/validity.md; FILE is
the recording of a split-belt treadmill that stands still (``treadmill_hbm2/treadmill_events.c3d``).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from hbm.signals.filtering import low_pass
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.io.c3d.read import read_c3d
from pipeline.io.recording import Plate
from pipeline.virtual_lab.faults import BeltFaults, Faults, MachineFaults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import record, run_walk, study_subject

MACHINES: Final = {
    "default": Faults(),
    "default, belts without roughness": Faults(belts=BeltFaults(roughness=0.0)),
    "rigid": Faults(machine=MachineFaults(flexibility=0.0)),
    "four times as flexible": Faults(machine=MachineFaults(flexibility=4.0)),
}
"""Rows of the table."""
CUTOFF_HZ: Final = 10.0
LOADED_N: Final = 60.0
MIDDLE_S: Final = (0.12, 0.26)
SWING_S: Final = 0.45
"""After a plate is left: the middle of swing, and its whole."""
SETTLED_S: Final = 0.005
UNLOADED_S: Final = 0.38
"""When a plate is empty after it is left, until when it has to be."""


def middle_of_swing(plates: Sequence[Plate]) -> Array:
    """Give the standard deviation of the wrench within the middle of swing, (6,) [N, N·m]."""
    squares = []
    for plate in plates:
        rate_hz = (len(plate.time) - 1) / (plate.time[-1] - plate.time[0])
        at = (round(rate_hz * s) for s in (*MIDDLE_S, SWING_S, SETTLED_S, UNLOADED_S))
        start, stop, swing, settled, unloaded = at
        wrench = low_pass(plate.wrench_in_plate, rate_hz, CUTOFF_HZ, "zero_phase")
        loaded = np.abs(wrench[:, 2]) > LOADED_N
        for i in np.flatnonzero(loaded[:-1] & ~loaded[1:]):
            if i + swing < len(wrench) and not loaded[i + settled : i + unloaded].any():
                squares.append(wrench[i + start : i + stop].var(axis=0))
    if len(squares) <= 10:
        raise ValueError(f"{len(squares)} swings are too few")
    return np.sqrt(np.mean(squares, axis=0))


def by_real(faults: Faults, real: Path) -> Array:
    """Give what the laboratory's plates measure by what those of the recording do, (6,)."""
    setting = Setting(protocol=Protocol(baseline_s=12.0), faults=faults)
    treadmill = make_treadmill(setting.faults, setting.seed)
    walk, motion = run_walk(setting, treadmill.machine, study_subject(setting, 0), 0, "baseline")
    ours = record(treadmill, motion, walk, "x.c3d", np.random.default_rng(0))
    return middle_of_swing(ours.plates) / middle_of_swing(read_c3d(real).plates)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.virtual_machine.swing", description=__doc__
    )
    parser.add_argument("file", type=Path, help="recording of a treadmill that stands still")
    path = parser.parse_args().file
    print("|", *WRENCH_COMPONENTS, "", sep=" | ")
    for name, faults in MACHINES.items():
        print("", name, *(f"{share:.2g}" for share in by_real(faults, path)), "", sep=" | ")


if __name__ == "__main__":
    main()
