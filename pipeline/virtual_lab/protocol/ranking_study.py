"""Experiment 2 in the virtual laboratory: all calibration and validation recordings."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from compensation import Signal, belt_signals, pitch_and_sway_signals, validation_signals
from hbm.spatial import Array
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.treadmill import Machine
from pipeline.virtual_lab.person import bystander
from pipeline.virtual_lab.protocol.ranking_trial import Imperfections, record, times

TRIALS: Final = 54
PEOPLE: Final = {
    "sway": bystander.walking,
    "pitch": bystander.walking,
    "running": bystander.running,
    "boarding": bystander.boarding,
}


def recordings(
    seed: int,
    *,
    rate_hz: float = 1000.0,
    machine: Machine | None = None,
    imperfections: Imperfections | None = None,
) -> Iterator[tuple[str, Recording]]:
    """Record the 28 + 20 calibration and 5 validation trials, and belt pulses with a person.

    Parameters
    ----------
    seed
        Of signals, people and noise.
    rate_hz
        Of the analog channels [Hz].
    machine, imperfections
        By default as they come.

    Yields
    ------
    tuple
        Sub-folder of the experiment and recording.
    """
    rng = np.random.default_rng((seed, 7))
    for folder, signal, who in _plan(seed):
        load: Array | None = None
        if who is not None:
            load = PEOPLE[who](times(signal, rate_hz), rng)
        yield (
            folder,
            record(
                signal,
                seed=int(rng.integers(2**31)),
                rate_hz=rate_hz,
                machine=machine,
                imperfections=imperfections,
                load=load,
            ),
        )


def simulate_ranking(folder: Path, seed: int, rate_hz: float = 1000.0) -> Iterator[Path]:
    """Write `recordings` as C3D files into the sub-folders that `hbm calibration rank` reads.

    Yields
    ------
    pathlib.Path
        Each file, once it is written.
    """
    for name, recording in recordings(seed, rate_hz=rate_hz):
        path = folder / name / recording.source
        path.parent.mkdir(parents=True, exist_ok=True)
        write_c3d(path, recording.markers, recording.plates, analog=recording.analog)
        yield path


def _plan(seed: int) -> Iterator[tuple[str, Signal, str | None]]:
    for n, speed in enumerate((0.0, 3.0)):
        for signal in pitch_and_sway_signals(2 * seed + n, speed):
            yield "calibration", signal, None
    for n, speed in enumerate((1.0, 2.0)):
        for signal in belt_signals(2 * seed + n, speed):
            yield "belt_calibration", signal, None
    *platform, belt = validation_signals()
    for signal in platform:
        yield "validation", signal, signal.name
    yield "belt_validation", belt, None
    yield "belt_person", replace(belt, name="belt_with_person"), "sway"
