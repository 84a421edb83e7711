"""The campaign on static and dynamic models: its tables, its demands, and one laboratory."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.virtual_lab.protocol.ranking_study import BYSTANDERS
from tests.campaign.inertia_models.cases import BEST, MACHINES, Judged, judge
from tests.campaign.inertia_models.tables import grouped, table, unmet

LEFT = np.array([[3.0, 0, 4, 0, 0.6, 0.8], [0.3, 0, 0.4, 0, 0.06, 0.08]])


@pytest.fixture
def found():
    """Two laboratories, of which the dynamic model leaves a tenth."""
    return [
        Judged(seed, machine, *BEST, "dynamic", trial, LEFT, 0.1 * LEFT)
        for seed in (0, 1)
        for machine in MACHINES
        for trial in BYSTANDERS
    ]


def test_the_table_holds_norms_of_both_models(found):
    row = table(found, 0)[-1]
    assert row.count("5.0, 1.00 → 0.5, 0.10") == len(BYSTANDERS)
    assert row.endswith("| × 0.10 | 100 % |")
    assert "0.5, 0.10 → 0.1, 0.01" in table(found, 1)[-1]


def test_demands_are_on_the_model_that_is_taken_and_beyond_a_rigid_machine(found):
    assert unmet(found) == []
    worse = [replace(found[0], dynamic=1.2 * LEFT), *found[1:]]
    assert "up to 1.20 times" in unmet(worse)[0]
    not_taken = [replace(worse[0], chosen="static"), *worse[1:]]
    assert unmet(not_taken) == []
    rigid = [replace(one, static=0.1 * LEFT) if one.machine == "rigid" else one for one in worse]
    assert unmet(rigid)[1].startswith("default machine, sway: components up to 3.38 N")


@pytest.mark.slow
def test_equal_seeds_give_equal_numbers_and_a_third_sensor_with_people_beside_is_better():
    name = BEST[0]
    first, second = (judge(0, "soft", (name,), (2, 3)) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.dynamic, other.dynamic)
    running = grouped(first)
    two, three = (running["soft", name, n]["running"][0].static[0] for n in (2, 3))
    assert np.linalg.norm(three) < np.linalg.norm(two)
