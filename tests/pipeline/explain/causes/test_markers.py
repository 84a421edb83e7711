"""Causes of markers are those of markers that sit elsewhere, and of skin that carries them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hbm.coordinates import FIXED_TO, MOVING
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.poses import segment_frames
from hbm.signals.filtering import butterworth
from hbm.spatial import GRAVITY_MPS2, rotation_about
from pipeline.explain.cause import priors
from pipeline.explain.causes.markers import BELOW_TRUNK, HARMONICS, cycle_phase, marker_causes
from tests.hbm.motions import without
from tests.pipeline.explain.chains import chain_of

TIME = np.arange(300) / 100
SPANS = [(0.4, 1.4), (1.4, 2.4)]
SWINGS = {
    **{"PelvisZ": 0.02, "PelvisYaw": 0.1, "PelvisForwardPitch": 0.1, "TrunkFlexion": 0.1},
    **{"RHipFlexion": 0.4, "RKneeFlexion": 0.5, "LHipFlexion": 0.4, "LKneeFlexion": 0.5},
    **{"LHipAbduction": 0.1, "RShoulderFlexion": 0.3},
}


@cache
def walking(only=None):
    """A person who moves every segment, or one of whom only some segments have markers."""
    swings = {
        name: size * np.sin(2 * np.pi * (1 + k % 2) * TIME + k)
        for k, (name, size) in enumerate(SWINGS.items())
    }
    return chain_of(TIME, swings, only)


@cache
def causes(only=None):
    return {cause.name: cause for cause in marker_causes(walking(only), SPANS)}


def rms(wrench):
    return np.sqrt(np.mean(wrench**2))


def test_a_segment_goes_with_its_markers_where_no_other_markers_hold_it():
    chain = walking("pelvis")
    axes = segment_frames(chain.body, chain.q)[0][:, MOVING.index("pelvis")]
    for i, letter in enumerate("xyz"):
        moved = causes("pelvis")[f"pelvis: markers' place along {letter}"].change(chain, 0.01)
        np.testing.assert_allclose(moved.q[:, :3] - chain.q[:, :3], 0.01 * axes[:, :, i], atol=1e-6)
        np.testing.assert_allclose(moved.q[:, 3:], chain.q[:, 3:], atol=1e-6)


@pytest.mark.parametrize("segment", ["pelvis", "thorax", "right_shank"])
def test_a_body_built_with_displaced_markers_has_the_same_residual_the_other_way(segment):
    chain, size = walking(), 0.001
    for i, letter in enumerate("xyz"):
        cause = causes()[f"{segment.replace('_', ' ')}: markers' place along {letter}"]
        own = np.array([on == segment for on in chain.body.marker_segment])
        position = chain.body.marker_position - size * own[:, None] * np.eye(3)[i]
        body = replace(chain.body, marker_position=position)
        rebuilt = chain.changed(q=solve_ik(body, chain.markers).q)
        change, effect = rebuilt.residual - chain.residual, size * cause.effect(chain)
        assert rms(change - effect) < 0.02 * rms(change)


@pytest.mark.parametrize(
    "name",
    ["thorax: skin about z, sine 2 a cycle", "left thigh: skin along y, cosine 1 a cycle"],
)
def test_the_coordinates_are_those_of_the_displaced_markers(name):
    chain = walking()
    changed = causes()[name].change(chain, 0.001)
    again = solve_ik(chain.body, changed.markers).q
    assert rms(again - changed.q) < 0.01 * rms(again - chain.q)


@pytest.mark.parametrize(
    "name",
    [
        "pelvis: markers' place along x",
        "thorax: skin about z, cosine 1 a cycle",
    ],
)
def test_a_change_is_its_effect_times_its_size_the_more_so_the_smaller_it_is(name):
    chain, cause = walking(), causes()[name]
    effect = cause.effect(chain)

    def missed(size):
        change = cause.change(chain, size).residual - chain.residual
        return rms(change - size * effect) / rms(change)

    usual = cause.prior.size
    assert missed(usual) < 0.05
    assert missed(usual / 10) < 0.11 * missed(usual)


def test_skin_that_rises_and_falls_is_felt_as_the_weight_it_accelerates():
    chain = walking("pelvis")
    frequency = HARMONICS * 1.0
    rising = causes("pelvis")[f"pelvis: skin along z, sine {HARMONICS} a cycle"].effect(chain)
    wave = np.sin(2 * np.pi * frequency * (TIME - SPANS[0][0]))
    upright = segment_frames(chain.body, chain.q)[0][:, MOVING.index("pelvis"), 2, 2]
    acceleration = butterworth(wave * upright, TIME, 6.0, chain.settings.filter).acceleration
    np.testing.assert_allclose(
        rising[50:-50, 2], chain.body.mass * acceleration[50:-50], rtol=1e-3, atol=1.0
    )


def test_skin_has_no_mean_over_the_cycles_and_every_harmonic_its_own_course():
    skin = [c for c in causes().values() if c.name.startswith("pelvis: skin along x")]
    (first, _), (_, last) = SPANS
    inside = (first <= TIME) & (last > TIME)
    chain = walking()
    at_skin = chain.markers.names.index("LASIS")
    moved = [cause.change(chain, 1.0).markers.position[:, at_skin] for cause in skin]
    axis = segment_frames(chain.body, chain.q)[0][:, MOVING.index("pelvis"), :, 0]
    shown = [(each - chain.markers.position[:, at_skin]) * axis for each in moved]
    courses = np.array([each.sum(axis=1)[inside] for each in shown])
    assert len(courses) == 2 * HARMONICS
    np.testing.assert_allclose(courses.mean(axis=1), 0, atol=1e-9)
    products = courses @ courses.T / inside.sum()
    np.testing.assert_allclose(products, np.eye(len(courses)) / 2, atol=1e-9)


def test_the_phase_is_whole_at_every_start_and_goes_on_where_there_are_no_cycles():
    spans = [(1.0, 2.0), (2.0, 3.2), (5.2, 6.2)]  # two cycles of 1 s are missing
    at = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.6, 3.2, 4.2, 5.2, 6.2, 7.2, 7.7])
    expected = [-1, -0.5, 0, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 6.5]
    np.testing.assert_allclose(cycle_phase(at, spans), expected, atol=1e-12)


def test_an_arm_that_hangs_forward_unseen_pitches_the_body_by_its_weight():
    chain = walking("pelvis")
    effect = causes("pelvis")["left arm without markers: flexion"].effect(chain)
    parts = [f"left_{name}" for name in ("upper_arm", "forearm", "hand")]
    own = [MOVING.index(name) for name in parts]
    rotation, origin = (each[:, own] for each in segment_frames(chain.body, chain.filtered.value))
    masses = np.array([chain.body.segments[name].mass for name in parts])
    centers = np.array([chain.body.segments[name].center for name in parts])
    lever = origin + np.einsum("tsij,sj->tsi", rotation, centers) - origin[:, :1]
    forward = (masses @ lever)[:, 2]  # per radian, what hangs below the shoulder goes forward
    measured = effect[50:-50, 4].mean()
    assert measured == pytest.approx(GRAVITY_MPS2 * forward[50:-50].mean(), rel=0.1)


def test_an_unseen_lean_pitches_the_body_by_the_weight_above_the_lumbar_joint():
    chain = walking("pelvis")
    effect = causes("pelvis")["trunk without markers: lean"].effect(chain)
    parts = [name for name in chain.body.segments if name not in BELOW_TRUNK]
    own = [MOVING.index(FIXED_TO.get(name, name)) for name in parts]
    rotation, origin = (each[:, own] for each in segment_frames(chain.body, chain.filtered.value))
    masses = np.array([chain.body.segments[name].mass for name in parts])
    centers = np.array([chain.body.segments[name].center for name in parts])
    above = origin + np.einsum("tsij,sj->tsi", rotation, centers)
    joint = segment_frames(chain.body, chain.filtered.value)[1][:, MOVING.index("thorax")]
    forward = (masses @ (above - joint[:, None]))[:, 2]  # per radian, what is above goes forward
    expected = -GRAVITY_MPS2 * forward[50:-50].mean()  # the ground has to hold it back
    assert effect[50:-50, 4].mean() == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(("name", "axis"), [("bend", 0), ("lean", 1), ("twist", 2)])
def test_an_unseen_trunk_turns_in_the_lab_while_the_pelvis_below_it_stays(name, axis):
    chain = walking("pelvis")
    moved = causes("pelvis")[f"trunk without markers: {name}"].change(chain, 0.01)
    before, after = (segment_frames(chain.body, q)[0] for q in (chain.q, moved.q))
    pelvis, thorax = MOVING.index("pelvis"), MOVING.index("thorax")
    np.testing.assert_allclose(after[:, pelvis], before[:, pelvis])
    turn = before[:, thorax].transpose(0, 2, 1) @ after[:, thorax]
    expected = np.broadcast_to(rotation_about(np.eye(3)[axis], 0.01), turn.shape)
    np.testing.assert_allclose(turn, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("shown", "unseen"),
    [
        ("every segment", set()),
        ("pelvis and legs", {"trunk", "left arm", "right arm"}),
        ("and a hand", {"left arm"}),
        ("and the thorax", {"left arm", "right arm"}),
    ],
)
def test_what_is_unseen_is_what_no_marker_of_the_trial_moves_with(shown, unseen):
    segments = {
        "every segment": {*MOVING},
        "and a hand": {*BELOW_TRUNK, "right_hand"},
        "and the thorax": {*BELOW_TRUNK, "thorax"},
    }.get(shown, {*BELOW_TRUNK})
    chain = walking()
    on = dict(zip(chain.body.markers, chain.body.marker_segment, strict=True))
    kept = [k for k, name in enumerate(chain.markers.names) if on[name] in segments]
    names = tuple(chain.markers.names[k] for k in kept)
    fewer = chain.changed(markers=Markers(TIME, names, chain.markers.position[:, kept]))
    every = (cause.name.partition(" without markers") for cause in marker_causes(fewer, SPANS))
    assert {part for part, without, _ in every if without} == unseen


@pytest.mark.parametrize(
    ("name", "kind"), [("trunk without markers: lean", "unseen_lean"), ("arm", "unseen_arm")]
)
def test_harmonics_of_what_is_unseen_are_as_large_as_measured(name, kind):
    waves = [c for c in causes("pelvis").values() if name in c.name and "cosine" in c.name]
    sizes = [cause.prior.size for cause in waves if not cause.name.startswith("left")]
    assert sizes == list(priors()[kind].harmonics)


def test_a_gap_of_a_marker_stays_a_gap_and_the_others_still_tell():
    chain = walking()
    gappy = chain.changed(markers=without(chain.markers, ["LASIS"], slice(100, 110)))
    cause = next(marker_causes(gappy, SPANS))
    effect = cause.effect(gappy)
    assert np.isfinite(effect).all()
    assert np.isnan(cause.change(gappy, 0.001).markers.position).sum() == 30
