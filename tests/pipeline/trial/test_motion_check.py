"""Limbs that markers lose for a while are named with the share of the body mass that they are."""

import numpy as np
import pytest

from hbm.ik.tracking import solve_ik
from pipeline.trial.checks import check_motion
from tests.hbm.motions import markers_of, swinging, with_noise, without
from tests.synthetic import synthetic_body

BODY = synthetic_body()
MARKERS = with_noise(
    markers_of(BODY, swinging(np.random.default_rng(30), degrees=20.0)),
    np.random.default_rng(31),
    0.002,
)
FRAMES = slice(10, 22)


def lost(*segments):
    """Names of the markers on some segments."""
    own = zip(BODY.markers, BODY.marker_segment, strict=True)
    return [name for name, segment in own if segment in segments]


def notes_of(markers):
    notes, _ = check_motion(BODY, solve_ik(BODY, markers), markers)
    return {note.code: note for note in notes}


def test_of_complete_markers_nothing_is_interpolated():
    assert "interpolated" not in notes_of(MARKERS)


@pytest.mark.parametrize(
    ("limb", "segments"),
    [
        ("left arm", ("left_upper_arm", "left_forearm", "left_hand")),
        ("head", ("head",)),
    ],
)
def test_a_limb_without_markers_is_named(limb, segments):
    note = notes_of(without(MARKERS, lost(*segments), FRAMES))["interpolated"]
    assert note.values["frames"] == {limb: 12}


def test_a_part_of_a_limb_is_named_by_its_coordinates():
    notes = notes_of(without(MARKERS, lost("left_hand"), FRAMES))
    assert notes["interpolated"].values["frames"] == {"LWristFlexion": 12, "LHandAbduction": 12}
