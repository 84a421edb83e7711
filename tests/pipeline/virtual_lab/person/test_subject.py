"""Simulated subjects: bodies, proportions and gait."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.markers import Markers, marker_sets
from hbm.poses import marker_positions
from hbm.segments import SEXES
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person.anatomy import Proportions, t_pose
from pipeline.virtual_lab.person.subject import Person, make_subject
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS

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


@pytest.mark.parametrize("sex", SEXES)
@pytest.mark.parametrize("height_m", [1.5, 1.78, 2.0])
def test_the_vertex_is_at_stature_and_the_heels_are_on_the_floor(sex, height_m):
    position = t_pose(NAMES, height_m, sex, Proportions(thigh=1.05, trunk=0.97))
    assert position[NAMES.index("THEAD"), 2] == pytest.approx(height_m)
    assert 0.02 < position[NAMES.index("LHEE"), 2] < 0.06


def test_the_two_sides_mirror_each_other():
    position = t_pose(NAMES, 1.78, "female", Proportions(pelvis=1.1))
    for k, name in enumerate(NAMES):
        if name.startswith("R"):
            other = position[NAMES.index("L" + name[1:])]
            np.testing.assert_allclose(position[k] * [1, -1, 1], other)


def test_an_unknown_marker_is_refused_by_name():
    with pytest.raises(ValueError, match="no marker 'NOSE'"):
        t_pose(["NOSE"], 1.78, "male", Proportions())


@pytest.mark.parametrize("marker_set", ["hbm2", "hbm1"])
def test_without_faults_the_body_is_the_one_built_from_the_markers(marker_set):
    subject = make_subject(Person(), marker_set=marker_set, individuality=1.0)
    markers = marker_positions(subject.body, subject.t_pose[None].repeat(20, axis=0))
    built = build_body(
        Markers(np.arange(20) / 100, subject.body.markers, markers),
        mass=74.6,
        sex="male",
        height_m=1.78,
        marker_set=marker_set,
    )
    np.testing.assert_allclose(built.geometry, subject.body.geometry, atol=1e-9)
    np.testing.assert_allclose(built.inertia_vector, subject.body.inertia_vector, atol=1e-9)


def test_a_varied_body_has_the_same_mass_and_the_same_markers_in_the_t_pose():
    plain = make_subject(Person(), rng=np.random.default_rng(5))
    varied = make_subject(Person(), faults=BodyFaults(), rng=np.random.default_rng(5))
    total = [sum(part.mass for part in w.body.segments.values()) for w in (plain, varied)]
    assert total[1] == pytest.approx(total[0])
    q = plain.t_pose[None]
    np.testing.assert_allclose(
        marker_positions(varied.body, q), marker_positions(plain.body, q), atol=1e-9
    )
    assert np.abs(varied.body.geometry - plain.body.geometry).max() > 0.005
    heavier = [
        varied.body.segments[s].mass / part.mass - 1
        for s, part in plain.body.segments.items()
        if part.mass > 0.1
    ]
    assert 0.02 < np.std(heavier) < 0.12


def test_hip_centres_vary_as_published():
    spread = []
    for seed in range(20):
        subject = make_subject(Person(), faults=BodyFaults(), rng=np.random.default_rng(seed))
        plain = make_subject(Person(), rng=np.random.default_rng(seed))
        spread.append(subject.body.offsets["right_thigh"] - plain.body.offsets["right_thigh"])
    assert np.std(spread) == pytest.approx(0.008, rel=0.3)


def test_a_body_without_faults_is_unchanged():
    subject = make_subject(Person(), faults=Faults.none().body, rng=np.random.default_rng(3))
    plain = make_subject(Person(), rng=np.random.default_rng(3))
    np.testing.assert_array_equal(subject.body.geometry, plain.body.geometry)


def test_subjects_differ_and_are_reproducible():
    first, again, other = (
        make_subject(Person(), individuality=1.0, rng=np.random.default_rng(seed))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.body.geometry, again.body.geometry)
    assert np.abs(first.body.geometry - other.body.geometry).max() > 0.002
    assert first.step_parameters != other.step_parameters
