"""The campaign of seeded faults: what it counts, and that it can fail."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hbm.spatial import Array
from pipeline.explain.budget import Budget, EstimatedCause, GroupShare
from tests.campaign.explain import trial as campaign_trial
from tests.campaign.explain.faults import Seeded
from tests.campaign.explain.plate_faults import PlateFault
from tests.campaign.explain.rows import share_rows
from tests.campaign.explain.summary import absent, found, overall
from tests.campaign.explain.trial import Outcome, Plan, carried_out
from tests.campaign.explain.virtual_trial import VirtualLaboratory

HEAVY_ZERO = Seeded(
    plates=(PlateFault(zero=np.array([0, 0, 60.0, 0, 0, 0])), PlateFault()), late_s=0.002
)
PLAN = Plan(7, 1, "still", {"zero": HEAVY_ZERO}, ("zero_force", 3.0))


def budget(groups: dict[str, Array], size: float = 60.0, deviation: float = 1.0) -> Budget:
    cause = EstimatedCause(
        name="plate 1: zero of Fz",
        group="zero",
        unit="N",
        size=size,
        deviation=deviation,
        usual=3.0,
        chance=1.0,
        left=np.ones(6),
    )
    return Budget(
        source=Path("walk.c3d"),
        compensated=False,
        rms=np.ones(6),
        low=np.zeros(6),
        high=np.ones(6),
        cycles=4,
        found_cycles=4,
        groups=tuple(
            GroupShare(tuple(name.split(" + ")), share, np.full(6, 0.01))
            for name, share in groups.items()
        ),
        unexplained=1 - np.sum(list(groups.values()), axis=0),
        causes=(cause,),
        held_out=np.zeros(6),
        notes=(),
    )


def outcome(found: Budget, number: int = 1) -> Outcome:
    share = {"zero": np.array([0, 0, 0.9, 0, 0, 0])}
    plan = replace(PLAN, number=number)
    return Outcome(plan, {"plate 1: zero of Fz": 60.0}, share, {"as usual": found})


def test_a_fault_truly_makes_what_is_missing_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = budget({"zero": np.full(6, 0.5)})
    monkeypatch.setattr(campaign_trial, "explain_trial", lambda *_: found)
    done = carried_out(VirtualLaboratory(7), PLAN)
    assert done.true["plate 1: zero of Fz"] == pytest.approx(60.0)
    assert done.true["plates are late"] == pytest.approx(0.002)
    assert done.true["plate 2: zero of Fz"] == 0.0
    assert done.share["zero"][2] > 0.8
    assert done.budgets == {"as usual": found}


def test_intervals_that_are_too_narrow_do_not_hold() -> None:
    z = np.random.default_rng(0).standard_normal(4000)
    sizes = pd.DataFrame(
        {"group": "zero", "usual": 1.0, "deviation": 0.5, "true": 1.0}, range(4000)
    )
    for width, held in ((1.96, "95."), (0.98, "6")):
        line = next(overall(sizes.assign(held=np.abs(z) <= width), "usual"))
        assert line.startswith(f"usual: sizes of seeded faults of instruments: {held}")


@pytest.mark.parametrize(
    ("groups", "is_first"),
    [
        ({"zero": 0.8, "delay": 0.1}, True),
        ({"zero + place": 0.8, "delay": 0.1}, True),
        ({"zero": 0.3, "delay": 0.6}, False),
    ],
)
def test_the_right_group_is_first_or_not(groups: dict[str, float], is_first: bool) -> None:
    said = budget({name: np.full(6, share) for name, share in groups.items()})
    rows = share_rows(outcome(said))
    (fault,) = found(rows[rows.prior.isna()], rows[rows.prior.notna()]).itertuples()
    assert (fault.first, fault.instrument, fault.largest) == (is_first, True, True)


def test_an_absent_group_that_is_claimed_is_counted() -> None:
    rows = [
        share_rows(outcome(budget({"zero": np.full(6, 0.5), "delay": np.full(6, share)}), number))
        for number, share in enumerate((0.11, 0.09))
    ]
    above, surely = absent(pd.concat(rows))
    assert above.endswith("50.0 % of 2")
    assert surely.endswith("50.0 % of 2")
