"""Errors depend on the conditions that matter and no other; what was not tested is named."""

import re
from itertools import product

import numpy as np
import pandas as pd
import pytest

from pipeline.plate_accuracy.report import condition_effects

ZONES = ("back", "middle", "front")


def errors(seed=0, *, scatter=0.1, belts=("left", "right"), times=lambda row: 1.0):
    """Log-normal errors of a full design, each times what its conditions say."""
    rng = np.random.default_rng(seed)
    design = product(belts, ("sine", "square"), (0.3, 0.7, 1.0), (0.15, 0.35), (13.44, 45.08))
    rows = []
    for number, (belt, profile, speed, position, mass) in enumerate(design):
        row = {
            "file": f"weight_{number}.c3d",
            "belt": belt,
            "profile": profile,
            "speed_mps": speed,
            "position_m": position,
            "mass_kg": mass,
            "supports": True,
            "quantity": "COPx",
        }
        recording = np.exp(scatter * rng.normal())
        for zone in ("all", *ZONES):
            own = recording * np.exp(scatter / 2 * rng.normal())
            row["zone"] = zone
            rows.append({**row, "orthogonal": 0.002 * own * times(row)})
    return pd.DataFrame(rows)


def significant(found):
    tests, _, _ = found
    return set(tests[tests["p"] < 0.001]["effect"])


@pytest.mark.parametrize("factor", ["belt", "speed_mps", "mass_kg"])
def test_the_condition_that_errors_depend_on_is_found_and_no_other(factor):
    worse = {"belt": "right", "speed_mps": 0.3}
    level = worse.get(factor, 13.44)
    found = condition_effects(errors(times=lambda row: 1.5 if row[factor] == level else 1.0))
    assert significant(found) == {factor}


def test_a_back_of_the_belt_that_is_worse_differs_from_middle_and_front_only():
    """As in the thesis (III.A.2, Fig. 2)."""
    found = condition_effects(errors(times=lambda row: 1.3 if row["zone"] == "back" else 1.0))
    assert significant(found) == {"zone"}
    _, pairs, _ = found
    p = pairs[pairs["factor"] == "zone"].set_index(["first", "second"])["p_bonferroni"]
    assert p["back", "middle"] < 0.001
    assert p["back", "front"] < 0.001
    assert p["front", "middle"] > 0.05


def test_thirds_are_compared_within_recordings_however_different_these_are():
    """Recordings differ by ten times; a tenth between thirds would drown in that."""

    def times(row):
        return (1.1 if row["zone"] == "front" else 1.0) * (10 if row["speed_mps"] > 0.5 else 1)

    assert "zone" in significant(condition_effects(errors(scatter=0.05, times=times)))


def test_equal_thirds_differ_significantly_in_one_of_twenty():
    each = [errors(seed, belts=("left",)) for seed in range(8)]
    thirds = [condition_effects(data[data["zone"] != "all"])[0] for data in each]
    p = np.array([tests.set_index("effect")["p"]["zone"] for tests in thirds])
    assert np.sum(p < 0.05) <= 3  # 4 or more: one in 2,700
    assert 0.3 < np.mean(p) < 0.7


def test_what_cannot_be_tested_is_said():
    data = errors()
    together = data[(data["belt"] == "left") == (data["profile"] == "sine")]
    tests, _, remarks = condition_effects(together)
    assert any(re.match("COPx, whole .*not tested", remark) for remark in remarks)
    assert set(tests["effect"]) == {"zone"}
    tests, pairs, remarks = condition_effects(data.groupby("zone", sort=False).head(3))
    assert tests.empty
    assert pairs.empty
    assert [r.split(":")[0] for r in remarks] == ["whole recordings", "thirds of the belt"]


def test_with_supports_only_recordings_with_supports_are_tested():
    data = errors(times=lambda row: 1.5 if row["belt"] == "left" else 1.0)
    without = data.assign(supports=False, orthogonal=0.002, file=data["file"] + "b")
    both, _, _ = condition_effects(pd.concat([data, without]))
    pd.testing.assert_frame_equal(both, condition_effects(data)[0])
