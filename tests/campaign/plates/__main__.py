"""Plates with one known fault each: ``python -m tests.campaign.plates [--seeds N] [--workers N]``.

Writes its tables to docs/plates.md, after every seed.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from multiprocessing import Pool

import pandas as pd

from pipeline.io.write import markdown
from tests.campaign.pages import renew
from tests.campaign.plates.cases import (
    FAULTS,
    PERFECT,
    SIZES,
    STANDARD_STUDIES,
    PlateOutcome,
    carry_out,
    cases,
    faultless,
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.plates", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="of noise, for each fault and size")
    parser.add_argument("--workers", type=int, default=1, help="how many studies at a time")
    given = parser.parse_args()
    start, done = time.monotonic(), []
    with Pool(given.workers) as pool:
        studies = pool.imap(carry_out, faultless(PERFECT, STANDARD_STUDIES))
        perfect = [plate for study in studies for plate in study]
        for seed in range(given.seeds):
            done += [plate for study in pool.imap(carry_out, cases([seed])) for plate in study]
            minutes = (time.monotonic() - start) / 60
            used = f"--seeds {seed + 1}`, {minutes:.0f} minutes, {given.workers} at a time."
            text = f"`python -m tests.campaign.plates {used}\n\n{report(done, perfect)}"
            renew("plates.md", "campaign", text)
    return 0


def report(done: Sequence[PlateOutcome], perfect: Sequence[PlateOutcome]) -> str:
    """Give one row per fault and size, and what all plates have in common."""
    rows = [
        {
            "fault": fault.name,
            "of its limit": share,
            "found": count(alike, lambda one: one.found),
            "sized": shares([one.sized for one in alike]),
            "true verdict": alike[0].truth,
            "right": count(alike, right),
            "cannot be told": count(alike, untold),
        }
        for fault in FAULTS
        for share in SIZES
        if (alike := [o for o in done if (o.case.fault, o.case.share) == (fault.name, share)])
    ]
    bad = [one for one in done if one.truth != "fit"]
    lines = [
        markdown(pd.DataFrame(rows), digits=1),
        f"Within their 95 % intervals: {shares([one.sized for one in done])} sizes. Of the true "
        f"total errors, {shares([one.totals[1:] for one in done])} are below the upper bounds and "
        f"{shares([one.totals[::2] for one in done])} above the lower ones. Of plates that are not "
        f"fit as they are, {count(bad, lambda one: one.verdict == 'fit')} were called fit. "
        f"{count(done, lambda one: bool(one.invented))} plates have a fault found that they do not "
        "have.",
    ]
    for standard, words in ((False, "24 recordings"), (True, "the thesis' 72 recordings")):
        alike = [one for one in perfect if one.case.standard == standard]
        lines.append(
            f"Without a fault, {words}: {count(alike, right)} are fit, for "
            f"{count(alike, untold)} it cannot be told; {count(alike, lambda o: bool(o.invented))} "
            "have a fault that differs significantly from none."
        )
    return "\n\n".join(lines)


def right(one: PlateOutcome) -> bool:
    return one.verdict == one.truth


def untold(one: PlateOutcome) -> bool:
    return one.verdict == "cannot be told" and not right(one)


def count(outcomes: Sequence[PlateOutcome], wanted: Callable[[PlateOutcome], bool]) -> str:
    return f"{sum(map(wanted, outcomes))} of {len(outcomes)}"


def shares(pairs: Sequence[tuple[int, int]]) -> str:
    return f"{sum(n for n, _ in pairs)} of {sum(n for _, n in pairs)}"


if __name__ == "__main__":
    raise SystemExit(main())
