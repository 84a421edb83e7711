"""Simulated plates with one known fault: is it found, sized, and the verdict right?"""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np

from hbm.signals.filtering import low_pass
from hbm.spatial import Array
from pipeline.config.plate_study import AccuracyLimits, read_plates_study
from pipeline.plate_accuracy.accuracy import check_plates
from pipeline.plate_accuracy.response import QUANTITIES, stance_loads
from pipeline.plate_accuracy.verdict import TOTAL, Answer, judge
from pipeline.virtual_lab.machine.instruments import ANALOG_HZ, PLATE_CENTERS_M
from pipeline.virtual_lab.protocol.known_weights import (
    FULL_SCALE_N,
    PLATES,
    SUPPORTED_VIBRATION,
    PlateErrors,
    simulate_plates,
)

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


@dataclass(frozen=True, slots=True)
class Case:
    """A study of two plates that have the same fault, or none, and different noise."""

    fault: str
    share: float
    seed: int
    standard: bool = False


@dataclass(frozen=True, slots=True)
class PlateOutcome:
    """What was found of a plate.

    Attributes
    ----------
    case
        Of which it is one plate.
    found
        Whether the fault differs significantly from none, all its estimates; a noise, which is not
        tested, never.
    invented
        Significant faults that it does not have.
    sized
        How many of the estimates of its fault lie within their 95 % interval, and of how many.
    totals
        How many true total errors are above the lower and below the upper bound, and of how many.
    verdict, truth
        Of `hbm plates`, and from the known fault.
    """

    case: Case
    found: bool
    invented: tuple[str, ...]
    sized: tuple[int, int]
    totals: tuple[int, int, int]
    verdict: Answer
    truth: Answer


def cases(seeds: Sequence[int]) -> Iterator[Case]:
    """Give every fault in every size, seed by seed."""
    for seed in seeds:
        for fault, share in product(FAULTS, SIZES):
            yield Case(fault.name, share, seed)


def faultless(count: int, standard: int) -> Iterator[Case]:
    """Give studies of plates that are perfect but for noise."""
    yield from (Case("none", 0.0, seed) for seed in range(count))
    yield from (Case("none", 0.0, seed, standard=True) for seed in range(standard))


def carry_out(case: Case) -> list[PlateOutcome]:
    """Simulate a study and compare what is found of its plates with what they have."""
    named = {fault.name: fault for fault in FAULTS}
    fault = named.get(case.fault)
    size = case.share * fault.limit if fault else 0.0
    errors = fault.make(size) if fault else PlateErrors()
    number = 1 + (list(named).index(case.fault) if fault else -1)
    seed = case.seed + 1000 * number + 100_000 * round(100 * case.share) + 10**8 * case.standard
    with tempfile.TemporaryDirectory(prefix="plates") as folder:
        simulate_plates(Path(folder), errors, seed=seed, **(STANDARD if case.standard else DESIGN))
        found = check_plates(read_plates_study(folder))
    outcomes = []
    for verdict in judge(found):
        own = [one for one in found.faults if one.belt == verdict.belt]
        total = true_totals(errors, verdict.belt)
        wanted = fault.wanted if fault else ()
        significant = {one.fault for one in own if one.significant}
        judged = {one.name: one for one in verdict.judged}
        within = [
            judged[name].low <= size <= judged[name].high for name in wanted if name in judged
        ]
        totals = [judged[f"{TOTAL} of {name}"] for name in QUANTITIES]
        above = sum(bool(one.low <= true) for one, true in zip(totals, total, strict=True))
        below = sum(bool(one.high >= true) for one, true in zip(totals, total, strict=True))
        outcomes.append(
            PlateOutcome(
                case,
                found=bool(wanted) and significant.issuperset(wanted),
                invented=tuple(sorted(significant - set(wanted) - _same(fault))),
                sized=(sum(within), len(within)),
                totals=(above, below, len(totals)),
                verdict=verdict.answer,
                truth=true_verdict(fault, size, verdict.belt),
            )
        )
    return outcomes


def _same(fault: Fault | None) -> set[str]:
    """Give other names under which a fault is rightly found."""
    return {"delay"} if fault is not None and fault.name == "delay" else set()


def true_verdict(fault: Fault | None, size: float, belt: str) -> Answer:
    """Give the verdict that the known fault deserves."""
    if fault is None or not (size > fault.limit or _beyond(fault.make(size), belt)):
        return "fit"
    if fault.like_masses:
        return "cannot be told"
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
