"""Outcomes as rows of two tables, one of sizes and one of shares, which grow trial by trial."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pandas as pd

from hbm.spatial import WRENCH_COMPONENTS
from tests.campaign.explain.faults import ALWAYS_THERE, KINDS
from tests.campaign.explain.trial import Outcome

SIZES: Final = "sizes.csv"
SHARES: Final = "shares.csv"
TOGETHER: Final = " + "


@dataclass(frozen=True, slots=True)
class Tables:
    """What a folder holds of a campaign.

    Attributes
    ----------
    folder
        Where it is.
    """

    folder: Path

    def read(self, name: str) -> pd.DataFrame:
        """Read a table; empty where there is none yet."""
        path = self.folder / name
        if not path.is_file():
            return pd.DataFrame({"trial": []}, dtype=str)
        return pd.read_csv(path, dtype={"trial": str})

    def done(self) -> set[str]:
        """Name the trials that are complete; forget what is known of others."""
        complete = set(self.read(SHARES).trial)
        sizes = self.read(SIZES)
        if not set(sizes.trial) <= complete:
            sizes[sizes.trial.isin(complete)].to_csv(self.folder / SIZES, index=False)
        return complete

    def add(self, outcome: Outcome) -> None:
        """Add a trial."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for name, rows in ((SIZES, size_rows(outcome)), (SHARES, share_rows(outcome))):
            path = self.folder / name
            rows.to_csv(path, mode="a", header=not path.is_file(), index=False)


def size_rows(outcome: Outcome) -> pd.DataFrame:
    """Give a row for every cause that has a true size."""
    plan = outcome.plan
    rows = [
        {
            "trial": plan.name,
            "where": plan.where,
            "seeded": TOGETHER.join(plan.faults),
            "prior": prior,
            "wrong": plan.wrong[0],
            "factor": plan.wrong[1],
            "cause": cause.name,
            "group": cause.group,
            "true": outcome.true[cause.name],
            "size": cause.size,
            "deviation": cause.deviation,
            "usual": cause.usual,
        }
        for prior, budget in outcome.budgets.items()
        for cause in budget.causes
        if cause.name in outcome.true
    ]
    return pd.DataFrame(rows)


def share_rows(outcome: Outcome) -> pd.DataFrame:
    """Give a row for every axis and every fault, group of causes, and what is not explained.

    Of a fault ``true`` is the share that it truly makes; of causes ``share`` is what is said.
    """
    plan, rows = outcome.plan, list[dict[str, object]]()
    present = {KINDS[name].group for name in plan.faults} | set(ALWAYS_THERE)
    for k, axis in enumerate(WRENCH_COMPONENTS):
        common = {"trial": plan.name, "where": plan.where, "axis": axis}
        for name, share in outcome.share.items():
            group = KINDS[name].group
            rows.append(common | {"seeded": name, "groups": group, "true": share[k]})
        for prior, budget in outcome.budgets.items():
            own = common | {"prior": prior, "rms": budget.rms[k], "held_out": budget.held_out[k]}
            for each in budget.groups:
                said = {
                    "groups": TOGETHER.join(each.groups),
                    "absent": present.isdisjoint(each.groups),
                    "share": each.share[k],
                    "deviation": each.deviation[k],
                }
                rows.append(own | said)
            rows.append(own | {"groups": "not explained", "share": budget.unexplained[k]})
    return pd.DataFrame(rows, columns=COLUMNS)


COLUMNS: Final[Sequence[str]] = (
    *("trial", "where", "axis", "seeded", "prior", "groups", "absent"),
    *("true", "share", "deviation", "rms", "held_out"),
)
