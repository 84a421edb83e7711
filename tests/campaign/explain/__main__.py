"""Trials with seeded faults: ``python -m tests.campaign.explain --trials N --seeds A B``.

Trials are spread over laboratories of the seeds from A to before B. Tables grow in ``--out``, and
trials that are in them already are not repeated.
"""

import argparse
import sys
import time
from functools import cache
from multiprocessing import Pool
from pathlib import Path

from tests.campaign.explain.rows import Tables
from tests.campaign.explain.summary import summary
from tests.campaign.explain.trial import Outcome, Plan, carried_out, planned
from tests.campaign.explain.virtual_trial import VirtualLaboratory


@cache
def laboratory(seed: int) -> VirtualLaboratory:
    """Give a laboratory, which is calibrated once."""
    return VirtualLaboratory(seed)


def of_plan(plan: Plan) -> Outcome | str:
    """Carry a trial out; gives why where that is not possible."""
    try:
        return carried_out(laboratory(plan.laboratory), plan)
    except ValueError as error:
        return f"{plan.name}: {error}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.explain", description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 21), metavar=("A", "B"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("explain_campaign"))
    given = parser.parse_args()
    tables, start = Tables(given.out), time.monotonic()
    done, seeds = tables.done(), range(*given.seeds)
    each = -(-given.trials // len(seeds))
    every = [(seed, number) for seed in seeds for number in range(each)][: given.trials]
    plans = [planned(seed, number) for seed, number in every]
    plans = [plan for plan in plans if plan.name not in done]
    failed = []
    with Pool(given.jobs) as pool:
        for number, found in enumerate(pool.imap(of_plan, plans, chunksize=each), 1):
            if isinstance(found, str):
                failed.append(found)
            else:
                tables.add(found)
            seconds = time.monotonic() - start
            print(f"\r{number} of {len(plans)}, {seconds:.0f} s", end="", file=sys.stderr)
    print(file=sys.stderr)
    print(summary(tables))
    print(*failed, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
