"""Laboratories calibrated in several ways, and what both models leave of validation trials."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from compensation import MachineLimits, Signal, low_pass, validation_signals
from compensation.inertia.fit import LAGS_S
from compensation.protocol import platform_signal
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import find_accelerometers
from pipeline.trial.ground.calibration_recording import fit_calibration, plate_samples
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from pipeline.virtual_lab.person import bystander
from pipeline.virtual_lab.protocol.calibration_trial import record_signal_trial, sample_times
from pipeline.virtual_lab.protocol.ranking_study import BESIDE_THE_BELTS, BYSTANDERS
from tests.campaign.inertia_models.places import best_places


@dataclass(frozen=True)
class Calibrated:
    """How a laboratory is calibrated: by the signal all_60s, at a belt speed, and what people do.

    Recordings ``beside`` the empty plate are of a minute of belts at walking speed with the
    platform at rest. It is judged with ``counts`` accelerometers.
    """

    belts_mps: float
    beside: tuple[bystander.LoadPattern, ...] = ()
    counts: tuple[int, ...] = (1, 2, 3, 4)


RATE_HZ: Final = 200.0
EDGE: Final = 200
"""Samples left out at both ends of a recording, where low-passes are inaccurate: a second."""
SENSORS: Final = (1, 2, 3, 4)
CALIBRATIONS: Final[dict[str, Calibrated]] = {
    "empty": Calibrated(3.0),
    "empty, belts at rest": Calibrated(0.0, counts=(2, 4)),
    "empty, beside walking and boards": Calibrated(
        3.0, beside=(bystander.walking, bystander.stepping_on_boards)
    ),
}
MACHINES: Final = {"default": 1.0, "soft": 4.0, "rigid": 0.0}
"""Flexibility of the structure; all natural frequencies of the soft one are half of the default."""
AT_REST_S: Final = 60
AT_REST_BELTS_MPS: Final = 1.3
MODELS: Final = ("static", "dynamic")
BEST: Final = ("empty, beside walking and boards", 4)
CORNERS_M: Final = [(x, y, z) for x in (-0.9, 0, 0.9) for y in (-0.6, 0.6) for z in (-0.35, -0.05)]
D_OPTIMAL: Final = {
    f"{n}, D-optimal": [CORNERS_M[k] for k in best_places(CORNERS_M, n)] for n in (2, 3, 4)
}
ARRANGEMENTS: Final[dict[str, list[tuple[float, float, float]]]] = {
    **D_OPTIMAL,
    **{
        f"{name}, mirrored": [(x, -y, z) for x, y, z in places]
        for name, places in D_OPTIMAL.items()
    },
    "2, both at the rear": [(-0.9, 0.6, -0.2), (-0.9, -0.6, -0.2)],
    "2, on the plate's own side": [(-0.9, 0.6, -0.2), (0.9, 0.6, -0.2)],
    "3, in one line": [(-0.9, 0.6, -0.2), (0.0, 0.0, -0.2), (0.9, -0.6, -0.2)],
    "4, in one plane": [(x, y, -0.2) for x in (-0.9, 0.9) for y in (-0.6, 0.6)],
}
STREAM: Final = 17
"""Number of the random numbers of this campaign."""


@dataclass(frozen=True)
class Judged:
    """What both models leave of one trial: RMS about the mean, below 20 and 6 Hz, (2, 6)."""

    seed: int
    machine: str
    calibration: str
    sensors: int
    chosen: str
    trial: str
    static: np.ndarray
    dynamic: np.ndarray

    @property
    def taken(self) -> np.ndarray:
        """Of the model that the calibration chooses."""
        return self.static if self.chosen == "static" else self.dynamic


def laboratory(
    seed: int, machine: str, places: Sequence[Sequence[float]] = ()
) -> InstrumentedTreadmill:
    """Give the realistic laboratory with four accelerometers, the first ones at given places."""
    faults = Faults()
    sensors = faults.accelerometers.model_copy(update={"sensors": max(SENSORS)})
    structure = faults.machine.model_copy(update={"flexibility": MACHINES[machine]})
    changed = {"accelerometers": sensors, "machine": structure}
    treadmill = make_treadmill(faults.model_copy(update=changed), seed)
    moved = [
        replace(sensor, place=np.array(place))
        for sensor, place in zip(treadmill.sensors, places, strict=False)
    ]
    return replace(treadmill, sensors=(*moved, *treadmill.sensors[len(moved) :]))


def at_rest(name: str) -> Signal:
    """Give a platform at rest, its belts at walking speed."""
    still = np.zeros(100 * AT_REST_S)
    return Signal(name, 100.0, still, still, still + AT_REST_BELTS_MPS)


def record(
    treadmill: InstrumentedTreadmill,
    signal: Signal,
    person: bystander.LoadPattern | None,
    seed: list[int],
) -> Recording:
    """Record the left plate, empty, while somebody may be on the frame or the other belt."""
    rng, load = np.random.default_rng((*seed, STREAM)), None
    if person is not None:
        load = person(sample_times(signal, RATE_HZ), rng)
    beside = person in BESIDE_THE_BELTS
    return record_signal_trial(
        signal,
        seed=int(rng.integers(2**31)),
        rate_hz=RATE_HZ,
        treadmill=treadmill,
        load=None if beside else load,
        on_frame=load if beside else None,
    )


def rms_left(left: np.ndarray, rate_hz: float) -> np.ndarray:
    """Give the RMS about the mean of all that is left and of its part below 6 Hz, (2, 6)."""
    slow = low_pass(left, rate_hz, 6.0, "zero_phase")
    return np.stack([left.std(axis=0), slow.std(axis=0)])


def judge(
    seed: int,
    machine: str = "default",
    calibrations: Sequence[str] = tuple(CALIBRATIONS),
    counts: Sequence[int] = SENSORS,
    places: Sequence[Sequence[float]] = (),
) -> list[Judged]:
    """Calibrate a laboratory in several ways and judge both models on the validation trials."""
    treadmill, found = laboratory(seed, machine, places), []
    trials = {
        signal.name: record(treadmill, signal, BYSTANDERS[signal.name], [seed, 0, n])
        for n, signal in enumerate(validation_signals(seed))
        if signal.name in BYSTANDERS
    }
    for name in calibrations:
        plan, number = CALIBRATIONS[name], 1 + list(CALIBRATIONS).index(name)
        signal = platform_signal("all", 60, seed, plan.belts_mps, MachineLimits())
        recording = record(treadmill, signal, None, [seed, number, 0])
        beside = [
            record(treadmill, at_rest(person.__name__), person, [seed, number, 1 + m])
            for m, person in enumerate(plan.beside)
        ]
        channels = list(find_accelerometers(recording).items())
        for count in (n for n in counts if n in plan.counts):
            sensors = dict(channels[:count])
            stated = Treadmill(accelerometers=sensors, inertia_model="dynamic")
            calibration = fit_calibration(
                recording, Treadmill(accelerometers=sensors), beside=beside
            )
            better = "dynamic" if calibration.dynamic else "static"
            if better == "static":
                calibration = fit_calibration(recording, stated, beside=beside)
            static, dynamic = calibration.plates["plate 1"], calibration.dynamic["plate 1"]
            for trial, other in trials.items():
                samples = plate_samples(other, stated, calibration.sensors, None, LAGS_S)
                felt, wrench = (x[EDGE:-EDGE] for x in samples["plate 1"])
                errors = (
                    static.compensate(felt[:, : 3 * count], wrench),
                    dynamic.compensate(felt, wrench),
                )
                left = [rms_left(error, RATE_HZ) for error in errors]
                found.append(Judged(seed, machine, name, count, better, trial, *left))
    return found
