"""A study's trials together have the same numbers as alone, none lost and none twice."""

import shutil

import numpy as np
import pandas as pd
import pytest

from pipeline.run.load import collect
from pipeline.run.store import read_trial
from pipeline.trial.gait.cycles import normalise
from pipeline.trial.residuals import AXES, residual_table
from tests.pipeline import lab


@pytest.fixture(scope="module")
def gathered(finished):
    return collect(finished)


@pytest.fixture(scope="module")
def curves(finished, tmp_path_factory):
    folder = shutil.copytree(finished, tmp_path_factory.mktemp("curves") / "results")
    collect(folder, in_curves=lambda trial: trial.condition == "sway")
    return pd.read_parquet(folder / "cycles.parquet")


def test_residuals_of_every_trial_are_in_one_table(finished, gathered):
    assert len(gathered.residuals) == 2 * 3 * 2 * 6
    for path in (finished / "trials").glob("*.parquet"):
        trial = read_trial(path)
        rows = gathered.residuals[
            (gathered.residuals["subject"] == trial.subject.id)
            & (gathered.residuals["condition"] == trial.condition)
        ]
        expected = residual_table(trial, trial.condition)
        pd.testing.assert_frame_equal(rows.reset_index(drop=True), expected, check_like=True)


def test_curves_are_the_cycles_of_the_frames(finished, curves):
    path = finished / "trials" / "sub02_sway.parquet"
    trial, frames = read_trial(path, frames=False), pd.read_parquet(path)
    assert set(curves["condition"]) == {"sway"}  # the only trials that were wanted
    curves = curves[curves["subject"] == "sub02"]
    count = sum(len(spans) for spans in trial.cycles.values())
    assert len(curves) == count * 101 * 2 * 6
    for side, spans in trial.cycles.items():
        for compensated, name in ((False, "measured"), (True, "compensated")):
            for axis in AXES:
                values = frames[f"residual.{name}.{axis}"]
                expected = normalise(frames["time_s"], values, np.reshape(spans, (-1, 2)))
                chosen = (curves["side"] == side) & (curves["compensated"] == compensated)
                found = curves[chosen & (curves["axis"] == axis)]["value"]
                np.testing.assert_allclose(found, expected.ravel(), atol=1e-9)


def test_subjects_are_listed_once_with_measured_mass_and_stated_stature(gathered):
    people = gathered.subjects.set_index("subject")
    assert list(people.index) == [person.name for person in lab.PEOPLE]
    for person in lab.PEOPLE:
        row = people.loc[person.name]
        assert row["sex"] == person.sex
        assert row["age_years"] == person.age
        assert row["mass_kg"] == pytest.approx(person.mass_kg, rel=0.002)
        assert row["height_m"] == pytest.approx(person.height_m)


def test_a_folder_without_results_says_what_to_run(tmp_path):
    with pytest.raises(ValueError, match=r"no results of.*hbm run STUDY"):
        collect(tmp_path)
