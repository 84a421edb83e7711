"""Simulated subjects have the bodies, proportions and gait of people."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers, marker_sets
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.anatomy import Proportions, t_pose
from pipeline.virtual_lab.person.subject import SHOE, Person, make_subject
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS
from tests.validation.true_body import t_pose_markers, true_body

NAMES = tuple(marker_sets()["hbm2"].segment)


def test_the_nine_subjects_have_the_mean_and_sd_of_the_thesis():
    heights = np.array([p.height_m for p in PERSONS])
    masses = np.array([p.mass_kg for p in PERSONS])
    ages = np.array([p.age for p in PERSONS])
    assert [p.sex for p in PERSONS].count("male") == 6
    assert [p.sex for p in PERSONS].count("female") == 3
    assert (heights.mean(), heights.std(ddof=1)) == pytest.approx((1.78, 0.13), abs=0.005)
    assert (masses.mean(), masses.std(ddof=1)) == pytest.approx((74.6, 11.45), abs=0.05)
    assert (ages.mean(), ages.std(ddof=1)) == pytest.approx((26, 3.8), abs=0.05)


@pytest.mark.parametrize(("sex", "height_m"), [("female", 1.5), ("male", 2.0)])
def test_the_vertex_is_at_stature_and_the_heels_are_on_the_floor(sex, height_m):
    position = t_pose(NAMES, height_m, sex, Proportions(thigh=1.05, trunk=0.97))
    assert position[NAMES.index("THEAD"), 2] == pytest.approx(height_m)
    assert 0.02 < position[NAMES.index("LHEE"), 2] < 0.06


@pytest.mark.parametrize(("marker_set", "number"), [("hbm2", 0), ("hbm2", 8), ("hbm1", 4)])
def test_the_laboratory_s_own_body_is_the_one_that_the_production_builds_from_its_markers(
    marker_set, number
):
    """Of two separate statements of one model, with different people."""
    subject = make_subject(
        PERSONS[number],
        marker_set=marker_set,
        individuality=1.0,
        rng=np.random.default_rng(number),
    )
    person, skeleton = subject.person, subject.skeleton
    built = build_body(
        Markers(np.arange(3.0), skeleton.markers, t_pose_markers(subject)[None].repeat(3, axis=0)),
        mass=person.mass_kg,
        sex=person.sex,
        height_m=person.height_m,
        marker_set=marker_set,
    )
    true = true_body(subject)
    np.testing.assert_allclose(built.geometry, true.geometry, atol=1e-9)
    np.testing.assert_allclose(built.inertia_vector, true.inertia_vector, atol=1e-9)
    np.testing.assert_allclose(built.marker_position, true.marker_position, atol=1e-9)


def test_the_t_pose_has_the_joint_angles_that_the_production_finds():
    subject = make_subject(Person(), individuality=1.0, rng=np.random.default_rng(2))
    body = true_body(subject)
    markers = Markers(np.arange(2.0), body.markers, t_pose_markers(subject)[None].repeat(2, axis=0))
    np.testing.assert_allclose(solve_ik(body, markers).q[0], subject.t_pose, atol=1e-9)


VARIED = BodyFaults(same_body=True)


def test_a_varied_body_has_the_same_mass_and_the_same_markers_in_the_t_pose():
    plain = make_subject(Person(), rng=np.random.default_rng(5))
    for faults in (VARIED, BodyFaults(shoe_scale=0.0)):
        varied = make_subject(Person(), faults=faults, rng=np.random.default_rng(5))
        assert varied.skeleton.mass == pytest.approx(plain.skeleton.mass)
        np.testing.assert_allclose(t_pose_markers(varied), t_pose_markers(plain), atol=1e-9)
        offsets = (np.concatenate(list(w.skeleton.offsets.values())) for w in (varied, plain))
        assert np.abs(np.subtract(*offsets)).max() > 0.005


def test_hip_centres_vary_as_published():
    plain = make_subject(Person()).skeleton.offsets["right_thigh"]
    spread = [
        make_subject(Person(), faults=VARIED, rng=np.random.default_rng(seed)).skeleton.offsets[
            "right_thigh"
        ]
        - plain
        for seed in range(20)
    ]
    assert np.std(spread) == pytest.approx(0.008, rel=0.3)


def test_another_body_has_shoes_a_joint_in_the_mid_trunk_and_wobbling_masses():
    same, other = (make_subject(Person(), faults=f) for f in (Faults.none().body, BodyFaults()))
    heel = same.skeleton.markers.index("RHEE")
    higher = t_pose_markers(other)[heel, 2] - t_pose_markers(same)[heel, 2]
    assert higher == pytest.approx(SHOE.sole)
    assert not same.wobbling
    assert np.linalg.norm(same.skeleton.offsets["thorax"]) == 0
    assert other.wobbling
    assert 0.08 < np.linalg.norm(other.skeleton.offsets["thorax"]) < 0.25
    bare = make_subject(Person(), faults=BodyFaults(shoe_scale=0.0)).skeleton.inertias
    shod = other.skeleton.inertias
    lighter = 1 - 2 * SHOE.mass / Person().mass_kg
    assert shod["head"].mass / bare["head"].mass == pytest.approx(lighter)
