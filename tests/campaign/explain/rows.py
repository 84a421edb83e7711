"""Outcomes as rows of two tables, one of sizes and one of shares."""

from typing import Final

import pandas as pd

from hbm.spatial import WRENCH_COMPONENTS
from tests.campaign.explain.faults import ALWAYS_THERE, KINDS
from tests.campaign.explain.trial import Outcome

TOGETHER: Final = " + "


def size_rows(outcome: Outcome) -> pd.DataFrame:
    """Give a row for every cause that has a true size."""
    plan = outcome.plan
    rows = [
        {
            "trial": plan.name,
            "prior": prior,
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
    """Give a row for every axis and every fault and group of causes.

    Of a fault ``true`` is the share that it truly makes; of causes ``share`` is what is said.
    """
    plan, rows = outcome.plan, []
    present = {KINDS[name].group for name in plan.faults} | set(ALWAYS_THERE)
    for k, axis in enumerate(WRENCH_COMPONENTS):
        common = {"trial": plan.name, "axis": axis}
        for name, share in outcome.share.items():
            group = KINDS[name].group
            rows.append(common | {"groups": group, "true": share[k]})
        for prior, budget in outcome.budgets.items():
            own = common | {"prior": prior}
            for each in budget.groups:
                said = {
                    "groups": TOGETHER.join(each.groups),
                    "absent": present.isdisjoint(each.groups),
                    "share": each.share[k],
                    "deviation": each.deviation[k],
                }
                rows.append(own | said)
    return pd.DataFrame(rows)
