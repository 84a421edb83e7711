"""Trials with seeded faults: ``python -m tests.campaign.explain --trials N --seeds A B``.

Trials are spread over laboratories of the seeds from A to before B; their tables are in ``--out``.
Prints how often 95 % intervals of sizes hold, how often the group of a fault that makes a large
share of an axis is first, and how often groups that are absent are claimed.
"""

import argparse
import sys
from functools import cache
from multiprocessing import Pool
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import WRENCH_COMPONENTS
from pipeline.explain.budget import LIMITS
from pipeline.explain.cause import OF_PERSON
from tests.campaign.explain.faults import ALWAYS_THERE, KINDS
from tests.campaign.explain.trial import Outcome, Plan, carried_out, planned
from tests.campaign.explain.virtual_trial import VirtualLaboratory
from tests.tables import markdown

INSIDE: Final = 1.96
LARGE: Final = 0.2
"""Share of the mean square of an axis above which a cause should be found first."""
CLAIMED: Final = 0.1
"""Share above which a group of causes counts as claimed."""
NOTHING: Final = 0.02
"""Of a usual size: what is smaller counts as absent."""
PERSON: Final = "body and markers"


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


def size_rows(outcome: Outcome) -> pd.DataFrame:
    """Give a row for every cause that has a true size."""
    columns = ["name", "group", "size", "deviation", "usual"]
    parts = [
        pd.DataFrame([{c: getattr(cause, c) for c in columns} for cause in budget.causes]).assign(
            trial=outcome.plan.name,
            prior=prior if prior == "as usual" else f"one × {outcome.plan.wrong[1]:.2g}",
        )
        for prior, budget in outcome.budgets.items()
    ]
    rows = pd.concat(parts)
    return rows.assign(true=rows.name.map(outcome.true)).dropna(subset="true")


def coverage(sizes: pd.DataFrame) -> pd.DataFrame:
    """Give how often 95 % intervals of sizes hold, by prior and kind of cause."""
    of_person = sizes.group.isin(ALWAYS_THERE)
    kinds = {
        "absent": sizes.true.abs() <= NOTHING * sizes.usual,
        "of the body": of_person,
        "of instruments, told": sizes.deviation < LIMITS.deviation_of_fault * sizes.usual,
    }
    kind = np.select(list(kinds.values()), list(kinds), "of instruments, not told")
    held = 100.0 * ((sizes["size"] - sizes.true).abs() <= INSIDE * sizes.deviation)
    rows = sizes.assign(kind=kind, held=held).groupby(["prior", "kind"]).held
    return rows.agg(held="mean", count="size").reset_index()


def share_rows(outcome: Outcome) -> pd.DataFrame:
    """Give a row for every axis and group of causes that is named, as usual.

    ``true`` is the largest share that a seeded fault of the group truly makes, or that is left to
    the person; ``largest`` whether none makes more, ``rank`` the group's among those that are
    said.
    """
    seeded = [(KINDS[name].group, share) for name, share in outcome.share.items()]
    present = {group for group, _ in seeded} | set(ALWAYS_THERE)
    rows = []
    for k, axis in enumerate(WRENCH_COMPONENTS):
        makes: dict[str, float] = {}
        for group, share in seeded:
            makes[named(group)] = makes.get(named(group), 0.0) + share[k]
        makes[PERSON] = makes.get(PERSON, 0.0) + 1 - sum(makes.values())
        said = sorted(outcome.budgets["as usual"].groups, key=lambda g: -g.share[k])
        unsaid = set(makes) - {named(group) for each in said for group in each.groups}
        each_said = [(each.groups, each.share[k], each.deviation[k]) for each in said]
        each_said += [((group,), 0.0, 0.0) for group in sorted(unsaid)]
        for rank, (groups, share, deviation) in enumerate(each_said, start=1):
            own = {named(group) for group in groups}
            true = max(makes.get(group, 0.0) for group in own)
            rows.append(
                {
                    "trial": outcome.plan.name,
                    "axis": axis,
                    "groups": " + ".join(groups),
                    "absent": own.isdisjoint(makes) and present.isdisjoint(groups),
                    "instrument": PERSON not in own,
                    "share": share,
                    "surely": share > INSIDE * deviation,
                    "true": true,
                    "largest": true >= max(makes.values()),
                    "first": rank == 1,
                }
            )
    return pd.DataFrame(rows)


def named(group: str) -> str:
    """Give the group as which a group is named."""
    return PERSON if group in OF_PERSON else group


def found(shares: pd.DataFrame) -> str:
    """Say how often large causes are first, and absent ones claimed."""
    large = shares[shares.true >= LARGE]
    first = large.groupby(["instrument", "largest"])["first"].agg(first="mean", count="size")
    gone = shares[shares.absent]
    claims = gone.assign(above=gone.share > CLAIMED, surely=gone.surely & (gone.share > CLAIMED))
    each = claims.groupby(["trial", "groups"])[["above", "surely"]].any()
    return f"{markdown(first.reset_index())}\n\nabsent, but claimed: {each.mean().to_dict()}"


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
    with Pool(given.jobs) as pool:
        done = pool.map(of_plan, [planned(*one) for one in every], chunksize=each)
    outcomes = [one for one in done if isinstance(one, Outcome)]
    sizes, shares = (pd.concat(map(rows, outcomes)) for rows in (size_rows, share_rows))
    given.out.mkdir(parents=True, exist_ok=True)
    sizes.to_csv(given.out / "sizes.csv", index=False)
    shares.to_csv(given.out / "shares.csv", index=False)
    print(markdown(coverage(sizes)), found(shares), sep="\n\n")
    print(*(one for one in done if isinstance(one, str)), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
