"""Causes of the body change masses, centres and joints as bodies that differ do."""

from functools import cache

import numpy as np
import pytest

from hbm.body import build_body
from hbm.ik.tracking import solve_ik
from hbm.poses import center_of_mass, marker_positions
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.schema import Subject
from pipeline.explain.causes.body import JOINTS, body_causes
from tests.pipeline.explain.chains import chain_of
from tests.synthetic import MASS_KG, STATURE_M, synthetic_t_pose

TIME = np.arange(200) / 100
SWINGS = {"RHipFlexion": 0.4, "LHipFlexion": -0.4, "RKneeFlexion": 0.5, "PelvisYaw": 0.1}


@cache
def person(moves):
    """Someone who stands in the neutral pose, or swings the legs."""
    swings = {
        name: moves * size * np.sin(2 * np.pi * TIME + k)
        for k, (name, size) in enumerate(SWINGS.items())
    }
    return chain_of(TIME, swings)


@cache
def causes(moves):
    return {cause.name: cause for cause in body_causes(person(moves))}


def rms(wrench):
    return np.sqrt(np.mean(wrench**2))


def test_a_body_of_twice_the_mass_needs_twice_the_wrench():
    chain = person(moves=True)
    heavy = causes(moves=True)["body mass"].change(chain, 1.0)
    np.testing.assert_allclose(heavy.needed, 2 * chain.needed, atol=1e-9)
    assert heavy.body.mass == pytest.approx(2 * chain.body.mass)


def test_mass_of_a_part_is_taken_from_the_others():
    chain = person(moves=False)
    for name in ("pelvis", "trunk", "head", "thighs", "shanks", "feet", "arms"):
        other = causes(moves=False)[f"{name}: mass"].change(chain, 0.1)
        assert sum(part.mass for part in other.body.segments.values()) == pytest.approx(
            chain.body.mass
        )
        np.testing.assert_allclose(other.needed[100, 2], chain.needed[100, 2], atol=1e-6)


def test_shoes_that_the_body_lacks_are_those_that_a_body_with_stated_shoes_has():
    """At rest and in motion; the mass of shoes comes from all other segments in proportion."""
    markers, kwargs = synthetic_t_pose(), {"mass": MASS_KG, "sex": "male", "height_m": STATURE_M}
    shod = build_body(markers, shoe_mass_kg=0.3, **kwargs)
    for moves in (False, True):
        chain = person(moves).changed(body=shod)
        bare = causes(moves)["shoes: missing mass"].change(chain, 0.3)
        assert bare.body.mass == pytest.approx(MASS_KG)
        np.testing.assert_allclose(bare.needed, person(moves).needed, atol=1e-6)
        assert rms(chain.needed - bare.needed) > 0.05


def test_shoes_are_as_sure_as_their_mass_is_stated():
    sizes = [
        next(c.prior.size for c in body_causes(chain) if c.group == "shoes")
        for chain in (
            person(moves=False),
            person(moves=False).changed(subject=Subject(shoe_mass_kg=0.3)),
        )
    ]
    assert sizes[0] > 5 * sizes[1]


def test_mass_higher_up_raises_the_centre_of_mass():
    chain = person(moves=False)
    other = causes(moves=False)["head: mass"].change(chain, 0.1)
    q = np.zeros((1, 46))
    head = chain.body.segments["head"].mass
    before, after = (center_of_mass(body, q)[0, 2] for body in (chain.body, other.body))
    assert 0 < after - before < 0.1 * head / chain.body.mass * chain.body.height_m


def test_a_centre_of_mass_farther_ahead_needs_a_moment_that_pitches_back():
    chain = person(moves=False)
    effect = causes(moves=False)["trunk: centre of mass along x"].effect(chain)[100]
    mass = sum(chain.body.segments[name].mass for name in ("mid_trunk", "thorax"))
    np.testing.assert_allclose(effect[:3], 0, atol=1e-6)
    np.testing.assert_allclose(effect[3:], [0, -mass * GRAVITY_MPS2, 0], atol=1e-6)


def test_centres_of_a_pair_move_as_mirror_images():
    chain = person(moves=False)
    effect = causes(moves=False)["thighs: centre of mass along y"].effect(chain)[100]
    np.testing.assert_allclose(effect, 0, atol=1e-6)


def test_radii_of_gyration_matter_where_something_turns_and_change_no_force():
    name = "thighs: radii of gyration"
    at_rest, moving = (causes(moves)[name].effect(person(moves)) for moves in (False, True))
    np.testing.assert_allclose(at_rest[50:150], 0, atol=1e-6)
    np.testing.assert_allclose(moving[:, :3], 0, atol=1e-9)
    assert rms(moving[50:150, 4]) > 0.1


def test_markers_stay_where_they_are_when_a_joint_is_moved():
    chain, q = person(moves=False), np.zeros((1, 46))
    for name, cause in causes(moves=False).items():
        if cause.group == "markers":
            other = cause.change(chain, 0.01).body
            places = [marker_positions(body, q) for body in (chain.body, other)]
            np.testing.assert_allclose(*places, atol=1e-12, err_msg=name)


def test_a_moved_joint_moves_no_other_joint_and_long_bones_follow_it():
    chain = person(moves=False)
    bodies = chain.body, causes(moves=False)["right knee: centre along z"].change(chain, 0.01).body
    ankles = [body.offsets["right_shank"] + body.offsets["right_foot"] for body in bodies]
    np.testing.assert_allclose(*ankles)
    for segment, distal in (("right_thigh", "right_shank"), ("right_shank", "right_foot")):
        shares = [body.segments[segment].center[2] / body.offsets[distal][2] for body in bodies]
        assert shares[1] == pytest.approx(shares[0], abs=2e-3)


def test_a_moved_joint_of_a_person_at_rest_changes_no_force():
    chain = person(moves=False)
    for joint in JOINTS:
        for letter in "xyz":
            effect = causes(moves=False)[f"left {joint}: centre along {letter}"].effect(chain)
            np.testing.assert_allclose(effect[100, :3], 0, atol=0.01)


def test_coordinates_follow_a_moved_joint_but_for_what_its_square_adds():
    chain = person(moves=True)
    for name in (
        "right hip: centre along x",
        "right knee: centre along x",
        "right knee: axis about z",
    ):
        cause = causes(moves=True)[name]
        moved, missed = [], []
        for size in (cause.prior.size, cause.prior.size / 2):
            changed = cause.change(chain, size)
            q = solve_ik(changed.body, chain.markers).q
            moved.append(rms((q - chain.q)[50:150]))
            missed.append(rms((changed.q - q)[50:150]))
        assert missed[0] < 0.15 * moved[0], name
        assert missed[1] < 0.35 * missed[0], name


def test_effects_of_small_faults_add_up():
    chain = person(moves=True)
    own = [
        causes(moves=True)[name]
        for name in ("body mass", "right knee: centre along x", "feet: mass")
    ]
    changed, expected = chain, np.zeros_like(chain.residual)
    for cause in own:
        size = 0.1 * cause.prior.size
        changed = cause.change(changed, size)
        expected += size * cause.effect(chain)
    missed = changed.residual - chain.residual - expected
    assert rms(missed[50:150]) < 0.01 * rms(expected[50:150])
