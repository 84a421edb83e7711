"""What residuals of recordings are made of: halves predict each other, known causes are found."""

import numpy as np
import pytest

from pipeline.config.schema import Treadmill
from pipeline.explain.explain import explain_trial
from pipeline.explain.linearise import explained_part, left_by_filter, linearised, rms
from pipeline.trial.ground.laboratory import Laboratory
from tests.recordings.recorded import generated, overground, processed, recorded, treadmill
from tests.recordings.test_generated_walk import masses_of_model

STILL = Laboratory(Treadmill())
LINEAR_PROTOTYPE = [[11.8, 5.8, 13.9, 2.4, 3.3, 1.8], [9.5, 6.3, 13.6, 2.4, 3.1, 1.8]]
"""What 56 linear effects of the plates and the body, fitted to one half, left in the other."""
NOT_ITS_CAUSES = ("delay", "zero", "gain", "place", "skin")
"""Its plates are exact, and its markers rigid."""


def test_causes_found_in_half_of_the_cycles_hold_in_the_other(shared_data):
    """On every axis better than effects that are linear and know nothing of usual sizes."""
    walk, _ = recorded(treadmill, shared_data)
    part = explained_part(walk, STILL, processed(treadmill, shared_data))
    chain, middle = part.chain, len(part.series) // 2
    left, halves = left_by_filter(chain), (slice(middle), slice(middle, None))
    for own, other, limits in zip(halves, halves[::-1], LINEAR_PROTOTYPE, strict=True):
        _, effects, posterior = linearised(chain, part.causes, left, part.series.some(own))
        without = chain.residual - left - np.tensordot(posterior.size, effects, 1)
        cycles = part.series.some(other).frames
        assert (rms(np.concatenate([without[each] for each in cycles])) < limits).all()


@pytest.fixture(scope="module")
def explained(shared_data):
    walk, _ = recorded(generated, shared_data)
    result = processed(generated, shared_data)
    return result.body, explain_trial(walk, STILL, result)


def test_no_cause_is_certain_that_a_generated_walk_does_not_have(explained):
    _, budget = explained
    certain = {cause.name: cause.group for cause in budget.causes if cause.is_certain}
    assert not set(certain.values()) & set(NOT_ITS_CAUSES), certain


@pytest.mark.parametrize("segment", ["foot", "thigh", "shank"])
def test_masses_of_a_generated_walk_are_found_by_how_much_they_are_wrong(
    explained, shared_data, segment
):
    body, budget = explained
    true = masses_of_model(shared_data / "truth_walk")[segment]
    wrong = body.segments[f"left_{segment}"].mass / true - 1
    name = {"foot": "feet"}.get(segment, f"{segment}s")
    found = next(cause for cause in budget.causes if cause.name == f"{name}: mass")
    assert abs(found.size - wrong) < 1.96 * found.deviation


def test_causes_found_in_half_of_the_frames_of_one_gait_cycle_hold_in_the_other(shared_data):
    """Of the vertical force and the moments; half a cycle of walking over two plates does not tell
    what the horizontal forces of the other half are made of."""
    walk, _ = recorded(overground, shared_data)
    budget = explain_trial(walk, STILL, processed(overground, shared_data))
    assert budget.cycles == 1
    assert (budget.held_out[2:] > 0.4).all()
