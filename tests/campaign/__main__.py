"""Attack the program: ``python -m tests.campaign [--short] [--seed N] [--only NAME]``.

The long form writes its table to docs/reliability.md. Ends with 1 where an attack was not survived.
"""

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hbm.kernels.native import kernels
from pipeline.run.one_trial import read_requested
from tests.campaign import files
from tests.campaign.environments import environments
from tests.campaign.formats import Format, make_formats, write_study
from tests.campaign.injection import injections
from tests.campaign.kills import kills, undisturbed
from tests.campaign.outcome import Attack
from tests.campaign.report import page, table
from tests.campaign.worker import carry_out

PAGE: Final = Path(__file__).resolve().parents[2] / "docs" / "reliability.md"


@dataclass(frozen=True, slots=True)
class Size:
    """How many attempts of each campaign."""

    mutations: int
    truncations: int
    commands: int
    bits: int
    kills: int
    environments: int
    injections: int


LONG: Final = Size(7000, 2500, 500, 1000, 100, 1000, 1000)
"""10,000 files; all environments and injections that there are."""
SHORT: Final = Size(240, 120, 14, 60, 2, 8, 8)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    parser.add_argument("--short", action="store_true", help="a choice, within two minutes")
    parser.add_argument("--seed", type=int, default=1, help="equal seeds make equal attacks")
    parser.add_argument("--only", default="", help="CAMPAIGN, CAMPAIGN/TARGET or all of a name")
    parser.add_argument("--workers", type=int, default=2, help="how many attempts at a time")
    given = parser.parse_args()
    start, done = time.monotonic(), []
    with tempfile.TemporaryDirectory(prefix="originals") as folder:
        size = SHORT if given.short else LONG
        chosen = attacks(Path(folder), size, given.seed, given.only)
        for attack, outcome in carry_out(chosen, given.seed, given.workers):
            done.append((attack, outcome))
            if given.only or not outcome.survived:
                print(f"{attack.name}: {outcome.kind}: {outcome.detail}", flush=True)
    seconds = time.monotonic() - start
    print("\n".join(["", *table(done), ""]))
    failed = sum(not outcome.survived for _, outcome in done)
    print(f"{len(done)} attempts in {seconds:.0f} s, seed {given.seed}: {failed} not survived")
    if not given.short and not given.only:
        PAGE.write_text(page(done, given.seed, seconds), encoding="utf-8")
        print(f"written: {PAGE}")
    return 1 if failed or not done else 0


def attacks(folder: Path, size: Size, seed: int, only: str) -> Iterator[Attack]:
    """Give the attacks of all campaigns whose name is, or begins with, what is wanted."""
    kernels()
    formats = make_formats(folder)
    wanted = f"{only}/" if only else ""
    for campaign in campaigns(folder, formats, size, seed, only):
        yield from (each for each in campaign if f"{each.name}/".startswith(wanted))


def campaigns(
    folder: Path, formats: list[Format], size: Size, seed: int, only: str
) -> Iterator[Iterator[Attack]]:
    yield files.mutations(formats, size.mutations)
    yield files.truncations(formats, size.truncations)
    yield files.bits(formats, size.bits)
    yield files.commands(formats, size.commands)
    c3d = next(each for each in formats if each.name == "C3D")
    assert c3d.request is not None
    request = c3d.request(c3d.file)
    study = write_study(folder / "run", folder, ("sub01", "sub02"))
    yield environments(request, study, size.environments, random.Random(seed))
    yield injections(c3d.file, folder / "static.c3d", read_requested(request), size.injections)
    if "kill/".startswith(only) or only.startswith("kill"):
        yield kills(undisturbed(study, folder / "undisturbed"), size.kills)


if __name__ == "__main__":
    sys.exit(main())
