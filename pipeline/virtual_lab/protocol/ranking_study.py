"""Experiment 2 in the virtual laboratory: all calibration and validation recordings."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from compensation.protocol import belt_signals, pitch_and_sway_signals, validation_signals
from compensation.signals import Signal
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.machine.instruments import ANALOG_HZ
from pipeline.virtual_lab.person import bystander
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial, sample_times

TRIALS: Final = 58
"""28 calibration trials of the platform, 24 of the belts, and 6 validation trials, one of which is
belt pulses with a person on the other belt."""
PLATFORM_BELT_SPEEDS_MPS: Final = (0.0, 3.0)
BELT_SPEEDS_MPS: Final = (1.0, 2.0)
"""Belt speeds of the calibration trials of the platform, and mean speeds of those of the belts: the
thesis'."""
TRIAL_STREAM: Final = 7
"""Number of the random numbers of people and noise, which are not those of the signals."""

BYSTANDERS: Final[dict[str, bystander.LoadPattern]] = {
    "sway": bystander.walking,
    "pitch": bystander.walking,
    "running": bystander.running,
    "boarding": bystander.stepping_on_boards,
}
"""Validation trial -> what the person on the platform beside the empty plate does."""
BESIDE_THE_BELTS: Final = (bystander.stepping_on_boards,)
"""Who is on the frame and not on the right belt."""


Planned = tuple[str, Signal, bystander.LoadPattern | None]
"""Sub-folder of a recording, what the treadmill is commanded, and the load of a person, if any."""


def planned_trials(seed: int) -> Iterator[Planned]:
    """List the trials of the experiment in the order in which they are recorded."""
    for n, speed in enumerate(PLATFORM_BELT_SPEEDS_MPS):
        for signal in pitch_and_sway_signals(2 * seed + n, speed):
            yield "calibration", signal, None
    for n, speed in enumerate(BELT_SPEEDS_MPS):
        for signal in belt_signals(2 * seed + n, speed):
            yield "belt_calibration", signal, None
    *platform, belt, with_person = validation_signals(seed)
    for signal in platform:
        yield "validation", signal, BYSTANDERS[signal.name]
    yield "belt_validation", belt, None
    yield "belt_person", with_person, bystander.walking


def recordings(seed: int, *, rate_hz: float = ANALOG_HZ) -> Iterator[tuple[str, Recording]]:
    """Record the trials of the experiment; give sub-folder and recording of each.

    ``seed`` is that of signals, people, instruments and noise, ``rate_hz`` the sampling rate of the
    analog channels.
    """
    rng = np.random.default_rng((seed, TRIAL_STREAM))
    treadmill = make_treadmill(Faults(), seed)
    for folder, signal, person in planned_trials(seed):
        load = None if person is None else person(sample_times(signal, rate_hz), rng)
        beside, noise = person in BESIDE_THE_BELTS, int(rng.integers(2**31))
        yield (
            folder,
            record_signal_trial(
                signal,
                seed=noise,
                rate_hz=rate_hz,
                treadmill=treadmill,
                load=None if beside else load,
                on_frame=load if beside else None,
            ),
        )


def simulate_ranking(folder: Path, seed: int, rate_hz: float = ANALOG_HZ) -> Iterator[Path]:
    """Write `recordings` as C3D files into the sub-folders that `hbm calibration rank` reads.

    Yields
    ------
    pathlib.Path
        Each file, once it is written.
    """
    for name, recording in recordings(seed, rate_hz=rate_hz):
        path = folder / name / recording.source
        write_c3d(path, recording.markers, recording.plates, analog=recording.analog)
        yield path
