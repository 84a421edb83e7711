"""The residual shows shoes that a simulated person wears, and stating them removes it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.explain.explain import explain_trial
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.person.subject import SHOE
from tests.campaign.explain.virtual_trial import recorded, walk_on

STILL = Laboratory(Treadmill())
FX, MY = 0, 4


@pytest.fixture(scope="module")
def shod():
    """A walk whose only fault is that the person wears shoes, and the person."""
    faults = Faults.none()
    body = faults.body.model_copy(update={"same_body": False, "shoe_scale": 1.0})
    treadmill = make_treadmill(faults, 3)
    walked = walk_on(treadmill, body, (3,), individuality=0.0)
    person = walked.walk.subject.person
    return recorded(walked, treadmill), {"sex": person.sex, "mass_kg": person.mass_kg}


def processed(recording, subject):
    result = process_recording(recording, subject, Settings())
    residual = result.measured.residual[result.counts]
    return result, np.sqrt(np.mean(residual**2, axis=0))


def test_stated_shoes_take_their_residual_away(shod):
    recording, person = shod
    _, without = processed(recording, Subject(**person))
    shod = Subject(**person, shoe_mass_kg=SHOE.mass, sole_height_m=SHOE.sole)
    _, stated = processed(recording, shod)
    assert (stated < without).all()
    for axis in (FX, MY):
        assert stated[axis] < 0.5 * without[axis]


def test_shoes_that_are_not_stated_are_estimated_with_what_they_make_of_the_residual(shod):
    recording, person = shod
    result, _ = processed(recording, Subject(**person))
    side, cycles = next(iter(result.cycles.items()))
    result = replace(result, cycles={side: cycles[:6]})
    budget = explain_trial(recording, STILL, result)
    (shoes,) = (cause for cause in budget.causes if cause.group == "shoes")
    half = 1.96 * shoes.deviation
    assert abs(shoes.size - SHOE.mass) < half < 1.96 * shoes.usual
    for axis in (FX, MY):
        assert shoes.left[axis] < 0.5 * budget.rms[axis]
