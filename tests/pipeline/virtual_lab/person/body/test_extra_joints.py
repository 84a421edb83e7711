"""Joints that the Human Body Model does not have move in walking as published."""

import numpy as np
import pytest

from hbm.coordinates import COORDINATES, INDEX
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.body import COLUMN, SPINE, segment_poses
from pipeline.virtual_lab.person.subject import Person, make_subject


def subject_of(**sizes):
    return make_subject(Person(), faults=BodyFaults(**sizes), rng=np.random.default_rng(1))


def extended(subject, q):
    frames = q.shape[1]
    return subject.extra_joints.extend(q, np.zeros(frames), np.zeros(frames))


def test_a_matching_person_has_none():
    subject = make_subject(Person(), faults=Faults.none().body)
    q = np.random.default_rng(0).normal(size=(len(COORDINATES), 20))
    full = extended(subject, q)
    assert np.abs(full[len(COORDINATES) :]).max() == 0
    np.testing.assert_array_equal(full[: len(COORDINATES)], q)


def test_lumbar_and_mid_trunk_joints_share_the_trunk_s_motion():
    subject = subject_of()
    q = np.tile(subject.t_pose[:, None], 2)
    q[INDEX["TrunkFlexion"], 1] += 0.2
    full = extended(subject, q)
    lumbar, middle = (np.diff(full[COLUMN[n]])[0] for n in ("TrunkFlexion", SPINE[0]))
    assert lumbar + middle == pytest.approx(0.2)
    assert 0.3 < middle / 0.2 < 0.55
    names = ["pelvis", "mid_trunk", "thorax"]
    turned = [
        np.degrees(np.arccos((np.trace(R[0].T @ R[1]) - 1) / 2))
        for R, _ in segment_poses(subject.skeleton, full, names)
    ]
    assert turned[0] == pytest.approx(0, abs=1e-6)
    assert turned[1] == pytest.approx(np.degrees(lumbar), rel=1e-6)
    assert turned[2] == pytest.approx(np.degrees(0.2), rel=0.02)


@pytest.mark.parametrize("letter", ["R", "L"])
def test_a_knee_translates_and_rotates_over_stance_as_published(letter):
    """Mean of people: 3.4 mm, 2.3° and 3.6° (Kefala et al. 2017)."""
    ranges = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        joints = make_subject(Person(), faults=BodyFaults(), rng=rng).extra_joints
        ranges.append(np.ptp(joints.of_knee(letter, np.radians([5.0, 22.0])), axis=1))
    forward, adduction, rotation = np.mean(ranges, axis=0)
    assert 1000 * forward == pytest.approx(3.4, abs=1.6)
    assert np.degrees(adduction) == pytest.approx(2.3, abs=1.5)
    assert np.degrees(rotation) == pytest.approx(3.6, abs=1.1)
