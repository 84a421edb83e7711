"""The table of outcomes, on the terminal and as a page of the documentation."""

import platform
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version
from typing import Final

from tests.campaign.outcome import MEANINGS, SURVIVED, Attack, Outcome

PACKAGES: Final = ("hbm-residuals", "numpy", "scipy", "pandas", "pyarrow", "pydantic", "pin")
MAX_LISTED: Final = 40
"""Attempts that are named below the table, of those not survived."""
Done = Sequence[tuple[Attack, Outcome]]


def table(done: Done) -> list[str]:
    """Lay outcomes out as Markdown: a row per campaign and target, a column per kind."""
    counts = Counter((attack.campaign, attack.target, o.kind) for attack, o in done)
    kinds = [k for k in MEANINGS if k in SURVIVED or any(kind == k for *_, kind in counts)]
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


def page(done: Done, arguments: str, seconds: float) -> str:
    """Write the page of the documentation."""
    failed = [(attack, outcome) for attack, outcome in done if not outcome.survived]
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    python = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    return "\n".join(
        [
            "# Reliability",
            "",
            "Damaged files, killed runs, odd environments, and texts that want to reach a terminal "
            "or a page: what became of each attempt, as measured by",
            "",
            "```sh",
            f"python -m tests.campaign {arguments}",
            "```",
            "",
            f"on {python} with {versions}: {len(done):,} attempts in {seconds / 60:.0f} minutes, "
            f"of which {len(failed):,} were not survived.",
            "",
            *table(done),
            "",
            "Files are small and valid at first: a simulated walk in every format, its study, its "
            "stored result. A mutation changes them in one of some twenty ways, a truncation ends "
            "them early, a bit flip changes one bit; each is read in a process of its own. What is "
            "accepted with other values is processed, and the residual RMS of every gait cycle "
            "compared: it may change by 1 N or 0.5 N·m without a note. *Command* is "
            "`hbm residuals` on mutated files. *Kill* ends `hbm run --jobs 2` at a random instant "
            "and runs it again: the results have to be those of an undisturbed run, byte by byte. "
            "*Environment* and *injection* run commands where something is odd, and on files that "
            "hold escape sequences, scripts, formulas, paths and names of people.",
            "",
            "| outcome | meaning |",
            "|---|---|",
            *(f"| {kind} | {meaning} |" for kind, meaning in MEANINGS.items()),
            "",
            "One attempt is repeated by its seed and name, such as `python -m tests.campaign "
            "--seed 1 --only mutation/C3D/17`; a short form of two minutes (`--short`) is "
            "part of the checks of every change.",
            *(["", "Not survived:", ""] if failed else []),
            *(f"- `{attack.name}`: {outcome.kind}" for attack, outcome in failed[:MAX_LISTED]),
            "",
        ]
    )
