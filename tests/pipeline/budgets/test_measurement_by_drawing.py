"""Errors of measurement of a study are those of draws of every cause, shared where it is."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.budgets.explanation import explain
from pipeline.budgets.measurement import study_covariances
from pipeline.config.schema import TrialName
from pipeline.explain.cause import groups
from pipeline.explain.linearise import explained_part, left_by_filter, linearised
from pipeline.statistics.measurement import deviation, mean_covariance
from pipeline.trial.process import process_trial
from pipeline.trial.study_files import read_study_file

DRAWS = 3000
CONDITIONS = ("baseline", "pitch")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def trials(study, laboratory):
    """Recording, laboratory and result of two gait cycles each of two trials of a subject."""
    files = {name: study.subject("sub01").trials[name][0].file for name in CONDITIONS}
    found = {}
    for name, file in files.items():
        result = process_trial(study, "sub01", name)
        two = {side: cycles[:2] for side, cycles in result.cycles.items()}
        found[name] = read_study_file(study, file), laboratory, replace(result, cycles=two)
    return found


@pytest.fixture(scope="module")
def drawn(trials):
    """The RMS of each, compensated, with all causes of drawn sizes at once, (draws, 6)."""
    rng = np.random.default_rng(18)
    sizes: dict[object, np.ndarray] = {}
    found = {}
    for name, trial in trials.items():
        part = explained_part(*trial)
        chain, counts = part.chain, part.counts
        as_measured, *_ = linearised(part, left_by_filter(chain))
        square = np.zeros((DRAWS, 6))
        own = []
        for cause in part.causes:
            many = (DRAWS,) if cause.along is None else (DRAWS, len(cause.along))
            of = name if groups()[cause.group]["within"] == "trial" else ""
            key = (cause.name, of) if cause.along is None else many
            size = sizes.setdefault(key, rng.standard_normal(many))
            own.append(cause.prior.size * (size if cause.along is None else size @ cause.along))
        frames = np.flatnonzero(counts)
        for frame in frames:
            residual = chain.residual[frame] + np.transpose(own) @ as_measured[:, frame]
            square += residual**2 / len(frames)
        found[name] = np.sqrt(square)
    return found


@pytest.fixture(scope="module")
def covariances(trials):
    """The same by the delta method."""
    found = {TrialName("sub01", name, ""): explain(*trial) for name, trial in trials.items()}
    table = pd.DataFrame(list(found), columns=TrialName._fields).assign(
        compensated=False, axis="Fx", unit="N", window="cycle", n_cycles=1, n_frames=1
    )
    return study_covariances(found, table)[0]


def by_delta(covariances, cells, weights):
    return [
        deviation(mean_covariance(own, ["sub01"], cells), weights) for own in covariances.values()
    ]


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_value_is_as_sure_as_draws_say(drawn, covariances, condition):
    known = by_delta(covariances, [(condition, True)], [1.0])
    np.testing.assert_allclose(known, drawn[condition].std(axis=0), rtol=0.1)


def test_what_two_values_share_cancels_in_their_difference(drawn, covariances):
    known = by_delta(covariances, [(name, True) for name in CONDITIONS], [1.0, -1.0])
    expected = (drawn["baseline"] - drawn["pitch"]).std(axis=0)
    independent = np.hypot(*(values.std(axis=0) for values in drawn.values()))
    assert (expected < 0.75 * independent).all()
    np.testing.assert_allclose(known, expected, rtol=0.1)
