"""Errors of measurement of a study follow from the explanations of its trials."""

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.budgets.explanation import Explanation
from pipeline.budgets.measurement import study_covariances
from pipeline.config.schema import TrialName
from pipeline.explain.budget import Budget, RmsUncertainty
from pipeline.trial.residuals import AXES

NONE = np.full(6, np.nan)


def uncertainty(*draws, compensated=False):
    """With draws of the RMS, the same on all axes."""
    return RmsUncertainty(
        compensated=compensated,
        rms=NONE,
        draws=np.repeat(np.array(draws, float)[:, None], 6, axis=1),
    )


def explanation(*values, of_window=()):
    budget = Budget(
        source=Path("walk.c3d"),
        compensated=False,
        rms=NONE,
        low=NONE,
        high=NONE,
        cycles=5,
        found_cycles=5,
        groups=(),
        unexplained=NONE,
        causes=(),
        held_out=NONE,
        notes=(),
        uncertainty=values,
        of_window=of_window,
    )
    return Explanation("", budget, ())


def table(*trials, window="cycle"):
    """One row per trial, each of the same number of gait cycles."""
    names = pd.DataFrame(trials, columns=["subject", "condition", "recording"])
    row = {"compensated": False, "axis": "Fx", "unit": "N", "n_cycles": 20, "n_frames": 2000}
    return names.assign(window=window, **row)


TRIALS = (TrialName("s1", "baseline"), TrialName("s1", "sway"))


def covariance(first, second):
    """Of Mz of two trials of a subject."""
    found, _ = study_covariances(dict(zip(TRIALS, (first, second), strict=True)), table(*TRIALS))
    assert tuple(found) == AXES
    return found["Mz"].to_numpy()


def test_residuals_of_two_trials_vary_together_as_their_draws_do():
    first, second = (9.0, 11.0, 13.0, 7.0), (1.0, 4.0, 4.0, -1.0)
    found = covariance(explanation(uncertainty(*first)), explanation(uncertainty(*second)))
    np.testing.assert_allclose(found, np.cov(first, second))


def test_the_part_of_the_cycles_that_a_condition_asks_for_goes_before_whole_cycles():
    part = explanation(uncertainty(1.0, 3.0), of_window=(uncertainty(1.0, 11.0),))
    np.testing.assert_allclose(covariance(part, part), 50.0)


def test_a_part_of_the_cycles_is_not_taken_to_be_as_sure_as_whole_ones():
    residuals = table(TRIALS[0], window="motion")
    whole = {TRIALS[0]: explanation(uncertainty(1.0, 3.0))}
    assert study_covariances(whole, residuals)[0] is None
    part = {TRIALS[0]: explanation(uncertainty(1.0, 3.0), of_window=(uncertainty(1.0, 11.0),))}
    np.testing.assert_allclose(study_covariances(part, residuals)[0]["Fx"], 50.0)


def test_measured_and_compensated_plates_are_values_of_their_own():
    both = explanation(uncertainty(0.0, 2.0), uncertainty(0.0, 6.0, compensated=True))
    found = study_covariances({TRIALS[0]: both}, table(TRIALS[0]))[0]["Fx"]
    assert list(found) == [(*TRIALS[0][:2], False), (*TRIALS[0][:2], True)]
    np.testing.assert_allclose(found, [[2, 6], [6, 18]])


def test_a_trial_without_explanation_leaves_the_study_without_intervals_and_a_line_says_so():
    known = {TRIALS[0]: explanation(uncertainty(1.0, 2.0))}
    for explained in (known, {}):
        covariances, line = study_covariances(explained, table(*TRIALS))
        assert covariances is None
        assert "'hbm explain RESULTS'" in line
        assert ("1 of 2" in line) == bool(explained)
    assert study_covariances(known, table(TRIALS[0]))[1] == ""
