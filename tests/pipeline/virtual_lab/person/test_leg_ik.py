"""The legs' inverse kinematics puts the feet where they should be."""

import numpy as np
import pytest

from hbm.coordinates import INDEX
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.balance import JOINT_WEIGHTS, SoleTarget, solve_legs
from pipeline.virtual_lab.person.body import segment_poses
from pipeline.virtual_lab.person.subject import Person, make_subject

FRAMES = 40


@pytest.mark.parametrize("faults", [Faults.none().body, BodyFaults()])
def test_feet_reach_poses_that_the_legs_can_take(faults):
    """Poses made by known angles, from a start without them; the reference is the truth."""
    subject = make_subject(Person(), faults=faults, rng=np.random.default_rng(2))
    rng = np.random.default_rng(0)
    still = np.zeros(FRAMES)
    q = np.tile(subject.standing[:, None], FRAMES)
    legs = [INDEX[side + name] for side in "RL" for name in JOINT_WEIGHTS]
    q[legs] += rng.uniform(-0.2, 0.2, (len(legs), FRAMES))
    q[[INDEX["RKneeFlexion"], INDEX["LKneeFlexion"]]] += 0.4
    full = subject.extra_joints.extend(q, still, still)
    targets = {}
    for side, sole in subject.soles.items():
        ((rotation, ankle),) = segment_poses(subject.skeleton, full, [sole.segment])
        own, position = sole.from_foot(rotation, ankle)
        targets[side] = SoleTarget.of(sole, own, position, np.ones((FRAMES, 4)))
    start = q.copy()
    start[legs] += rng.uniform(-0.1, 0.1, (len(legs), FRAMES))
    found = solve_legs(subject, q, targets, start, (1.0, 15))
    np.testing.assert_allclose(found, q, atol=2e-4)
