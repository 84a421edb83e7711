"""Static and dynamic models of a flexible treadmill, judged on motion of other kinds.

``python -m tests.campaign.inertia_models --seeds FIRST END``, of which
validation/inertia_models.md has the numbers. FIRST is the first seed,
END one more than the last. Ends with 1 where the models do not do what is demanded of them.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from multiprocessing import Pool
from typing import Any, Final

import numpy as np
import pandas as pd

from compensation import MachineLimits, Signal, validation_signals
from compensation.inertia.fit import LAGS_S
from compensation.protocol import platform_signal
from hbm.signals.filtering import low_pass
from hbm.spatial import WRENCH_COMPONENTS
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import find_accelerometers
from pipeline.trial.ground.calibrations import fit_calibration, plate_samples
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from pipeline.virtual_lab.protocol.calibration_trial import (
    BESIDE_THE_BELTS,
    BYSTANDERS,
    LoadPattern,
    record_signal_trial,
    sample_times,
    stepping_on_boards,
    walking,
)
from tests.tables import markdown

RATE_HZ: Final = 200.0
EDGE: Final = 200
"""Samples left out at both ends of a recording, where low-passes are inaccurate: a second."""
SENSORS: Final = (1, 2, 3, 4)
CALIBRATIONS: Final[dict[str, tuple[float, tuple[LoadPattern, ...]]]] = {
    "empty": (3.0, ()),
    "empty, belts at rest": (0.0, ()),
    "empty, beside walking and boards": (
        3.0,
        (walking, stepping_on_boards),
    ),
}
"""Belt speed of the signal all_60s, and what people do beside the empty plate in a minute each, the
belts at walking speed and the platform at rest."""
MACHINES: Final = {"default": 1.0, "soft": 4.0, "rigid": 0.0}
"""Flexibility of the structure; all natural frequencies of the soft one are half of the default."""
AT_REST_S: Final = 60
AT_REST_BELTS_MPS: Final = 1.3
BEST: Final = ("empty, beside walking and boards", 4)
D_OPTIMAL: Final = [(-0.9, -0.6, -0.35), (-0.9, 0.6, -0.05), (0.9, -0.6, -0.05), (0.9, 0.6, -0.35)]
"""Of the corners of the platform at two heights, by Bayesian D-optimality for the motion of a rigid
body; the two best are the first and the last."""
PLACES: Final[dict[str, list[tuple[float, float, float]]]] = {
    "2, D-optimal": [D_OPTIMAL[0], D_OPTIMAL[3]],
    "3, D-optimal": D_OPTIMAL[:3],
    "4, D-optimal": D_OPTIMAL,
    "2, both at the rear": [(-0.9, 0.6, -0.2), (-0.9, -0.6, -0.2)],
    "2, on the plate's own side": [(-0.9, 0.6, -0.2), (0.9, 0.6, -0.2)],
    "3, in one line": [(-0.9, 0.6, -0.2), (0.0, 0.0, -0.2), (0.9, -0.6, -0.2)],
    "4, in one plane": [(x, y, -0.2) for x in (-0.9, 0.9) for y in (-0.6, 0.6)],
}
ARRANGEMENTS: Final = PLACES | {
    f"{name}, mirrored": [(x, -y, z) for x, y, z in places]
    for name, places in PLACES.items()
    if "D-optimal" in name
}
STREAM: Final = 17
"""Number of the random numbers of this campaign."""
GOAL: Final = np.repeat([2.0, 1.0], 3)
"""What may be left of each component beyond what is left on a rigid machine [N, N·m]."""
MAX_WORSE: Final = 1.1
"""Factor by which a dynamic model that is taken may leave more than the static one of any trial."""
COMPONENTS: Final = list(WRENCH_COMPONENTS)
SETUP: Final = ["machine", "calibration", "sensors", "places"]


def laboratory(seed: int, machine: str, places: Sequence[Sequence[float]]) -> InstrumentedTreadmill:
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


def record(
    treadmill: InstrumentedTreadmill,
    signal: Signal,
    person: LoadPattern | None,
    seed: list[int],
) -> Recording:
    """Record the left plate, empty, while somebody may be on the frame or the other belt."""
    rng, load = np.random.default_rng((*seed, STREAM)), None
    if person is not None:
        load = person(sample_times(signal, RATE_HZ), rng)
    noise = int(rng.integers(2**31))
    return record_signal_trial(
        signal,
        seed=noise,
        rate_hz=RATE_HZ,
        treadmill=treadmill,
        load=load,
        on_frame=person in BESIDE_THE_BELTS,
    )


def judge(
    seed: int,
    machine: str = "default",
    calibrations: Sequence[str] = tuple(CALIBRATIONS),
    counts: Sequence[int] = SENSORS,
    places: str = "as usual",
) -> list[dict[str, Any]]:
    """Calibrate a laboratory in several ways and judge both models on the validation trials.

    Gives a row per trial, model and low-pass: RMS about the mean of every component.
    """
    treadmill, found = laboratory(seed, machine, ARRANGEMENTS.get(places, ())), []
    trials = {
        signal.name: record(treadmill, signal, BYSTANDERS[signal.name], [seed, 0, n])
        for n, signal in enumerate(validation_signals(seed))
        if signal.name in BYSTANDERS
    }
    still = np.zeros(100 * AT_REST_S)
    for name in calibrations:
        (belts_mps, people), number = CALIBRATIONS[name], 1 + list(CALIBRATIONS).index(name)
        signal = platform_signal("all", 60, seed, belts_mps, MachineLimits())
        recording = record(treadmill, signal, None, [seed, number, 0])
        beside = []
        for m, person in enumerate(people, start=1):
            level = Signal(person.__name__, 100.0, still, still, still + AT_REST_BELTS_MPS)
            beside.append(record(treadmill, level, person, [seed, number, m]))
        channels = list(find_accelerometers(recording).items())
        for count in counts:
            sensors = dict(channels[:count])
            stated = Treadmill(accelerometers=sensors, inertia_model="dynamic")
            taken = fit_calibration(recording, Treadmill(accelerometers=sensors), beside=beside)
            chosen = "dynamic" if taken.dynamic else "static"
            both = taken if taken.dynamic else fit_calibration(recording, stated, beside=beside)
            static, dynamic = both.plates["plate 1"], both.dynamic["plate 1"]
            key = dict(zip(("seed", *SETUP), (seed, machine, name, count, places), strict=True))
            for trial, other in trials.items():
                samples = plate_samples(other, stated, both.sensors, None, LAGS_S)
                felt, wrench = (x[EDGE:-EDGE] for x in samples["plate 1"])
                for model, left in (
                    ("static", static.compensate(felt[:, : 3 * count], wrench)),
                    ("dynamic", dynamic.compensate(felt, wrench)),
                ):
                    slow = low_pass(left, RATE_HZ, 6.0, "zero_phase")
                    own = {**key, "chosen": chosen, "trial": trial, "model": model}
                    for below_hz, values in ((20, left), (6, slow)):
                        rms = dict(zip(COMPONENTS, values.std(axis=0), strict=True))
                        found.append(own | {"below_hz": below_hz} | rms)
    return found


def norms(left: pd.DataFrame) -> pd.DataFrame:
    """Add the norms of force and moment."""
    return left.assign(
        force=np.linalg.norm(left[COMPONENTS[:3]], axis=1),
        moment=np.linalg.norm(left[COMPONENTS[3:]], axis=1),
    )


def pooled(rows: pd.DataFrame) -> pd.DataFrame:
    """Give root mean squares over laboratories, and how often the dynamic model is taken."""
    keys = [*SETUP, "trial", "below_hz", "model"]
    squares = rows.assign(taken=rows.chosen == "dynamic", **(rows[COMPONENTS] ** 2))
    means = squares.groupby(keys, sort=False)[["taken", *COMPONENTS]].mean()
    return norms(means.assign(**(means[COMPONENTS] ** 0.5)))


def worst(rows: pd.DataFrame) -> pd.Series:
    """Give the largest factor by which the dynamic model leaves more of a trial, by setup."""
    if rows.empty:
        return pd.Series(dtype=float)
    keys = ["seed", *SETUP, "trial", "below_hz"]
    by_model = norms(rows).set_index([*keys, "model"])[["force", "moment"]].unstack("model")
    shares = by_model.xs("dynamic", axis=1, level=1) / by_model.xs("static", axis=1, level=1)
    return shares.max(axis=1).groupby(SETUP, sort=False).max()


def unmet(rows: pd.DataFrame) -> list[str]:
    """Give what is demanded and not reached.

    Beyond a rigid machine, as belts and rollers do to their own plate, drift and noise what no
    model of the platform removes.
    """
    factors = worst(rows[rows.chosen == "dynamic"])
    missed = [
        f"{', '.join(map(str, key))}: where it is taken, the dynamic model leaves up to "
        f"{factor:.2f} times as much as the static one"
        for key, factor in factors[factors > MAX_WORSE].items()
    ]
    name, count = BEST
    best = rows[(rows.calibration == name) & (rows.sensors == count) & (rows.below_hz == 20)]
    best = best[best.places == "as usual"]
    own = best.assign(taken=np.where(best.machine == "rigid", "static", best.chosen))
    squares = own[own.model == own.taken].assign(**(own[COMPONENTS] ** 2))
    left = squares.groupby(["machine", "trial"], sort=False)[COMPONENTS].mean()
    beyond = (left - left.xs("rigid")).clip(lower=0) ** 0.5
    return missed + [
        f"{machine} machine, {trial}: {row.round(2).to_dict()} beyond a rigid one"
        for (machine, trial), row in beyond[(beyond > GOAL).any(axis=1)].iterrows()
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.inertia_models", description=__doc__
    )
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 10), metavar=("FIRST", "END"))
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    (name, count), cases = BEST, []
    for seed in range(*given.seeds):
        cases += [(seed, "default"), (seed, "soft"), (seed, "rigid", (name,), (count,))]
        cases += [(seed, "soft", (name,), (len(at),), key) for key, at in ARRANGEMENTS.items()]
    with Pool(given.jobs) as pool:
        rows = pd.DataFrame(chain(*pool.starmap(judge, cases, 1)))
    print(markdown(pooled(rows).reset_index()), markdown(worst(rows).reset_index()), sep="\n\n")
    missed = unmet(rows)
    print(*(f"not met: {goal}" for goal in missed), sep="\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
