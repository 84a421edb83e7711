"""Static and dynamic models of a flexible treadmill on motion of other kinds than the calibration.

``python -m tests.campaign.inertia_models --seeds 0 10``, the first and one more than the last; with
``--page`` it writes docs/inertia_models.md. Ends with 1 where the dynamic model, where it is
chosen, leaves clearly more than the static one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from compensation import Signal, fit_dynamic, pitch_and_sway_signals, validation_signals
from compensation.inertia.choice import rms_left
from compensation.inertia.dynamic import LAGS_S
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import find_accelerometers
from pipeline.trial.ground.calibration_recording import fit_calibration
from pipeline.trial.ground.empty_plates import plate_samples
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from pipeline.virtual_lab.person import bystander
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial, sample_times
from pipeline.virtual_lab.protocol.ranking_study import BESIDE_THE_BELTS, BYSTANDERS, LoadPattern

PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "inertia_models.md"
RATE_HZ: Final = 200.0
EDGE: Final = 200
"""Samples left out at both ends of a recording, where low-passes are inaccurate: a second."""
SENSORS: Final = (1, 2, 3, 4)
CALIBRATIONS: Final[dict[str, tuple[str, LoadPattern | None]]] = {
    "empty, 60 s": ("all_60s_3mps", None),
    "empty, 300 s": ("all_300s_3mps", None),
    "empty, belts at rest, 60 s": ("all_60s_0mps", None),
    "person on the boards, 60 s": ("all_60s_3mps", bystander.stepping_on_boards),
    "person walks on the other belt, 60 s": ("all_60s_3mps", bystander.walking),
}
BELTS_MPS: Final = (0.0, 3.0)
GOAL: Final = (2.0, 1.0)
"""Largest component that may be left [N, N·m]."""
MAX_WORSE: Final = 1.1
"""Factor by which a chosen dynamic model may leave more than the static one, norm of any trial."""
NORMS: Final = (slice(3), slice(3, 6))


@dataclass(frozen=True)
class Judged:
    """What both models leave of one trial: RMS about the mean, below 20 and 6 Hz, (2, 6)."""

    seed: int
    calibration: str
    sensors: int
    chosen: str
    trial: str
    raw: np.ndarray
    static: np.ndarray
    dynamic: np.ndarray

    @property
    def in_use(self) -> np.ndarray:
        return self.dynamic if self.chosen == "dynamic" else self.static


def laboratory(seed: int) -> InstrumentedTreadmill:
    """Give the realistic laboratory with four accelerometers."""
    faults = Faults()
    sensors = faults.accelerometers.model_copy(update={"sensors": max(SENSORS)})
    return make_treadmill(faults.model_copy(update={"accelerometers": sensors}), seed)


def record(
    treadmill: InstrumentedTreadmill, signal: Signal, person: LoadPattern | None, seed: int
) -> Recording:
    """Record the left plate, empty, while somebody may be on the frame or the other belt."""
    load = None
    if person is not None:
        load = person(sample_times(signal, RATE_HZ), np.random.default_rng((seed, 1)))
    beside = person in BESIDE_THE_BELTS
    return record_signal_trial(
        signal,
        seed=seed,
        rate_hz=RATE_HZ,
        treadmill=treadmill,
        load=None if beside else load,
        on_frame=load if beside else None,
    )


def judge(seed: int, calibrations: Sequence[str] = tuple(CALIBRATIONS)) -> Iterator[Judged]:
    """Calibrate a laboratory in several ways and judge both models on the validation trials."""
    treadmill = laboratory(seed)
    signals = {
        signal.name: signal
        for n, speed in enumerate(BELTS_MPS)
        for signal in pitch_and_sway_signals(2 * seed + n, speed)
    }
    trials = {
        signal.name: record(treadmill, signal, BYSTANDERS[signal.name], 100 * seed + n)
        for n, signal in enumerate(validation_signals(seed))
        if signal.name in BYSTANDERS
    }
    for n, name in enumerate(calibrations):
        kind, person = CALIBRATIONS[name]
        recording = record(treadmill, signals[kind], person, 100 * seed + 50 + n)
        places = find_accelerometers(recording)
        for count in SENSORS:
            stated = Treadmill(accelerometers=dict(list(places.items())[:count]))
            calibration = fit_calibration(recording, stated)
            assert calibration.choice is not None
            (static,) = calibration.plates.values()
            sensors = calibration.sensors
            (own,) = plate_samples(recording, stated, sensors, None, LAGS_S).values()
            assert static.setup is not None
            dynamic = fit_dynamic([own], static.setup)
            for trial, other in trials.items():
                (samples,) = plate_samples(other, stated, sensors, None, LAGS_S).values()
                felt, wrench = (x[EDGE:-EDGE] for x in samples)
                left = (
                    wrench,
                    static.compensate(felt[:, : 3 * count], wrench),
                    dynamic.compensate(felt, wrench),
                )
                sizes = [rms_left(error, RATE_HZ) for error in left]
                yield Judged(seed, name, count, calibration.choice.model, trial, *sizes)


def norms(left: Sequence[np.ndarray], band: int) -> tuple[float, float]:
    """Give the norm of force and of moment, root mean square over seeds [N, N·m]."""
    mean = np.mean([one[band] ** 2 for one in left], axis=0)
    return tuple(float(np.sqrt(mean[part].sum())) for part in NORMS)
