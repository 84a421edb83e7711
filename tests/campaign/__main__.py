"""Attack the program: ``python -m tests.campaign [--short] [--seed N] [--only NAME]``.

The long form writes its table to validation/reliability.md. Ends with 1 where an attack was
not survived.
"""

import platform
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hbm.kernels.native import kernels
from pipeline.cli.request import chain_of
from tests.campaign import files
from tests.campaign.environments import environments
from tests.campaign.injection import injections
from tests.campaign.kills import kills, undisturbed
from tests.campaign.outcome import KINDS, SURVIVED, Attack, Outcome
from tests.campaign.pages import renew
from tests.campaign.recordings import recordings, walk_in
from tests.campaign.results import results
from tests.campaign.study_files import study_files, write_study
from tests.campaign.worker import carry_out
from tests.tables import command, described


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
SHORT: Final = Size(150, 80, 8, 40, 2, 6, 6)
ATTACKS: Final = {
    "mutation": "files of every format with values that were changed",
    "truncation": "files that were cut off",
    "bit flip": "files with single wrong bits",
    "command": "damaged files given to commands in processes of their own",
    "environment": "commands in odd environments",
    "injection": "texts that want to get out, and values that are no numbers",
    "kill": "runs that are killed and taken up again",
}
PROGRAMS: Final = {
    ".hammer": "delays of plates by simulated hammers (7 min)",
    ".inertia_intervals": "how often intervals of compensated plates hold (30 min)",
    ".inertia_models": "static and dynamic models of a flexible treadmill (25 min)",
    ".calibration_signals": "which signal calibrates best (3 min)",
    ".inverse_kinematics": "our optimum beside SciPy's best of five starts (13 min)",
    ".legs_alone": "residuals without markers on trunk, head and arms (15 s)",
    ".thresholds_of_calibration": "the same as .thresholds, of calibrations and bodies (10 min)",
    ".plates": "plates with one known fault each, under known weights (30 min)",
    ".planted_faults": "plates with planted faults under walks (15 min)",
    ".healthy": "what healthy walks show of what plates are judged by (2 min)",
    ".thresholds": "what trials say at half and twice each number of judgement (2 h)",
    ".explain": "trials with seeded faults, explained (4 h)",
    ".explain.injected": "faults of any size put into recordings (3 h)",
    ".explain.unseen": "bands of residuals without upper markers (1 min)",
    ".live": "faults of live streams (90 min)",
}


def main() -> int:
    parser = command(
        "tests.campaign",
        __doc__,
        described("campaigns, for --only (30 min all)", ATTACKS),
        described("other campaigns, each with --help: python -m tests.campaign", PROGRAMS),
    )
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
                print(f"{attack.name}: {outcome}", flush=True)
    seconds = time.monotonic() - start
    failed = sum(not outcome.survived for _, outcome in done)
    print("", *table(done), "", sep="\n")
    print(f"{len(done)} attempts in {seconds:.0f} s, seed {given.seed}: {failed} not survived")
    if not given.short and not given.only:
        python = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
        summary = (
            f"`python -m tests.campaign --seed {given.seed}`, {python}: {len(done):,} attempts in "
            f"{seconds / 60:.0f} minutes, of which {failed:,} were not survived."
        )
        renew("reliability.md", "attempts", "\n".join([summary, "", *table(done)]))
    return 1 if failed or not done else 0


Done = Sequence[tuple[Attack, Outcome]]


def table(done: Done) -> list[str]:
    """Lay outcomes out as Markdown: a row per campaign and target, a column per kind."""
    counts = Counter((attack.campaign, attack.target, o.kind) for attack, o in done)
    kinds = [k for k in KINDS if k in SURVIVED or any(kind == k for *_, kind in counts)]
    rows = list(dict.fromkeys((attack.campaign, attack.target) for attack, _ in done))
    lines = [
        f"| campaign | of | attempts | {' | '.join(kinds)} |",
        f"|---|---|{'---:|' * (len(kinds) + 1)}",
    ]
    for row in rows:
        cells = [counts[*row, kind] for kind in kinds]
        lines.append(f"| {' | '.join(map(str, (*row, sum(cells), *cells)))} |")
    totals = [sum(counts[*row, kind] for row in rows) for kind in kinds]
    return [*lines, f"| all | | {' | '.join(map(str, (sum(totals), *totals)))} |"]


def attacks(folder: Path, size: Size, seed: int, only: str) -> Iterator[Attack]:
    """Give the attacks of all campaigns whose name is, or begins with, what is wanted."""
    kernels()
    beginning = f"{only}/" if only else ""
    for name, campaign in campaigns(folder, size, seed).items():
        if not only or only.split("/")[0] == name:
            yield from (each for each in campaign() if f"{each.name}/".startswith(beginning))


def campaigns(folder: Path, size: Size, seed: int) -> dict[str, Callable[[], Iterator[Attack]]]:
    """Write valid files of every format, and give what attacks them."""
    request = walk_in(folder)
    formats = [*recordings(folder), *study_files(folder), *results(folder, request)]
    study = write_study(folder / "run", folder, ("sub01", "sub02"))
    walk, chance = chain_of(request).inputs.recording, random.Random(seed)
    return {
        "mutation": lambda: files.mutations(formats, size.mutations),
        "truncation": lambda: files.truncations(formats, size.truncations),
        "bit flip": lambda: files.bits(formats, size.bits),
        "command": lambda: files.commands(formats, size.commands),
        "environment": lambda: environments(request, study, size.environments, chance),
        "injection": lambda: injections(request, walk, size.injections, chance),
        "kill": lambda: kills(undisturbed(study, folder / "undisturbed"), size.kills),
    }


if __name__ == "__main__":
    sys.exit(main())
