"""What do recordings say at half and at twice each number of judgement?

    python -m tests.campaign.thresholds [--data ../shared/data] [SECTION | SECTION.NAME …]

Of `pipeline/trial/thresholds.toml`, or of another room's, by default of all its numbers. Healthy
walks, real and simulated, and walks with planted faults (`tests.campaign.threshold_walks`) are
processed with one number changed; of each, only the stages that read it, and those after them. One
that then has another mass, other notes, findings, events, flags of frames, residuals or joints, or
an error, says something else; one whose warnings, findings or errors are of other kinds judges
otherwise. Prints a line for each number: of the walks that read it, how many say something else and
judge otherwise, and with --details which kinds they say anew or no more.
"""

import sys
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from hbm.numbers import read_numbers
from pipeline.trial.chain import DEPENDS_ON, Chain, _all_of
from pipeline.trial.gait.spatiotemporal import spatiotemporal
from pipeline.trial.joints import joint_curves, joint_rows
from pipeline.trial.process import result_of
from pipeline.trial.residuals import residual_rows, threshold_rows
from tests.campaign.threshold_walks import Make, walks
from tests.tables import command

ROOT = Path(__file__).resolve().parents[2]
TRIAL = Path("pipeline/trial/thresholds.toml")
FACTORS = {"half": 0.5, "twice": 2.0}
STAGES = (*DEPENDS_ON,)[: (*DEPENDS_ON,).index("window") + 1]
"""Of a chain, each after those that it is computed from."""
REFUSALS = (ArithmeticError, LookupError, ValueError)
READ = set[str]()
"""Numbers that were read."""
Statements = tuple[str, frozenset[str]]
"""All that a trial says, and the kinds of its warnings and findings."""


class Numbers:
    """A section whose numbers are marked as read."""

    def __init__(self, section: str, values: SimpleNamespace) -> None:
        self._section, self._values = section, values

    def __getattr__(self, name: str) -> Any:
        READ.add(f"{self._section}.{name}")
        return getattr(self._values, name)


def statements(chain: Chain) -> Statements:
    """What a trial says."""
    try:
        result = result_of(chain)
    except REFUSALS as error:
        return str(error), frozenset({type(error).__name__})
    joints = joint_rows(result, "", joint_curves(result))
    said = *map(str, result.notes), result.findings, result.events, result.shortage, chain.mass
    tables = residual_rows(result), threshold_rows(result), joints, steps(chain)
    whole = repr((said, result.quality.tobytes(), tables))
    kinds = {note.code for note in result.notes if note.level == "warning"}
    return whole, frozenset(kinds | {finding.kind for finding in result.findings})


def steps(chain: Chain) -> str:
    """Lengths and times of steps."""
    places, window = chain.loads.places, chain.window
    return repr(spatiotemporal(chain.time, places[:, 1:], chain.gait.events, window.cycles))


class Walk:
    """A walk, what it says, and the numbers that each of its stages reads."""

    def __init__(self, make: Make) -> None:
        self.make = make
        self.reads = dict[str, frozenset[str]]()
        READ.clear()
        self.chain = chain = make()
        self.reads["inputs"] = frozenset(READ)
        for stage in STAGES:
            READ.clear()
            with suppress(*REFUSALS):
                getattr(chain, stage)
            self.reads[stage] = frozenset(READ)
        READ.clear()
        self.says = statements(chain)
        self.reads["statements"] = frozenset(READ)

    def without(self, number: str) -> Chain:
        """The walk, with the stages that neither read a number nor depend on it."""
        if number in self.reads["inputs"]:
            return self.make()
        reading = {stage for stage in STAGES if number in self.reads[stage]}
        chain = Chain(self.chain.inputs, self.chain.settings)
        for stage in STAGES:
            on = _all_of(stage, frozenset())
            if stage in self.chain.__dict__ and reading.isdisjoint({stage, *on}):
                chain.__dict__[stage] = self.chain.__dict__[stage]
        return chain


def watch(file: Path) -> None:
    """Have it noted which numbers of a file are read."""
    watched = {id(values): Numbers(name, values) for name, values in sections(file).items()}
    for module in [*sys.modules.values()]:
        for name, value in [*getattr(module, "__dict__", {}).items()]:
            if id(value) in watched and isinstance(value, SimpleNamespace):
                setattr(module, name, watched[id(value)])


def entries(file: Path) -> dict[str, dict[str, Any]]:
    """All sections of a file."""
    return tomllib.loads((ROOT / file).read_text(encoding="utf-8"))


def sections(file: Path) -> dict[str, SimpleNamespace]:
    """All sections of a file, as the package reads them."""
    package = ".".join(file.parent.parts)
    return {name: read_numbers(package, file.name, name) for name in entries(file)}


def scaled(value: Any, factor: float) -> Any:
    """The number, or each of several, times a factor; whole numbers stay whole."""
    if isinstance(value, dict):
        return {key: scaled(one, factor) for key, one in value.items()}
    if isinstance(value, list):
        return np.array([scaled(one, factor) for one in value])
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


class Changed(NamedTuple):
    """What a walk says with a number changed: whether anything else, and which kinds."""

    number: str
    factor: str
    walk: str
    is_healthy: bool
    says_else: bool
    kinds: tuple[str, ...]


def changes(data: Path, file: Path, names: list[str], walk: str) -> list[Changed]:
    """Process one walk with half and twice each number that it reads."""
    watch(file)
    case, found = walks(data)[walk], list[Changed]()
    every = file != TRIAL or not case.sections
    of_file = [number for number in numbers(file, names) if every or number[0] in case.sections]
    if not of_file:
        return []
    known = Walk(case.make)
    for section, name, value in of_file:
        values, number = sections(file)[section], f"{section}.{name}"
        if all(number not in read for read in known.reads.values()):
            continue
        kept = getattr(values, name)
        for words, factor in FACTORS.items():
            setattr(values, name, scaled(value, factor))
            try:
                now = statements(known.without(number))
            except REFUSALS as error:
                now = str(error), frozenset({type(error).__name__})
            before = known.says
            kinds = (
                *(f"+{kind}" for kind in sorted(now[1] - before[1])),
                *(f"-{kind}" for kind in sorted(before[1] - now[1])),
            )
            is_other = now[0] != before[0]
            found.append(Changed(number, words, walk, not case.sections, is_other, kinds))
        setattr(values, name, kept)
    return found


def lines(number: str, found: Sequence[Changed]) -> Iterator[str]:
    """Say in how many walks half and twice a number change what is said, and which kinds."""
    parts = list[str]()
    for factor in FACTORS:
        counts = []
        for words, is_healthy in {"healthy": True, "faulty": False}.items():
            of = [c for c in found if (c.factor, c.is_healthy) == (factor, is_healthy)]
            other, judges = sum(c.says_else for c in of), sum(bool(c.kinds) for c in of)
            counts.append(f"{other} of {len(of)} {words} say else, {judges} judge otherwise")
        parts.append(f"{factor}: {', '.join(counts)}")
    yield f"{number}: {'; '.join(parts)}"
    for one in found:
        if one.kinds:
            yield f"    {one.factor}, {one.walk}: {' '.join(one.kinds)}"


def numbers(file: Path, names: list[str]) -> Iterator[tuple[str, str, Any]]:
    """Sections, names and values of the file, of those that are asked for."""
    for section, named in entries(file).items():
        for name, entry in named.items():
            if not names or {section, f"{section}.{name}"} & {*names}:
                yield section, name, entry["value"]


def main() -> None:
    parser = command("tests.campaign.thresholds", __doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--file", type=Path, default=TRIAL)
    parser.add_argument("--details", action="store_true", help="kinds that are said, or no more")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("names", nargs="*", metavar="NUMBER", help="SECTION or SECTION.NAME")
    given = parser.parse_args()
    of_walk = partial(changes, given.data, given.file, given.names)
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        found = [one for some in pool.map(of_walk, walks(given.data)) for one in some]
    for section, name, _ in numbers(given.file, given.names):
        number = f"{section}.{name}"
        first, *details = lines(number, [one for one in found if one.number == number])
        print("\n".join((first, *details) if given.details else (first,)))


if __name__ == "__main__":
    main()
