"""One trial with seeded faults: what each truly makes of the residuals, and what is said of it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.config.schema import Condition, Settings
from pipeline.explain.budget import Budget
from pipeline.explain.cause import priors
from pipeline.explain.explain import explain_trial
from pipeline.explain.linearise import result_chain
from pipeline.io.recording import Recording
from pipeline.trial.chain import Chain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.result import TrialResult
from tests.campaign.explain.faults import KINDS, Seeded, possible
from tests.campaign.explain.plate_faults import shown_by, true_sizes
from tests.campaign.explain.truth import body_sizes
from tests.campaign.explain.virtual_trial import (
    DURATION_S,
    STEADY_S,
    VirtualLaboratory,
    Walked,
    body_faults,
    stated_recording,
    stated_subject,
    walk_on,
)

SETTINGS: Final = Settings()
MOVING_SHARE: Final = 0.4
"""Of the trials, on a treadmill that sways and pitches; in half of them channels give its pose."""
MAX_FAULTS: Final = 5
WRONG: Final = 3.0
"""Factor by which one prior is wrong, either way."""
EVERY: Final = 5
"""Of so many trials of a laboratory one is explained with a wrong prior too."""
EXPLAINED_S: Final = slice(round(100 * STEADY_S), round(100 * (DURATION_S - 1)))
"""Frames in which true shares are taken."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A trial before it takes place.

    Attributes
    ----------
    laboratory
        Seed of its instruments.
    number
        Of the trial in it.
    where
        "still", "markers" or "channels": whether the treadmill moves, and how its pose is known.
    faults
        Kind -> what is seeded of it.
    wrong
        Key of the prior that is wrong in a second explanation, and its factor.
    """

    laboratory: int
    number: int
    where: str
    faults: Mapping[str, Seeded]
    wrong: tuple[str, float]

    @property
    def name(self) -> str:
        """Name of the trial."""
        return f"{self.laboratory}.{self.number}"

    def seeded(self, without: Sequence[str] = ()) -> Seeded:
        """Give what is wrong, without some kinds."""
        total = Seeded()
        for name, fault in self.faults.items():
            if name not in without:
                total += fault
            else:
                total += KINDS[name].usual.negative()
        return total


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What was found of a trial.

    Attributes
    ----------
    plan
        The trial.
    true
        Cause -> true size, of those that have one.
    share
        Kind -> share of the mean square that it truly makes, (6,).
    budgets
        "as usual", and "wrong prior" for some -> what was found.
    """

    plan: Plan
    true: Mapping[str, float]
    share: Mapping[str, Array]
    budgets: Mapping[str, Budget]


def planned(laboratory: int, number: int) -> Plan:
    """Draw a trial: its faults, their sizes, and which prior is wrong."""
    rng = np.random.default_rng((laboratory, number, 18))
    moving, channels = rng.random() < MOVING_SHARE, rng.random() < 0.5
    where = ("channels" if channels else "markers") if moving else "still"
    conditions = ("anywhere", *(("moving",) if moving else ()), where)
    names = possible(priors(), conditions)
    count = int(rng.integers(1, MAX_FAULTS, endpoint=True))
    chosen = set(rng.choice(names, size=count, replace=False).tolist())
    if chosen & {"place", "direction"}:  # else sizes would add up to more than is usual
        chosen.discard("placement of both")
    faults = {name: KINDS[name].draw(rng) for name in sorted(chosen)}
    keys = sorted({key for name in sorted(chosen) for key in KINDS[name].priors}) or ["delay"]
    wrong = str(rng.choice(keys)), float(rng.choice([WRONG, 1 / WRONG]))
    return Plan(laboratory, number, where, faults, wrong)


def carried_out(laboratory: VirtualLaboratory, plan: Plan) -> Outcome:
    """Simulate, process and explain a trial, and repeat it without each of its faults."""
    seeded, walks = plan.seeded(), dict[str, Walked]()
    walked, recording, known = simulated(laboratory, plan, seeded, walks)
    result = processed(walked, recording, known, seeded)
    chain = result_chain(recording, known, result)
    whole = chain.residual[EXPLAINED_S]
    share = {}
    for name in plan.faults:
        clean = residual_of(laboratory, plan, plan.seeded([name]), walks, result)
        share[name] = ((whole - clean) * whole).sum(axis=0) / (whole**2).sum(axis=0)
    budgets = {"as usual": explain_trial(recording, known, result)}
    if plan.number % EVERY == 0:
        with wrong_prior(*plan.wrong):
            budgets["wrong prior"] = explain_trial(recording, known, result)
    true = sizes(laboratory, seeded, recording, known, chain, walked)
    return Outcome(plan, true, share, budgets)


def simulated(
    laboratory: VirtualLaboratory, plan: Plan, seeded: Seeded, walks: dict[str, Walked]
) -> tuple[Walked, Recording, Laboratory]:
    """Simulate a trial, or record a walk of ``walks`` again if the person is the same."""
    body = body_faults(seeded)
    key = body.model_dump_json()
    moving = plan.where != "still"
    if key not in walks:
        seed = (plan.laboratory, plan.number)
        walks[key] = walk_on(laboratory.treadmill, body, seed, moving=moving)
    treadmill = laboratory.with_faults(seeded)
    known = laboratory.still
    if moving:
        channels = plan.where == "channels"
        known = laboratory.moving(seeded, shown_by(treadmill), channels=channels)
    return walks[key], stated_recording(walks[key], treadmill, seeded), known


def processed(
    walked: Walked, recording: Recording, known: Laboratory, seeded: Seeded
) -> TrialResult:
    """Process a trial as a study would."""
    subject, condition = stated_subject(walked, seeded), Condition(skip_s=STEADY_S)
    return process_recording(recording, subject, SETTINGS, laboratory=known, condition=condition)


def residual_of(
    laboratory: VirtualLaboratory,
    plan: Plan,
    seeded: Seeded,
    walks: dict[str, Walked],
    result: TrialResult,
) -> Array:
    """Give the residual with other faults; the body is built anew where it may be another one."""
    walked, recording, known = simulated(laboratory, plan, seeded, walks)
    full = plan.seeded()
    of_person = ("mass_share", "inertias", "joints", "skin")
    if any(getattr(seeded, name) != getattr(full, name) for name in of_person):
        result = processed(walked, recording, known, seeded)
    return result_chain(recording, known, result).residual[EXPLAINED_S]


def sizes(
    laboratory: VirtualLaboratory,
    seeded: Seeded,
    recording: Recording,
    known: Laboratory,
    chain: Chain,
    walked: Walked,
) -> dict[str, float]:
    """Give the true sizes of all causes that have one, by name.

    What the calibration found of the accelerometers' delay is a little wrong itself.
    """
    loads = [wrench[EXPLAINED_S] for wrench in chain.wrenches]
    treadmill = laboratory.with_faults(seeded)
    platform = {
        "platform: late": seeded.pose_late_s,
        "platform: pivot along z": seeded.pivot_m,
        "platform: pivot along x": 0.0,
        "platform: zero of sway": 0.0,
        "platform: zero of pitch": 0.0,
        "platform: size of sway": 0.0,
        "platform: size of pitch": 0.0,
        "platform: direction about z": 0.0,
    }
    if known.calibration is not None:
        sensors = np.mean([sensor.clock.delay_s for sensor in treadmill.sensors])
        plates = np.mean([plate.clock.delay_s for plate in treadmill.plates])
        found = np.mean([sensor.delay_s for sensor in known.calibration.sensors])
        platform["accelerometers delayed"] = float(sensors - plates - found)
    return (
        true_sizes(treadmill, recording, loads)
        | platform
        | body_sizes(chain.body, chain.q, walked.walk)
    )


@contextmanager
def wrong_prior(key: str, factor: float) -> Iterator[None]:
    """Take one prior to be larger by a factor than it is."""
    known = priors()
    right = known[key]
    known[key] = replace(right, size=factor * right.size)
    try:
        yield
    finally:
        known[key] = right
