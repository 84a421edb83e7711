"""What a seeded fault truly makes is what is missing without it."""

import numpy as np
import pytest

from tests.campaign.explain import trial as campaign_trial
from tests.campaign.explain.faults import Seeded
from tests.campaign.explain.plate_faults import PlateFault
from tests.campaign.explain.trial import Plan, carried_out
from tests.campaign.explain.virtual_trial import VirtualLaboratory

HEAVY_ZERO = Seeded(
    plates=(PlateFault(zero=np.array([0, 0, 60.0, 0, 0, 0])), PlateFault()), late_s=0.002
)
PLAN = Plan(7, 1, "still", {"zero": HEAVY_ZERO}, ("zero_force", 3.0))


def test_a_fault_truly_makes_what_is_missing_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign_trial, "explain_trial", lambda *_: "explained")
    done = carried_out(VirtualLaboratory(7), PLAN)
    assert done.true["plate 1: zero of Fz"] == pytest.approx(60.0)
    assert done.true["plates delayed"] == pytest.approx(0.002)
    assert done.true["plate 2: zero of Fz"] == 0.0
    assert done.share["zero"][2] > 0.8
    assert done.budgets == {"as usual": "explained"}
