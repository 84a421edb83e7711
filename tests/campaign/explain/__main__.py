"""Trials with seeded faults: ``python -m tests.campaign.explain --trials N --seeds A B``.

Trials are spread over laboratories of the seeds from A to before B; their tables are in ``--out``.
"""

import argparse
import sys
from functools import cache
from multiprocessing import Pool
from pathlib import Path

import pandas as pd

from tests.campaign.explain.rows import share_rows, size_rows
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
    seeds = range(*given.seeds)
    each = -(-given.trials // len(seeds))
    every = [(seed, number) for seed in seeds for number in range(each)][: given.trials]
    plans = [planned(seed, number) for seed, number in every]
    with Pool(given.jobs) as pool:
        found = pool.map(of_plan, plans, chunksize=each)
    outcomes = [one for one in found if isinstance(one, Outcome)]
    sizes, shares = (pd.concat(map(rows, outcomes)) for rows in (size_rows, share_rows))
    given.out.mkdir(parents=True, exist_ok=True)
    sizes.to_csv(given.out / "sizes.csv", index=False)
    shares.to_csv(given.out / "shares.csv", index=False)
    print(summary(sizes, shares))
    print(*(one for one in found if isinstance(one, str)), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
