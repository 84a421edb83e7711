"""Each fault adds to the residuals what ablation.csv states, and nothing where it cannot act."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.virtual_lab.protocol.walking_protocol import CONDITIONS, Setting
from tests.pipeline.virtual_lab import conftest
from tests.validation.ablation import SHORT, ablation

SMALL = Setting(
    protocol=conftest.SHORT.model_copy(
        update={"baseline_s": 5.0, "pitch_s": 10.0, "waits_s": (12.0,)}
    )
)
STORED = Path(__file__).parents[1] / "validation" / "ablation.csv"
ONE_EACH = (
    "zero phase, 30 Hz",
    "delay 10 ms",
    "delay 30 ms",
    "pivot error 5 cm",
    "no compensation, no other fault",
)


@pytest.fixture(scope="module")
def table():
    return ablation(SMALL, subjects=1, names=ONE_EACH)


def added(table, case, condition):
    own = table[(table["case"] == case) & (table["condition"] == condition)]
    return own.set_index("axis")["added"]


@pytest.mark.slow
@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_perfect_laboratory_adds_nothing(table, condition):
    own = table[(table["case"] == "zero phase, 30 Hz") & (table["condition"] == condition)]
    assert (own["added"] == 0).all()
    assert (own["rms"] < 0.5).all()


@pytest.mark.slow
@pytest.mark.parametrize("condition", CONDITIONS)
def test_what_a_delay_of_the_plates_adds_is_proportional_to_it(table, condition):
    """A small delay adds its duration times the rate of change of the load."""
    ratio = added(table, "delay 30 ms", condition) / added(table, "delay 10 ms", condition)
    np.testing.assert_allclose(ratio, 3, rtol=0.15)


@pytest.mark.slow
def test_faults_of_the_platform_add_nothing_where_it_does_not_move(table):
    assert added(table, "pivot error 5 cm", "baseline").max() < 1e-6
    assert added(table, "pivot error 5 cm", "pitch")["My"] > 2
    assert added(table, "no compensation, no other fault", "baseline").max() < 1e-6
    assert added(table, "no compensation, no other fault", "pitch")["Fx"] > 300
    assert added(table, "no compensation, no other fault", "sway")["Fy"] > 250


@pytest.mark.slow
def test_the_table_of_the_notebook_is_the_table_of_today():
    """One case of all three subjects in sway."""
    stored = pd.read_csv(STORED).set_index(["case", "condition", "axis"])
    sway = Setting(protocol=SHORT.model_copy(update={"conditions": ("sway",)}))
    found = ablation(sway, names=("1 accelerometer",)).set_index(["case", "condition", "axis"])
    np.testing.assert_allclose(found["added"], stored.loc[found.index, "added"], rtol=1e-3)
