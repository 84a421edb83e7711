"""A stretch of a trial on a moving platform has the residual of the whole trial."""

import numpy as np

from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.explain.processing_chain import processing_chain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import PLATFORM_MARKERS_M, make_treadmill
from tests.campaign.explain.virtual_trial import recorded, walk_on

SWAYED = slice(1000, 1600)
"""The platform is not in neutral where it begins."""
SETTLED = slice(150, -150)


def test_a_stretch_of_a_trial_on_a_moving_platform_has_the_residual_of_the_whole() -> None:
    faults = Faults.none()
    treadmill = make_treadmill(faults, 4)
    walked = walk_on(treadmill, faults.body, (4,), moving=True, individuality=0.0)
    recording = recorded(walked, treadmill)
    moving = Laboratory(Treadmill(platform=Platform(markers=tuple(PLATFORM_MARKERS_M))))
    subject = Subject(sex=walked.walk.subject.person.sex, mass_kg=80.0)
    result = process_recording(recording, subject, Settings(), laboratory=moving)

    whole = processing_chain(recording, moving, result)
    part = processing_chain(recording, moving, result, SWAYED)
    assert part.pose is not None
    assert abs(part.pose.position[0, 1]) > 0.04
    np.testing.assert_allclose(part.residual[SETTLED], whole.residual[SWAYED][SETTLED], atol=1e-3)
