"""Soft tissue artefact has its published size and follows the joints."""

import numpy as np
import pytest

from hbm.coordinates import INDEX, N_Q
from pipeline.virtual_lab.faults import CameraFaults
from pipeline.virtual_lab.person.soft_tissue import ARTEFACTS, SKIN, displace_markers

STRIDE_FRAMES = 108


def strides(frames):
    """Give coordinates that swing with the gait cycle, each in its own way, (46, T)."""
    phase = 2 * np.pi * np.arange(frames) / STRIDE_FRAMES
    k = np.arange(N_Q)[:, None]
    return np.cos(phase + k) + 0.5 * np.cos(2 * phase + k**2)


def displacement(segment, frames, markers, seed, *, standing=False, scale=1.0):
    """Displace markers at the origin of a segment that does not rotate."""
    return displace_markers(
        np.zeros((frames, markers, 3)),
        (segment,) * markers,
        {segment: np.tile(np.eye(3), (frames, 1, 1))},
        strides(frames),
        np.zeros(frames) if standing else np.ones(frames),
        CameraFaults(skin_scale=scale),
        np.random.default_rng(seed),
        100.0,
    )


def rms(moved):
    return np.sqrt(np.mean(np.sum(moved**2, axis=2)))


@pytest.mark.parametrize("part", list(ARTEFACTS))
def test_the_skin_of_every_segment_moves_by_its_published_size_in_walking(part):
    size_m, _ = ARTEFACTS[part]
    segment = part if part in ("pelvis", "thorax", "head") else f"right_{part}"
    assert rms(displacement(segment, 4000, 6, seed=1)) == pytest.approx(size_m, rel=0.3)


def test_the_skin_does_not_move_in_standing():
    assert np.abs(displacement("right_thigh", 4000, 6, seed=1, standing=True)).max() == 0


def test_markers_of_a_segment_move_partly_together():
    moved = displacement("left_thigh", 6000, 3, seed=0)
    assert rms(moved) == pytest.approx(0.009, rel=0.25)
    together = np.corrcoef(moved[:, 0, 0], moved[:, 1, 0])[0, 1]
    assert 0.2 < abs(together) < 0.95


def test_the_artefact_follows_the_angles_of_the_joints_at_both_ends():
    moved = displacement("right_thigh", 6000, 1, seed=3)[:, 0]
    drivers = strides(6000)[[INDEX["R" + name] for name in ARTEFACTS["thigh"][1]]]
    fitted = drivers.T @ np.linalg.lstsq(drivers.T, moved)[0]
    explained = 1 - np.var(moved - fitted, axis=0).sum() / np.var(moved, axis=0).sum()
    assert explained == pytest.approx(SKIN.driven, abs=0.08)
