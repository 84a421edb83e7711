"""What do recordings say at half and at twice each number of judgement?

    python -m tests.campaign.thresholds [--data ../shared/data] [SECTION | SECTION.NAME …]

Of `pipeline/trial/thresholds.toml`, by default of all its numbers. Healthy walks, real and
simulated, and walks with planted faults (`tests.campaign.threshold_walks`) are processed with one
number changed; of each, only the stages that read it, and those after them. One
that then has another mass, other notes, findings, events, flags of frames, residuals or joints, or
an error, says something else; one whose warnings, findings or errors are of other kinds judges
otherwise. Prints a line for each number: of the walks that read it, how many say something else and
judge otherwise, and with --details which kinds they say anew or no more.
"""

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from hbm.numbers import read_numbers
from pipeline.trial.chain import DEPENDS_ON, Chain, _all_of
from pipeline.trial.gait.spatiotemporal import spatiotemporal
from pipeline.trial.joints import joint_curves, joint_rows
from pipeline.trial.process import result_of
from pipeline.trial.residuals import residual_rows, threshold_rows
from tests.campaign.numbers import FACTORS, numbers, scaled
from tests.campaign.threshold_walks import Make, walks
from tests.tables import command

TRIAL = "pipeline.trial"
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


def watch() -> None:
    """Have it noted which numbers are read."""
    watched = {id(values): Numbers(name, values) for name, values in sections().items()}
    for module in [*sys.modules.values()]:
        for name, value in [*getattr(module, "__dict__", {}).items()]:
            if id(value) in watched and isinstance(value, SimpleNamespace):
                setattr(module, name, watched[id(value)])


def sections() -> dict[str, SimpleNamespace]:
    """All sections, as the package reads them."""
    names = dict.fromkeys(section for section, *_ in numbers(TRIAL, []))
    return {name: read_numbers(TRIAL, "thresholds.toml", name) for name in names}


class Changed(NamedTuple):
    """What a walk says with a number changed: whether anything else, and which kinds."""

    number: str
    factor: str
    walk: str
    is_healthy: bool
    says_else: bool
    kinds: tuple[str, ...]


def changes(data: Path, names: list[str], walk: str) -> list[Changed]:
    """Process one walk with half and twice each number that it reads."""
    watch()
    case, changed = walks(data)[walk], list[Changed]()
    of_walk = [
        number
        for number in numbers(TRIAL, names)
        if not case.sections or number[0] in case.sections
    ]
    if not of_walk:
        return []
    usual = Walk(case.make)
    for section, name, value in of_walk:
        values, number = sections()[section], f"{section}.{name}"
        if all(number not in read for read in usual.reads.values()):
            continue
        kept = getattr(values, name)
        for words, factor in FACTORS.items():
            setattr(values, name, scaled(value, factor))
            try:
                now = statements(usual.without(number))
            except REFUSALS as error:
                now = str(error), frozenset({type(error).__name__})
            before = usual.says
            kinds = (
                *(f"+{kind}" for kind in sorted(now[1] - before[1])),
                *(f"-{kind}" for kind in sorted(before[1] - now[1])),
            )
            is_other = now[0] != before[0]
            changed.append(Changed(number, words, walk, not case.sections, is_other, kinds))
        setattr(values, name, kept)
    return changed


def lines(number: str, changed: Sequence[Changed]) -> Iterator[str]:
    """Say in how many walks half and twice a number change what is said, and which kinds."""
    parts = list[str]()
    for factor in FACTORS:
        counts = []
        for words, is_healthy in {"healthy": True, "faulty": False}.items():
            of = [c for c in changed if (c.factor, c.is_healthy) == (factor, is_healthy)]
            other, judges = sum(c.says_else for c in of), sum(bool(c.kinds) for c in of)
            counts.append(f"{other} of {len(of)} {words} say else, {judges} judge otherwise")
        parts.append(f"{factor}: {', '.join(counts)}")
    yield f"{number}: {'; '.join(parts)}"
    for one in changed:
        if one.kinds:
            yield f"    {one.factor}, {one.walk}: {' '.join(one.kinds)}"


def main() -> None:
    parser = command("tests.campaign.thresholds", __doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--details", action="store_true", help="kinds that are said, or no more")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("names", nargs="*", metavar="NUMBER", help="SECTION or SECTION.NAME")
    given = parser.parse_args()
    of_walk = partial(changes, given.data, given.names)
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        changed = [one for some in pool.map(of_walk, walks(given.data)) for one in some]
    for section, name, _ in numbers(TRIAL, given.names):
        number = f"{section}.{name}"
        first, *details = lines(number, [one for one in changed if one.number == number])
        print("\n".join((first, *details) if given.details else (first,)))


if __name__ == "__main__":
    main()
