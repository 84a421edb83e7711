"""Stated values of single segments are used, and the total mass stays the same."""

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import INDEX, MOVING, SEGMENTS, SIDES
from hbm.dynamics import inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.poses import segment_frames
from hbm.segments import Inertia, SegmentOverride, read_overrides
from tests.hbm.motions import swinging
from tests.synthetic import MASS_KG, T_POSE_MM, synthetic_body, synthetic_t_pose

TOML = """
[right_shank]   # a prosthesis below the knee
mass_kg = 1.9
center_m = [0.01, 0.0, -0.12]
inertia_kg_m2 = [0.012, 0.012, 0.002]

[left_foot]
mass_kg = 0.8

[left_foot.worn]   # a shoe
mass_kg = 0.3
center_m = [0.05, 0.0, -0.04]

[thorax.worn]   # a rucksack
mass_kg = 5.0
center_m = [-0.2, 0.0, 0.25]
inertia_kg_m2 = [0.1, 0.08, 0.06, 0.0, 0.01, 0.0]
"""


def built(overrides=None, **shoes):
    return build_body(
        synthetic_t_pose(), mass=MASS_KG, sex="male", height_m=1.78, overrides=overrides, **shoes
    )


@pytest.fixture(scope="module")
def changed():
    return built(read_overrides(TOML))


def test_stated_values_are_used(changed):
    shank = changed.segments["right_shank"]
    assert shank.mass == pytest.approx(1.9)
    np.testing.assert_allclose(shank.center, [0.01, 0, -0.12])
    np.testing.assert_allclose(shank.tensor, np.diag([0.012, 0.012, 0.002]))


def test_the_total_mass_stays_the_same(changed):
    assert sum(part.mass for part in changed.segments.values()) == pytest.approx(MASS_KG)


def test_other_segments_share_the_rest_in_the_table_s_proportions(changed):
    table = synthetic_body().segments
    others = [s for s in SEGMENTS if s not in ("right_shank", "left_foot", "thorax")]
    share = [changed.segments[s].mass / table[s].mass for s in others]
    np.testing.assert_allclose(share, share[0])
    for s in others:
        np.testing.assert_allclose(changed.segments[s].center, table[s].center)
        np.testing.assert_allclose(changed.segments[s].tensor, share[0] * table[s].tensor)


def test_what_is_worn_is_added_to_the_segment(changed):
    own = 0.8 / synthetic_body().segments["left_foot"].mass
    foot = synthetic_body().segments["left_foot"]
    bare = Inertia(0.8, foot.center, own * foot.tensor)
    shod = changed.segments["left_foot"]
    assert shod.mass == pytest.approx(1.1)
    np.testing.assert_allclose(
        shod.mass * shod.center, bare.mass * bare.center + 0.3 * np.array([0.05, 0, -0.04])
    )
    arm = np.array([0.05, 0, -0.04]) - bare.center
    reduced = bare.mass * 0.3 / 1.1
    expected = bare.tensor + reduced * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(shod.tensor, expected)


def test_six_numbers_include_the_products_of_inertia():
    worn = read_overrides(TOML)["thorax"].worn
    expected = [[0.1, 0, 0.01], [0, 0.08, 0], [0.01, 0, 0.06]]
    np.testing.assert_allclose(worn.tensor, expected)


def test_a_heavier_shank_raises_the_knee_moment_and_changes_no_geometry(changed):
    motion = swinging(np.random.default_rng(9))
    heavy = built({"right_shank": SegmentOverride(mass_kg=12.0)})
    before, after = (inverse_dynamics(b, motion, {}) for b in (synthetic_body(), heavy))
    knee = INDEX["RKneeFlexion"]
    assert np.abs(after.tau[:, knee]).max() > 1.5 * np.abs(before.tau[:, knee]).max()
    np.testing.assert_allclose(heavy.geometry, synthetic_body().geometry, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[rigth_shank]\nmass_kg = 1.0", "'rigth_shank', .*'right_shank'"),
        ("[head]\nmas_kg = 1.0", "head: .*'mas_kg', .*'mass_kg'"),
        ("[head]\nmass_kg = -4", "head: mass_kg .*-4"),
        (f"[head]\n{'.'.join('a' * 5000)} = 1", "TOML: .*nested"),
        ("[head]\ncenter_m = [0.0, 1.0, nan]", "head: center_m must be .* finite numbers"),
        ("[head]\ninertia_kg_m2 = [1.0, 1.0, 2.5]", "above the sum"),
        ("[head.worn]\nmass_kg = 1.0", "head: worn .*mass_kg and center_m"),
        ("[head.worn]\nmass_kg = 1.0\ncenter_m = [0, 0, 40]", "looks like millimetres"),
        ("[head]\nmass_kg = 1" + 400 * "0", "head: int too large"),
    ],
)
def test_faulty_overrides_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        read_overrides(text)


def test_overrides_that_leave_no_mass_for_other_segments_are_refused():
    with pytest.raises(ValueError, match=r"80\.00 kg.* 74\.6 kg"):
        built({"thorax": SegmentOverride(mass_kg=80.0)})


@pytest.mark.parametrize("sole_height_m", [0.0, 0.03])
def test_a_shoe_lies_under_the_middle_of_a_foot_that_stands(sole_height_m):
    """Bare, the feet of the T-pose would stand on the floor; a sole begins there."""
    q = solve_ik(synthetic_body(), synthetic_t_pose()).q[:1]
    rotation, origin = segment_frames(synthetic_body(), q)
    shod = built(shoe_mass_kg=0.3, sole_height_m=sole_height_m)
    for side, letter in SIDES.items():
        foot, k = f"{side}_foot", MOVING.index(f"{side}_foot")
        lighter = SegmentOverride(mass_kg=shod.segments[foot].mass - 0.3)
        shoe = shod.segments[foot] - built({foot: lighter}).segments[foot]
        heel, inner, outer = (np.array(T_POSE_MM[letter + n]) / 1000 for n in ("HEE", "MT2", "MT5"))
        middle = heel + 0.68 * ((inner + outer) / 2 - heel)
        place = origin[0, k] + rotation[0, k] @ shoe.center
        assert shoe.mass == pytest.approx(0.3)
        np.testing.assert_allclose(place[:2], middle[:2], atol=0.02)
        assert place[2] == pytest.approx(-sole_height_m / 2, abs=0.01)


def test_stated_shoes_leave_the_total_mass_and_the_geometry_as_they_are():
    shod, bare = built(shoe_mass_kg=0.4), built()
    assert sum(part.mass for part in shod.segments.values()) == pytest.approx(MASS_KG)
    share = 1 - 2 * 0.4 / MASS_KG
    for side in SIDES:
        foot = f"{side}_foot"
        assert shod.segments[foot].mass == pytest.approx(share * bare.segments[foot].mass + 0.4)
    for name, offset in bare.offsets.items():
        np.testing.assert_array_equal(shod.offsets[name], offset)


def test_a_prosthetic_foot_may_wear_a_stated_shoe_but_nothing_else():
    prosthesis = {"right_foot": SegmentOverride(mass_kg=0.6)}
    assert built(prosthesis, shoe_mass_kg=0.3).segments["right_foot"].mass == pytest.approx(0.9)
    with pytest.raises(ValueError, match=r"left_foot: .*shoe_mass_kg and worn"):
        built(read_overrides(TOML), shoe_mass_kg=0.3)


@pytest.mark.parametrize(
    ("overrides", "shoes", "noted"),
    [
        (None, {}, ["no_shoes"]),
        (None, {"shoe_mass_kg": 0.3}, ["shoes_stated"]),
        (None, {"shoe_mass_kg": 0.0}, []),
        (read_overrides(TOML), {}, []),
    ],
    ids=[
        "nothing is stated",
        "shoes are stated",
        "bare feet",
        "foot wears",
    ],
)
def test_a_body_says_whether_it_has_shoes(overrides, shoes, noted):
    notes = built(overrides, **shoes).notes
    assert [note.code for note in notes if "shoes" in note.code] == noted


def test_a_part_that_is_added_and_taken_away_again_leaves_what_was_there():
    whole, part = synthetic_body().segments["left_shank"], synthetic_body().segments["head"]
    again = whole + part - part
    assert again.mass == pytest.approx(whole.mass)
    np.testing.assert_allclose(again.center, whole.center, atol=1e-12)
    np.testing.assert_allclose(again.tensor, whole.tensor, atol=1e-12)
