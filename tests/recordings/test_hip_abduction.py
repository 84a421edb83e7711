"""The hips of a real walk abduct more than Plug-in-Gait's by the pelvis' tilt and its width."""

import numpy as np
import pytest

from hbm.coordinates import INDEX, MOVING
from hbm.poses import segment_frames
from pipeline.config.schema import Settings
from pipeline.trial.process import process_recording
from tests.recordings.recorded import treadmill

SIDES = (("L", 1.0), ("R", -1.0))


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def walk(shared_data):
    """Positions of markers by their labels, and the same walk as processed."""
    recording, more = treadmill(shared_data)
    names, position = recording.markers.names, recording.markers.position
    markers = {name: position[:, k] for k, name in enumerate(names)}
    return markers, process_recording(recording, settings=Settings(), **more)


def pelvis(markers):
    """The pelvis' axes forward, left and up, by its four markers alone, and the middle of ASIS."""
    asis = (markers["LASIS"] + markers["RASIS"]) / 2
    psis = (markers["LPSIS"] + markers["RPSIS"]) / 2
    to_left = unit(markers["LASIS"] - markers["RASIS"])
    ahead = asis - psis
    ahead = unit(ahead - np.sum(ahead * to_left, 1, keepdims=True) * to_left)
    return np.stack([ahead, to_left, np.cross(ahead, to_left)], 2), asis, psis


def test_inverse_kinematics_tilts_the_pelvis_twice_as_much_as_its_markers(walk):
    """All markers count alike, and those of the legs, 22 of 26, turn the pelvis with them."""
    markers, result = walk
    by_markers = np.degrees(np.arcsin(pelvis(markers)[0][:, 2, 1]))
    frames = segment_frames(result.body, result.motion.q)[0][:, MOVING.index("pelvis")]
    by_model = np.degrees(np.arcsin(frames[:, 2, 1]))
    assert by_markers.std() == pytest.approx(1.9, abs=0.1)
    assert by_model.std() == pytest.approx(4.3, abs=0.1)


def test_by_pelvis_markers_and_narrower_hips_the_hips_adduct_by_five_degrees_less(walk):
    """The tilt of the pelvis gives 3 degrees of the excess, the width of the hips 2."""
    markers, result = walk
    axes, asis, psis = pelvis(markers)
    width = np.linalg.norm(markers["LASIS"] - markers["RASIS"], axis=1).mean()
    depth = np.linalg.norm(asis - psis, axis=1).mean()
    most_adducted = {}
    for side, outward in SIDES:
        # Harrington et al. 2007 by pelvic width alone: 79 mm from the middle, in place of 91 mm
        hip = (-0.24 * depth - 0.0099, outward * (0.33 * width + 0.0073), -0.30 * width - 0.0109)
        knee = (markers[f"{side}LEK"] + markers[f"{side}MEK"]) / 2
        thigh = np.einsum("tji,tj->ti", axes, knee - asis) - hip
        abduction = np.degrees(np.arctan2(outward * thigh[:, 1], np.hypot(*thigh[:, ::2].T)))
        by_model = np.degrees(result.motion.q[:, INDEX[f"{side}HipAbduction"]])
        most_adducted[side] = [np.percentile(angle, 2) for angle in (abduction, by_model)]
    assert most_adducted["L"] == pytest.approx([-6.9, -12.6], abs=0.2)
    assert most_adducted["R"] == pytest.approx([-8.8, -13.5], abs=0.2)
