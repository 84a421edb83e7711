"""Plates with one known fault each: is it found, sized, and the verdict right?

``python -m tests.campaign.plates [--seeds N] [--workers N]`` writes its tables to
validation/plates.md, after every seed.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from multiprocessing import Pool
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.config.plate_study import AccuracyLimits, read_plates_study
from pipeline.plate_accuracy.accuracy import check_plates
from pipeline.plate_accuracy.response import QUANTITIES, stance_loads
from pipeline.plate_accuracy.verdict import TOTAL, Answer, judge
from pipeline.virtual_lab.machine.instrumented_treadmill import ANALOG_HZ, PLATE_CENTERS_M
from pipeline.virtual_lab.protocol.known_weights import (
    FULL_SCALE_N,
    PLATES,
    SUPPORTED_VIBRATION,
    PlateErrors,
    simulate_plates,
)
from tests.campaign.pages import renew
from tests.tables import markdown

DESIGN: Final = {
    "speeds": (0.7, 1.0),
    "weights": (13.44, 22.56, 45.08),
    "positions": (0.15, 0.35),
    "supports": (True,),
}
"""Two profiles with each: 24 recordings on each plate, a third of the thesis' with supports."""
STANDARD: Final = {"supports": (True,)}
"""The thesis' design: 72 recordings on each plate."""
SIZES: Final = (0.1, 0.5, 0.9, 1.1, 3.0)
"""Of faults, in shares of their limit."""
PERFECT: Final = 50
STANDARD_STUDIES: Final = 3
"""Studies of two plates without a fault, of either design."""
RATE_HZ: Final = 5.0
MINUTE_S: Final = np.arange(301) / RATE_HZ
"""Over which the true error of a person's load is averaged."""
LIMITS: Final = AccuracyLimits()
BODY_MASS_KG: Final = 75.0
NOISE_SHARE: Final = float(
    np.std(low_pass(np.random.default_rng(0).normal(size=100_000), 1000.0, 20.0, "double_pass"))
)
"""Of white noise at 1000 Hz, what the study's low-pass leaves."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A way to be wrong.

    Attributes
    ----------
    name
        For people.
    limit
        Of its size, SI.
    make
        A plate with the fault of a given size.
    estimates
        What `hbm plates` calls it, where its size is that of the fault; by default its name.
    lasting
        Whether no calibration takes it away.
    like_masses
        Whether weights that are all heavier than stated would explain it.
    """

    name: str
    limit: float
    make: Callable[[float], PlateErrors]
    estimates: tuple[str, ...] = ()
    lasting: bool = False
    like_masses: bool = False

    @property
    def wanted(self) -> tuple[str, ...]:
        return self.estimates or (self.name,)


def _entries(*places: tuple[int, int]) -> Callable[[float], PlateErrors]:
    return lambda size: PlateErrors(cross_talk=dict.fromkeys(places, size))


def _noisy(size: float) -> PlateErrors:
    return PlateErrors(noise_n=size / NOISE_SHARE)


def _vibrating(size: float) -> PlateErrors:
    return PlateErrors(vibration_m=size / SUPPORTED_VIBRATION)


GAIN, CROSS_TALK = LIMITS.gain_percent / 100, LIMITS.cross_talk_percent / 100
GAINS: Final = tuple(f"gain of {name}" for name in ("Fx", "Fz", "Mx", "My", "Mz"))
CURVATURE_N: Final = LIMITS.curvature_percent / 100 * FULL_SCALE_N
FAULTS: Final = (
    Fault("all gains", GAIN, _entries(*((k, k) for k in range(6))), GAINS, like_masses=True),
    Fault("gain of Fx", GAIN, _entries((0, 0))),
    Fault("gain of Fz", GAIN, _entries((2, 2))),
    Fault("Fz in Fx", CROSS_TALK, _entries((0, 2))),
    Fault("Fx in Fz", CROSS_TALK, _entries((2, 0))),
    Fault("Fx in Mz", CROSS_TALK, _entries((5, 0))),
    Fault("angle", LIMITS.angle_deg, lambda size: PlateErrors(angle_rad=np.radians(size))),
    Fault("offset along", LIMITS.offset_m, lambda size: PlateErrors(offset_m=(size, 0.0))),
    Fault("offset across", LIMITS.offset_m, lambda size: PlateErrors(offset_m=(0.0, size))),
    Fault("delay", LIMITS.delay_s, lambda size: PlateErrors(delay_s=size), ("delay in motion",)),
    Fault("zero of Fz", LIMITS.zero_n, lambda size: PlateErrors(zero=(0, 0, size, 0, 0, 0))),
    Fault(
        "drift", LIMITS.drift_n_per_s, lambda size: PlateErrors(drift_n_per_s=size), lasting=True
    ),
    Fault(
        "curvature",
        CURVATURE_N,
        lambda size: PlateErrors(curvature=size / FULL_SCALE_N),
        lasting=True,
    ),
    Fault("vibration", LIMITS.vibration_m, _vibrating, ("vibration with supports",), lasting=True),
    Fault("noise", LIMITS.noise_n, _noisy, ("noise of forces",), lasting=True),
)


def faulty(fault: str, share: float, seed: int, *, standard: bool = False) -> pd.DataFrame:
    """Simulate a study of two plates with the same fault, and compare what is found with that.

    Gives a row per plate: whether the fault differs significantly from none by all its estimates
    (a noise, which is not tested, never), how many significant faults are ``invented``, how many of
    the estimates lie within their 95 % interval and of how many, how many true total errors are
    above the lower and below the upper bound and of how many, the verdict and the true one.
    """
    named = {each.name: each for each in FAULTS}
    own = named.get(fault)
    size = share * own.limit if own else 0.0
    errors = own.make(size) if own else PlateErrors()
    number = 1 + (list(named).index(fault) if own else -1)
    seed += 1000 * number + 100_000 * round(100 * share) + 10**8 * standard
    with tempfile.TemporaryDirectory(prefix="plates") as folder:
        simulate_plates(Path(folder), errors, seed=seed, **(STANDARD if standard else DESIGN))
        found = check_plates(read_plates_study(folder))
    rows = []
    for verdict in judge(found):
        significant = {f.fault for f in found.faults if f.belt == verdict.belt and f.significant}
        wanted = set(own.wanted) if own else set()
        rightly = wanted | ({"delay"} if fault == "delay" else set())
        judged = {one.name: one for one in verdict.judged}
        sized = [judged[name] for name in sorted(wanted & set(judged))]
        totals = [judged[f"{TOTAL} of {name}"] for name in QUANTITIES]
        true = true_totals(errors, verdict.belt)
        rows.append(
            {
                "fault": fault,
                "of its limit": share,
                "found": bool(wanted) and significant >= wanted,
                "invented": len(significant - rightly),
                "sized": sum(one.low <= size <= one.high for one in sized),
                "sizes": len(sized),
                "below": sum(one.low <= value for one, value in zip(totals, true, strict=True)),
                "above": sum(one.high >= value for one, value in zip(totals, true, strict=True)),
                "totals": len(totals),
                "verdict": verdict.answer,
                "truth": true_verdict(own, size, verdict.belt),
            }
        )
    return pd.DataFrame(rows)


def true_verdict(fault: Fault | None, size: float, belt: str) -> Answer:
    """Give the verdict that the known fault deserves."""
    if fault is None or not (size > fault.limit or _beyond(fault.make(size), belt)):
        return "fit"
    if fault.like_masses:
        return "cannot be determined"
    return "not fit" if fault.lasting else "fit after correction"


def _beyond(errors: PlateErrors, belt: str) -> bool:
    limits = np.repeat([LIMITS.force_n, LIMITS.cop_m, LIMITS.moment_nm], [3, 2, 3])
    return bool((true_totals(errors, belt) > limits).any())


def true_totals(errors: PlateErrors, belt: str) -> Array:
    """Give the root-mean-square errors of a plate under a person's loads for a minute, (8,).

    Every load acts for a minute on the simulated plate: what it then reports, of centre of
    pressure and moment as they are defined, less the truth.
    """
    rng = np.random.default_rng(0)
    per_sample = float(np.sqrt(ANALOG_HZ / RATE_HZ))
    plate = replace(errors, noise_n=errors.noise_n * NOISE_SHARE * per_sample).plate
    c, s = np.cos(errors.angle_rad), np.sin(errors.angle_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    center = PLATE_CENTERS_M[PLATES[belt]]
    moved = turn @ center + [*errors.offset_m, 0.0] - center
    shaken = SUPPORTED_VIBRATION * errors.vibration_m
    off = []
    for load in stance_loads(BODY_MASS_KG):
        force, moment = np.tile(load[:3], (len(MINUTE_S), 1)), np.tile(load[3:], (len(MINUTE_S), 1))
        moment[:, 1] -= load[2] * shaken * np.sin(2 * np.pi * errors.vibration_hz * MINUTE_S)
        turned = force @ turn.T
        carried = np.hstack([turned, moment @ turn.T + np.cross(moved, turned)])
        got = plate.measure(carried, RATE_HZ, rng)
        place = np.array([-load[4] / load[2], load[3] / load[2], 1.0])
        above = got[:, 3:] - np.cross(place, got[:, :3])
        pressure = np.column_stack([-got[:, 4] / got[:, 2], got[:, 3] / got[:, 2]]) - place[:2]
        truth = load[3:] - np.cross(place, load[:3])
        off.append(np.hstack([got[:, :3] - load[:3], pressure, above - truth]))
    return np.asarray(np.sqrt(np.mean(np.square(off), axis=(0, 1))))


def report(done: pd.DataFrame, perfect: pd.DataFrame) -> str:
    """Give one row per fault and size, and what all plates have in common."""
    right = done.verdict == done.truth
    untold = ~right & (done.verdict == "cannot be determined")
    counted = done.assign(right=right, untold=untold, plates=1)
    sums = ["found", "sized", "sizes", "right", "untold", "plates"]
    rows = counted.groupby(["fault", "of its limit", "truth"], sort=False)[sums].sum()
    bad = done[done.truth != "fit"]
    share = done[["sized", "sizes", "above", "below", "totals"]].sum()
    lines = [
        markdown(rows.reset_index(), digits=1),
        f"Within their 95 % intervals: {share.sized} of {share.sizes} sizes. Of the "
        f"{share.totals} true total errors, {share.above} are below the upper bounds and "
        f"{share.below} above the lower ones. Of {len(bad)} plates that are not fit as they are, "
        f"{(bad.verdict == 'fit').sum()} were called fit. {(done.invented > 0).sum()} plates have "
        "a fault found that they do not have.",
    ]
    for words, alike in perfect.groupby("recordings"):
        lines.append(
            f"Without a fault, {words}: {(alike.verdict == 'fit').sum()} of {len(alike)} are fit, "
            f"for {(alike.verdict == 'cannot be determined').sum()} it cannot be determined; "
            f"{(alike.invented > 0).sum()} have a fault that differs significantly from none."
        )
    return "\n\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.plates", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="of noise, for each fault and size")
    parser.add_argument("--workers", type=int, default=1, help="how many studies at a time")
    given = parser.parse_args()
    start, done = time.monotonic(), []
    with Pool(given.workers) as pool:
        parts = []
        for standard, count, words in (
            (False, PERFECT, "24 recordings"),
            (True, STANDARD_STUDIES, "the thesis' 72 recordings"),
        ):
            none = partial(faulty, "none", 0.0, standard=standard)
            parts += [each.assign(recordings=words) for each in pool.imap(none, range(count))]
        perfect = pd.concat(parts)
        for seed in range(given.seeds):
            cases = [(fault.name, share, seed) for fault, share in product(FAULTS, SIZES)]
            done += pool.starmap(faulty, cases, 1)
            minutes = (time.monotonic() - start) / 60
            used = f"--seeds {seed + 1}`, {minutes:.0f} minutes, {given.workers} at a time."
            text = f"`python -m tests.campaign.plates {used}\n\n{report(pd.concat(done), perfect)}"
            renew("plates.md", "campaign", text)


if __name__ == "__main__":
    main()
