"""Causes of the platform's pose are those of recordings and study files that have the fault."""

import numpy as np
import pytest

from compensation import PlatformPose, commanded_pose
from hbm.spatial import rotation_about
from pipeline.explain.causes.treadmill import platform_causes
from tests.pipeline import lab
from tests.pipeline.explain.moving_trial import (
    SETTLED,
    chain_of,
    laboratory,
    moved,
    moving_chain,
    with_pivot,
)


@pytest.fixture(name="chain")
def moving():
    return moving_chain()


def cause(chain, name):
    (found,) = [each for each in platform_causes(chain) if each.name == name]
    return found


def pose_of(chain, **commands):
    sway, pitch = commands.get("sway", 1.0), commands.get("pitch", 1.0)
    pivot = commands.get("pivot", lab.PIVOT_M)
    y = chain.platform.position[:, 1]
    return commanded_pose(sway * y, pitch * chain.platform.pitch, pivot)


def test_channels_that_are_late_leave_what_their_recording_leaves(chain):
    delay_s = 0.03
    late = chain_of(moved(command_delay_s=delay_s), laboratory())
    expected = (late.residual - chain.residual)[SETTLED]
    found = (cause(chain, "platform: late").change(chain, delay_s).residual - chain.residual)[
        SETTLED
    ]
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())


@pytest.mark.parametrize(("letter", "along"), [("x", 0), ("z", 2)])
def test_an_axis_of_pitch_stated_5_cm_off_leaves_what_the_study_leaves(chain, letter, along):
    expected = chain_of(moved(), with_pivot(0.05 * np.eye(3)[along])).residual
    found = cause(chain, f"platform: pivot along {letter}").change(chain, 0.05).residual
    assert np.abs(expected - chain.residual)[SETTLED].max() > 1.0
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_sway_that_is_a_tenth_too_large_is_that_of_a_larger_command(chain):
    found = cause(chain, "platform: size of sway").change(chain, 0.1).platform
    np.testing.assert_allclose(found.position, pose_of(chain, sway=1.1).position, atol=1e-9)
    np.testing.assert_allclose(found.rotation, chain.platform.rotation)


def test_a_pitch_that_is_a_tenth_too_large_turns_about_the_same_axis(chain):
    found = cause(chain, "platform: size of pitch").change(chain, 0.1).platform
    expected = pose_of(chain, pitch=1.1)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-9)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-9)


def test_a_zero_of_sway_moves_all_plates_to_the_left(chain):
    """Its moment is that of the ground reaction force, a distance to the side."""
    found = cause(chain, "platform: zero of sway").effect(chain)[SETTLED]
    force = chain.on_ground[SETTLED, :3]
    np.testing.assert_allclose(found[:, :3], 0, atol=1e-6)
    np.testing.assert_allclose(found[:, 3:], -np.cross([0, 1, 0], force), atol=1e-6)


def test_a_zero_of_pitch_turns_the_ground_reaction_force_of_a_level_platform(chain):
    still = PlatformPose(
        np.tile(np.eye(3), (len(chain.time), 1, 1)), np.zeros((len(chain.time), 3))
    )
    level = chain.changed(platform=still)
    found = cause(level, "platform: zero of pitch").change(level, 0.01)
    turned = level.on_ground[:, :3] @ rotation_about([0, 1, 0], 0.01).T
    np.testing.assert_allclose(found.on_ground[:, :3], turned, atol=1e-6)


def test_axes_turned_about_the_vertical_sway_forward_too(chain):
    found = cause(chain, "platform: direction about z").change(chain, 0.1).platform
    sway = chain.platform.position[:, 1]
    pitchless = np.abs(chain.platform.pitch) < 1e-3
    np.testing.assert_allclose(
        found.position[pitchless, 0], -np.sin(0.1) * sway[pitchless], atol=1e-3
    )
