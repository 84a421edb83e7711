"""Causes of real residuals predict the other half of a recording, and known ones are found."""

from functools import cache

import numpy as np
import pytest

from pipeline.budgets.explanation import explain
from pipeline.config.schema import Settings, Treadmill
from pipeline.explain.linearise import explained_part, left_by_filter, rms
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from tests.campaign.explain.unseen import row
from tests.campaign.walks import Base, known_with_legs_alone, with_legs_alone
from tests.recordings.recorded import (
    child,
    generated,
    overground,
    processed,
    recorded,
    treadmill,
    two_plates,
)
from tests.recordings.test_generated_walk import masses_of_model

STILL = Laboratory(Treadmill())
LATE = "plates delayed"
LINEAR_PROTOTYPE = [[11.8, 5.8, 13.9, 2.4, 3.3, 1.8], [9.5, 6.3, 13.6, 2.4, 3.1, 1.8]]
"""What 56 linear effects of the plates and the body, fitted to one half, left in the other."""
LEFT_BY_PROTOTYPE = np.sqrt(np.mean(np.square(LINEAR_PROTOTYPE), axis=0))
"""In both halves together, as the held-out part of a budget is of both."""
NOT_ITS_CAUSES = ("delay", "zero", "gain", "place", "skin")
"""Its plates are exact, and its markers rigid."""


@cache
def explained(read, folder, plate_delay_s=None):
    result = processed(read, folder, plate_delay_s=plate_delay_s)
    return explain(recorded(read, folder)[0], STILL, result)


def advice(delay_s):
    return f"set plate_delay_s = {delay_s:.3f} (--plate-delay-ms {1000 * delay_s:.0f})"


def advice_of_delay(explanation):
    """The line to state, of the sentence."""
    said = [own.action for own in explanation.mending if own.cause == LATE]
    return [action.partition("; ")[2].removesuffix(".") for action in said]


def test_causes_found_in_half_of_the_cycles_hold_in_the_other(shared_data):
    """On every axis better than effects that are linear and know nothing of usual sizes."""
    walk, _ = recorded(treadmill, shared_data)
    part = explained_part(walk, STILL, processed(treadmill, shared_data))
    frames = np.concatenate(part.series.frames)
    before = rms((part.chain.residual - left_by_filter(part.chain))[frames])
    left = before * np.sqrt(1 - explained(treadmill, shared_data).budget.held_out)
    assert (left < LEFT_BY_PROTOTYPE).all()


@pytest.mark.parametrize("read", [treadmill, overground])
def test_residuals_and_their_explanation_have_the_same_delay(shared_data, read):
    result = processed(read, shared_data)
    explanation = explained(read, shared_data)
    found = next(cause for cause in explanation.budget.causes if cause.name == LATE)
    assert found.size == pytest.approx(result.delay_s, abs=1e-6)
    assert 1.96 * found.deviation == pytest.approx(result.delay_uncertainty_s, rel=1e-3)
    wanted = advice(result.delay_s)
    certain = abs(result.delay_s) > result.delay_uncertainty_s
    assert advice_of_delay(explanation) == [wanted] * certain


def test_a_delay_is_stated_on_top_of_what_is_stated(shared_data):
    result = processed(generated, shared_data, plate_delay_s=-0.015)
    wanted = advice(result.delay_s - 0.015)
    assert advice_of_delay(explained(generated, shared_data, -0.015)) == [wanted]


@pytest.mark.parametrize("read", [treadmill, overground])
def test_residuals_are_explained_over_the_frames_in_which_they_count(shared_data, read):
    """The same gait cycles, and of each the same frames: so the same RMS."""
    result = processed(read, shared_data)
    budget = explained(read, shared_data).budget
    rows = [row for row in residual_table(result, "walk").itertuples() if row.headline]
    (cycles,) = result.cycles.values()
    assert budget.cycles == budget.found_cycles == len(cycles) > 0
    assert budget.rms == pytest.approx([row.rms for row in rows], rel=0.01)


def test_no_cause_is_certain_that_a_generated_walk_does_not_have(shared_data):
    budget = explained(generated, shared_data).budget
    certain = {cause.name: cause.group for cause in budget.causes if cause.is_certain}
    assert not set(certain.values()) & set(NOT_ITS_CAUSES), certain


@pytest.mark.parametrize("segment", ["foot", "thigh", "shank"])
def test_masses_of_a_generated_walk_are_found_by_how_much_they_are_wrong(shared_data, segment):
    body = processed(generated, shared_data).body
    true = masses_of_model(shared_data / "truth_walk")[segment]
    wrong = body.segments[f"left_{segment}"].mass / true - 1
    name = {"foot": "feet"}.get(segment, f"{segment}s")
    causes = explained(generated, shared_data).budget.causes
    found = next(cause for cause in causes if cause.name == f"{name}: mass")
    assert abs(found.size - wrong) < 1.96 * found.deviation


def test_causes_found_in_half_of_the_frames_of_one_gait_cycle_hold_in_the_other(shared_data):
    """Of the vertical force and the moments, about the vertical axis least; half a cycle of walking
    over two plates does not tell what the horizontal forces of the other half are made of."""
    budget = explained(overground, shared_data).budget
    assert budget.cycles == 1
    assert (budget.held_out[2:5] > 0.4).all()
    assert budget.held_out[5] > 0.3


@pytest.mark.slow
def test_missing_trunk_and_arms_change_residuals_by_about_as_much_as_their_causes(shared_data):
    """Walks of five laboratories; moments about the vertical are the smallest, and wrists count."""
    walks = [treadmill, overground, generated, child("HC030"), two_plates]
    found = [row(Base(read.__name__, *recorded(read, shared_data))) for read in walks]
    usual, truly = (
        np.sqrt(np.mean([own[f"changed, {how}"] for own in found], axis=0))
        for how in ("by the causes", "truly")
    )
    ratio = usual / truly
    assert ((ratio[:5] > 0.7) & (ratio[:5] < 1.3)).all()
    assert ratio[5] > 0.5
    holds = np.array([own["walks whose RMS holds, %"] for own in found])
    assert holds.mean() > 90, "the interval is of the residual that all markers show"


@pytest.mark.slow
def test_without_trunk_markers_the_trunk_explains_the_residual_and_no_plate_does(shared_data):
    base = Base("treadmill", *recorded(treadmill, shared_data))
    body = processed(treadmill, shared_data).body
    legs = with_legs_alone(base.recording, body)
    known = known_with_legs_alone(base.known, body)
    result = process_recording(legs, settings=Settings(), **known)
    explanation = explain(legs, STILL, result)
    share = {name: own.share for own in explanation.budget.groups for name in own.groups}
    assert share["unseen_trunk"][0] > 0.4
    assert share["unseen_trunk"][4] > 0.6
    (line,) = [line for line in explanation.lines() if line.startswith("Trunk without markers: ")]
    assert "C7, T10, sternum" in line
