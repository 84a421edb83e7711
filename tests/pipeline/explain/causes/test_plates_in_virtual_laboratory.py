"""Every cause of plates is what the same fault is in the virtual laboratory."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.explain.cause import Cause
from pipeline.explain.causes.plates import plate_causes
from pipeline.explain.linearise import result_chain
from pipeline.explain.series import CycleSeries, cycle_series
from pipeline.trial.chain import Chain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.result import TrialResult
from pipeline.virtual_lab.faults import Faults, PlateFaults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    InstrumentedTreadmill,
    make_treadmill,
)
from tests.campaign.explain.plate_faults import PlateFault, restated, true_sizes, with_faults
from tests.campaign.explain.virtual_trial import Walked, recorded, walk_on
from tests.pipeline.explain.coefficients import estimate_sizes

SETTLED = slice(60, -60)
STILL = Laboratory(Treadmill())
SIZES = {"zero of F": 20.0, "zero of M": 6.0, "gain": 0.03, "Fz": 0.02, "place": 0.015}


@dataclass(frozen=True)
class PerfectTrial:
    """A trial of a laboratory without a fault, of the body that markers suggest."""

    treadmill: InstrumentedTreadmill
    walked: Walked
    result: TrialResult
    chain: Chain
    series: CycleSeries


@pytest.fixture(scope="module")
def perfect() -> PerfectTrial:
    faults = Faults.none()
    treadmill = make_treadmill(faults, 3)
    walked = walk_on(treadmill, faults.body, (3,), individuality=0.0)
    recording, person = recorded(walked, treadmill), walked.walk.subject.person
    subject = Subject(sex=person.sex, mass_kg=person.mass_kg)
    result = process_recording(recording, subject, Settings())
    chain = result_chain(recording, STILL, result)
    series = cycle_series(chain.time, result.cycles["right"][2:], 9.0)
    return PerfectTrial(treadmill, walked, result, chain, series)


def with_one(trial: PerfectTrial, name: str, size: float) -> tuple[Chain, dict[str, float]]:
    """Record the same walk by plates with one fault; gives its chain and the true sizes."""
    late_s = size if name == "plates delayed" else 0.0
    faults = [one_fault(name, size) if f"plate {k}:" in name else PlateFault() for k in (1, 2)]
    treadmill = with_faults(trial.treadmill, faults, late_s)
    recording = restated(recorded(trial.walked, treadmill), faults)
    chain = result_chain(recording, STILL, trial.result)
    return chain, true_sizes(treadmill, recording, trial.chain.wrenches)


def one_fault(name: str, size: float) -> PlateFault:
    kind, last = name.partition(": ")[2], name.split()[-1]
    if kind.startswith("place"):
        return PlateFault(place=size * np.eye(3)["xyz".index(last)])
    if kind.startswith("direction"):
        return PlateFault(direction=size * np.eye(3)["xyz".index(last)])
    unit = np.eye(6)[WRENCH_COMPONENTS.index(last)]
    if kind.startswith("zero"):
        return PlateFault(zero=size * unit)
    shown = unit if kind.startswith("gain") else np.eye(6)[2]
    return PlateFault(gain=size * np.outer(unit, shown))


def size_of(name: str) -> float:
    """Give a size that is large but possible: 8 ms late and 0.03 rad beside those of `SIZES`."""
    if name == "plates delayed":
        return 0.008
    return next((size for kind, size in SIZES.items() if f": {kind}" in name), 0.03)


def difference(found: Array, expected: Array) -> float:
    """Give what differs as a share of what is expected, by root mean squares of all axes."""
    scale = np.maximum(np.sqrt(np.mean(expected[SETTLED] ** 2, axis=0)), 0.1)
    return float(np.sqrt(np.mean(((found - expected)[SETTLED] / scale) ** 2)))


KINDS = (
    *(f"zero of {component}" for component in WRENCH_COMPONENTS),
    *(f"gain of {component}" for component in WRENCH_COMPONENTS),
    *(f"Fz in {component}" for component in WRENCH_COMPONENTS[:2]),
    *(f"place along {letter}" for letter in "xyz"),
    *(f"direction about {letter}" for letter in "xyz"),
)
NAMES = ["plates delayed", *(f"plate {1 + k % 2}: {kind}" for k, kind in enumerate(KINDS))]
"""Each kind of fault, of the one plate or the other by turns."""


@pytest.mark.parametrize("name", NAMES)
def test_a_cause_is_what_the_same_fault_of_a_plate_is(perfect: PerfectTrial, name: str) -> None:
    size, clean = size_of(name), perfect.chain.residual
    faulty, true = with_one(perfect, name, size)
    assert true == pytest.approx({each: size * (each == name) for each in true}, abs=1e-4 * size)

    changed = cause_named(perfect.chain, name).change(perfect.chain, size)
    added = faulty.residual - clean
    assert difference(changed.residual - clean, added) < 0.01

    cause = cause_named(faulty, name)
    effect = cause.effect(cause.change(faulty, -size / 2))
    found = estimate_sizes(
        perfect.series.coefficients(added),
        perfect.series.coefficients(effect)[None],
        np.array([10 * size]),
        *np.zeros((2, 1), bool),
    )
    assert found.size[0] == pytest.approx(size, rel=0.02)


def test_plates_that_cameras_see_elsewhere_are_turned_and_moved(perfect: PerfectTrial) -> None:
    turned = PlateFaults(placement_deg=0.5, placement_forward_m=0.01, placement_left_m=-0.004)
    none = Faults.none()
    plates = none.plates.model_copy(update=turned.model_dump(include=turned.model_fields_set))
    faults = none.model_copy(update={"plates": plates})
    treadmill = replace(perfect.treadmill, faults=faults)
    recording = recorded(perfect.walked, treadmill)
    faulty = result_chain(recording, STILL, perfect.result)
    true = true_sizes(treadmill, recording, perfect.chain.wrenches)
    assert true["plate 1: direction about z"] == pytest.approx(np.radians(0.5), rel=0.01)

    changed = perfect.chain
    for cause in plate_causes(perfect.chain):
        changed = cause.change(changed, true[cause.name])
    clean = perfect.chain.residual
    assert difference(changed.residual - clean, faulty.residual - clean) < 0.02


def cause_named(chain: Chain, name: str) -> Cause:
    return next(cause for cause in plate_causes(chain) if cause.name == name)
