"""What do recordings say at half and at twice each number of judgement of a trial?

    python -m tests.campaign.thresholds [--data ../shared/data] [SECTION | SECTION.NAME …]

Of `pipeline/trial/thresholds.toml`, by default of all. Healthy real walks (a descent of steps with
plates that are not zeroed among them), and a virtual and a real walk with planted faults of plates,
are processed with one number changed, but for the body and its inverse kinematics. A recording that
then has other notes, findings, events, flags of frames, residuals or joints, or an error, says
something else. Prints a line for each number, and with --details what is said anew or no more.
"""

import tomllib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import pipeline.trial.process  # noqa: F401  reads every section
from hbm.numbers import read_numbers
from pipeline.trial.chain import Chain
from pipeline.trial.joints import joint_curves, joint_rows
from pipeline.trial.process import result_of
from pipeline.trial.residuals import residual_rows
from tests.campaign.planted_faults import faults
from tests.campaign.walks import opencap, real, virtual
from tests.tables import command

FILE = Path(__file__).resolve().parents[2] / "pipeline" / "trial" / "thresholds.toml"
FACTORS = {"half": 0.5, "twice": 2.0}
Statements = tuple[str, frozenset[str]]
"""All that a trial says, and the kinds of its warnings and findings."""


def statements(chain: Chain) -> Statements:
    """What a trial says; its inverse kinematics is solved once."""
    try:
        result = result_of(chain.changed(solved=chain.solved, body=chain.body))
    except (ArithmeticError, LookupError, ValueError) as error:
        return str(error), frozenset({type(error).__name__})
    joints = joint_rows(result, "", joint_curves(result))
    said = *map(str, result.notes), result.findings, result.events, result.shortage
    whole = repr((said, result.quality.tobytes(), residual_rows(result), joints))
    kinds = {note.code for note in result.notes if note.level == "warning"}
    return whole, frozenset(kinds | {finding.kind for finding in result.findings})


@cache
def trials(data: Path) -> tuple[dict[str, Chain], dict[str, Chain]]:
    """Healthy walks, and walks with planted faults: every third of a virtual and of a real one."""
    healthy = (*real(data), opencap(data))
    sound = {base.name: base.chain() for base in healthy}
    walks = (*virtual(1), *(base for base in healthy if base.name == "HC030A05"))
    planted = (
        (f"{base.name}, {fault}", fault.trial.chain())
        for base in walks
        for k, fault in enumerate(faults(base, None, 1))
        if k % 3 == 0
    )
    return sound, dict(planted)


@cache
def usual(data: Path) -> tuple[dict[str, Statements], ...]:
    """What is said with the numbers as they are."""
    return tuple({name: statements(c) for name, c in of.items()} for of in trials(data))


def scaled(value: Any, factor: float) -> Any:
    """The number, or each of several, times a factor; whole numbers stay whole."""
    if isinstance(value, dict):
        return {key: scaled(one, factor) for key, one in value.items()}
    if isinstance(value, list):
        return np.array([scaled(one, factor) for one in value])
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def line(data: Path, number: tuple[str, str, Any]) -> str:
    """Say in how many trials half and twice a number change what is said, and which kinds."""
    section, name, value = number
    numbers, parts, kinds = read_numbers("pipeline.trial", FILE.name, section), [], set[str]()
    before = usual(data)
    for words, factor in FACTORS.items():
        kept = getattr(numbers, name)
        setattr(numbers, name, scaled(value, factor))
        now = [{key: statements(chain) for key, chain in of.items()} for of in trials(data)]
        setattr(numbers, name, kept)
        counts = []
        for ours, theirs in zip(now, before, strict=True):
            changed = [key for key in ours if ours[key][0] != theirs[key][0]]
            counts.append(f"{len(changed)} of {len(ours)}")
            for key in changed:
                kinds |= {f"+{kind}" for kind in ours[key][1] - theirs[key][1]}
                kinds |= {f"-{kind}" for kind in theirs[key][1] - ours[key][1]}
        parts.append(f"{words} the value: {counts[0]} healthy, {counts[1]} faulty")
    return f"{section}.{name}: {', '.join(parts)}\t{' '.join(sorted(kinds))}"


def numbers(names: list[str]) -> Iterator[tuple[str, str, Any]]:
    """Sections, names and values of the file, of those that are asked for."""
    for section, entries in tomllib.loads(FILE.read_text(encoding="utf-8")).items():
        for name, entry in entries.items():
            if not names or {section, f"{section}.{name}"} & {*names}:
                yield section, name, entry["value"]


def main() -> None:
    parser = command("tests.campaign.thresholds", __doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--details", action="store_true", help="kinds that are said, or no more")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("names", nargs="*", metavar="NUMBER", help="SECTION or SECTION.NAME")
    given = parser.parse_args()
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        for text in pool.map(partial(line, given.data), numbers(given.names)):
            print(text if given.details else text.partition("\t")[0], flush=True)


if __name__ == "__main__":
    main()
