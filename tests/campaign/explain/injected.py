"""Faults of any size put into recordings: ``python -m tests.campaign.explain.injected --trials N``.

Each trial is a recording, real or virtual, with a few faults, mostly of instruments that have none:
sizes are uniform up to ten usual ones (delays: up to three, 30 ms). It is processed and explained
like any other. In virtual recordings sizes are known; in real ones what was found without the
faults is added to them. Prints how often intervals hold and what is found, by class of size and by
kind of cause; all rows are in ``--out``.
"""

import argparse
import re
import sys
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from hbm.spatial import WRENCH_COMPONENTS
from pipeline.config.schema import Condition, Settings, Subject, Treadmill
from pipeline.explain.budget import EstimatedCause
from pipeline.explain.cause import priors
from pipeline.explain.explain import explain_trial
from pipeline.io.recording import Recording
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from tests.campaign.explain.faults import Seeded
from tests.campaign.explain.plate_faults import PlateFault, restated
from tests.campaign.explain.virtual_trial import (
    STEADY_S,
    VirtualLaboratory,
    body_faults,
    stated_subject,
    walk_on,
)
from tests.campaign.explain.virtual_trial import recorded as recorded_virtually
from tests.recordings.recorded import child, generated, later, overground, treadmill

REAL: Final = {
    "treadmill_events": treadmill,
    "opensim_subject01": overground,
    "truth_walk": generated,
    "HC030": child("HC030"),
    "HC031": child("HC031"),
}
"""Of truth_walk plates and markers are computed; the others were recorded."""
STILL: Final = Laboratory(Treadmill())
FAULTS: Final = 2.0
"""In a trial, on average."""
MOST: Final = 10.0
MOST_LATE: Final = 3.0
"""Of usual sizes."""
CLASSES: Final = (0.0, 1.0, 3.0, 6.0, MOST)
INSIDE: Final = 1.96


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """A recording, how it is processed, and what is found without further faults, by name."""

    recording: Recording
    known: dict[str, Any]
    is_virtual: bool
    found: dict[str, float]


@cache
def base(name: str, data: Path) -> Base:
    """Give a recording without faults besides its own: of ``REAL``, or of a virtual walk's seed."""
    if name in REAL:
        recording, known = REAL[name](data)
        found = {cause.name: cause.size for cause in explained(recording, known)}
        return Base(recording, known, False, found)
    laboratory, seeded = VirtualLaboratory(int(name)), Seeded()
    walked = walk_on(laboratory.treadmill, body_faults(seeded), (int(name), 1))
    recording = recorded_virtually(walked, laboratory.treadmill)
    known = {"subject": stated_subject(walked, seeded), "condition": Condition(skip_s=STEADY_S)}
    return Base(recording, known, True, {})


def explained(recording: Recording, known: dict[str, Any]) -> tuple[EstimatedCause, ...]:
    """Process and explain a recording."""
    result = process_recording(recording, settings=Settings(), laboratory=STILL, **known)
    return explain_trial(recording, STILL, result).causes


def possible(of: Base) -> dict[str, str]:
    """Give the faults that can be put into a recording, by name of cause, with the prior's kind."""
    kinds = {"plates delayed": "delay"}
    if of.known["subject"].mass_kg is not None:
        kinds["body mass"] = "body_mass"
    for plate in of.recording.plates:
        name = f"plate {plate.number}"
        for i, component in enumerate(WRENCH_COMPONENTS):
            kinds[f"{name}: zero of {component}"] = "zero_force" if i < 3 else "zero_moment"
            kinds[f"{name}: gain of {component}"] = "gain"
        for component in WRENCH_COMPONENTS[:2]:
            kinds[f"{name}: Fz in {component}"] = "cross_talk"
        for letter in "xyz":
            kinds[f"{name}: place along {letter}"] = "place"
            kinds[f"{name}: direction about {letter}"] = "direction"
    return kinds


def with_faults(of: Base, sizes: dict[str, float]) -> tuple[Recording, dict[str, Any]]:
    """Put faults of these sizes, by name of cause, into a recording and what is stated of it."""
    recording, known = of.recording, dict(of.known)
    faults = []
    for plate in recording.plates:
        fault = PlateFault()
        for name, size in sizes.items():
            if name.startswith(f"plate {plate.number}: "):
                fault += one_fault(name.partition(": ")[2], size)
        faults.append(fault)
    plates = tuple(
        replace(
            plate,
            wrench_in_plate=plate.wrench_in_plate @ (np.eye(6) + fault.gain).T + fault.zero,
        )
        for plate, fault in zip(recording.plates, faults, strict=True)
    )
    recording = restated(replace(recording, plates=plates), faults)
    if "body mass" in sizes:
        subject: Subject = known["subject"]
        mass_kg = (subject.mass_kg or 0.0) * (1 + sizes["body mass"])
        known["subject"] = subject.model_copy(update={"mass_kg": mass_kg})
    return later(recording, sizes.get("plates delayed", 0.0)), known


def one_fault(name: str, size: float) -> PlateFault:
    """Give a fault of a plate by what the name of its cause says of it."""
    component, last = (name.split()[-1],) * 2
    if name.startswith("zero"):
        return PlateFault(zero=size * np.eye(6)[WRENCH_COMPONENTS.index(component)])
    if name.startswith("gain"):
        return PlateFault(gain=size * np.diag(np.eye(6)[WRENCH_COMPONENTS.index(component)]))
    if name.startswith("Fz"):
        to = WRENCH_COMPONENTS.index(component)
        return PlateFault(gain=size * np.outer(np.eye(6)[to], np.eye(6)[2]))
    vector = size * np.eye(3)["xyz".index(last)]
    is_place = name.startswith("place")
    return PlateFault(place=vector) if is_place else PlateFault(direction=vector)


def rows(name: str, number: int, data: Path) -> pd.DataFrame:
    """Put random faults into a recording; gives a row for each that might be there."""
    of = base(name, data)
    rng = np.random.default_rng((number, *name.encode()))
    kinds, known_sizes = possible(of), priors()
    usual = {cause: known_sizes[kind].size for cause, kind in kinds.items()}
    there = rng.random(len(kinds)) < FAULTS / len(kinds)
    drawn = rng.uniform(0, MOST, len(kinds)) * rng.choice([-1.0, 1.0], len(kinds))
    sizes = {
        cause: usual[cause] * size * (MOST_LATE / MOST if kinds[cause] == "delay" else 1.0)
        for cause, size, own in zip(kinds, drawn, there, strict=True)
        if own
    }
    found = {cause.name: cause for cause in explained(*with_faults(of, sizes))}
    table = [
        {
            "trial": f"{name}.{number}",
            "virtual": of.is_virtual,
            "cause": cause,
            "kind": kind,
            "put": sizes.get(cause, 0.0) / usual[cause],
            "true": (sizes.get(cause, 0.0) + of.found.get(cause, 0.0)) / usual[cause],
            "size": found[cause].size / usual[cause],
            "deviation": found[cause].deviation / usual[cause],
            "chance": found[cause].chance,
            "told": found[cause].is_told or kind == "delay",
            "certain": found[cause].is_certain,
        }
        for cause, kind in kinds.items()
    ]
    return pd.DataFrame(table)


def summary(table: pd.DataFrame) -> str:
    """Say by class of size and by kind how often intervals hold, and what is found."""
    size = table.put.abs()
    names = [f"{low:g}–{high:g}" for low, high in pairwise(CLASSES)]
    of_class = pd.cut(size, CLASSES, labels=names).astype(object)
    table = table.assign(
        held=(table["size"] - table.true).abs() <= INSIDE * table.deviation,
        of=of_class.where(size > 0, "absent"),
        kind=table.kind.map(lambda kind: re.sub("_(force|moment)$", "", kind)),
    )
    present = table[size > 0]
    parts = [
        _by(own, "of", words)
        for words, own in (("virtual", table[table.virtual]), ("real", table[~table.virtual]))
    ]
    parts.append(_by(present[present.put.abs() > 1], "kind", "sizes above one usual"))
    return "\n\n".join(parts)


def _by(table: pd.DataFrame, column: str, words: str) -> str:
    lines = [f"| {words} | sizes | held | told | held of told | found / true of told | certain |"]
    lines.append("|---|---|---|---|---|---|---|")
    for name, own in table.groupby(column, sort=True):
        told = own[own.told]
        ratio = (told["size"] * told.true).sum() / (told.true**2).sum() if told.put.any() else None
        shown = "–" if ratio is None else f"{ratio:.2f}"
        lines.append(
            f"| {name} | {len(own)} | {_percent(own.held)} | {_percent(own.told)} "
            f"| {_percent(told.held)} | {shown} | {_percent(own.certain)} |"
        )
    return "\n".join(lines)


def _percent(of: pd.Series) -> str:
    return f"{100 * of.astype(float).mean():.1f} %" if len(of) else "–"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.explain.injected", description=__doc__
    )
    parser.add_argument("--trials", type=int, default=100, help="of each recording")
    parser.add_argument("--first", type=int, default=0, help="number of the first trial")
    parser.add_argument("--recordings", nargs="*", default=[*REAL, *map(str, range(9600, 9610))])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--out", type=Path, default=Path("explain_injected.csv"))
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.trials)
    found = [rows(name, number, given.data) for name in given.recordings for number in numbers]
    table = pd.concat(found, ignore_index=True)
    table.to_csv(given.out, index=False)
    print(summary(table))
    return 0


if __name__ == "__main__":
    sys.exit(main())
