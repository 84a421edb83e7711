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

from compensation import Signal, pitch_and_sway_signals, validation_signals
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


@dataclass(frozen=True)
class Calibrated:
    """How a laboratory is calibrated: what the platform follows, and where a person is.

    A person ``during`` the signal is on the platform beside the empty plate. Recordings ``beside``
    the empty plate are of a minute of belts at walking speed with the platform at rest.
    """

    signal: str
    during: LoadPattern | None = None
    beside: tuple[LoadPattern, ...] = ()


PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "inertia_models.md"
RATE_HZ: Final = 200.0
EDGE: Final = 200
"""Samples left out at both ends of a recording, where low-passes are inaccurate: a second."""
SENSORS: Final = (1, 2, 3, 4)
CALIBRATIONS: Final[dict[str, Calibrated]] = {
    "empty, 60 s": Calibrated("all_60s_3mps"),
    "empty, 300 s": Calibrated("all_300s_3mps"),
    "empty, belts at rest, 60 s": Calibrated("all_60s_0mps"),
    "person on the boards, 60 s": Calibrated("all_60s_3mps", bystander.stepping_on_boards),
    "empty and beside walking": Calibrated("all_60s_3mps", beside=(bystander.walking,)),
    "empty and beside both": Calibrated(
        "all_60s_3mps", beside=(bystander.walking, bystander.stepping_on_boards)
    ),
}
BELTS_MPS: Final = (0.0, 3.0)
AT_REST_S: Final = 60
AT_REST_BELTS_MPS: Final = 1.3
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


def at_rest(name: str) -> Signal:
    """Give a platform at rest, its belts at walking speed."""
    still = np.zeros(100 * AT_REST_S)
    return Signal(name, 100.0, still, still, still + AT_REST_BELTS_MPS)


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
        plan = CALIBRATIONS[name]
        recording = record(treadmill, signals[plan.signal], plan.during, 100 * seed + 50 + n)
        beside = [
            record(treadmill, at_rest(person.__name__), person, 100 * seed + 60 + 10 * n + m)
            for m, person in enumerate(plan.beside)
        ]
        places = find_accelerometers(recording)
        for count in SENSORS:
            stated = Treadmill(
                accelerometers=dict(list(places.items())[:count]), inertia_model="dynamic"
            )
            calibration = fit_calibration(recording, stated, beside=beside)
            assert calibration.choice is not None
            static, dynamic = calibration.plates["plate 1"], calibration.dynamic["plate 1"]
            for trial, other in trials.items():
                samples = plate_samples(other, stated, calibration.sensors, None, LAGS_S)
                felt, wrench = (x[EDGE:-EDGE] for x in samples["plate 1"])
                left = (
                    wrench,
                    static.compensate(felt[:, : 3 * count], wrench),
                    dynamic.compensate(felt, wrench),
                )
                sizes = [rms_left(error, RATE_HZ) for error in left]
                yield Judged(seed, name, count, calibration.choice.better, trial, *sizes)


def norms(left: Sequence[np.ndarray], band: int) -> tuple[float, float]:
    """Give the norm of force and of moment, root mean square over seeds [N, N·m]."""
    mean = np.mean([one[band] ** 2 for one in left], axis=0)
    return tuple(float(np.sqrt(mean[part].sum())) for part in NORMS)
