"""How near healthy recordings come to the thresholds from which on markers and bodies are named."""

import numpy as np
import pytest

from hbm.plausibility import labels
from hbm.plausibility.motion import large_marker_errors
from hbm.segments import LEGS_PER_STATURE
from hbm.signals.samples import medians_of_known
from tests.recordings.recorded import (
    child,
    generated,
    overground,
    processed,
    standing,
    steps,
    treadmill,
    two_plates,
)

RECORDINGS = (
    treadmill,
    steps,
    overground,
    generated,
    child("HC030"),
    child("HC031"),
    standing,
    two_plates,
)


@pytest.fixture(scope="module", params=RECORDINGS, ids=lambda read: read.__name__)
def trial(shared_data, request):
    return processed(request.param, shared_data)


def used(trial):
    """Positions of the body's markers, (K, 3, T), and their columns."""
    columns = [k for k, name in enumerate(trial.markers.names) if name in trial.body.markers]
    return np.moveaxis(trial.markers.position, 0, -1)[columns]


def test_left_markers_are_to_the_left(trial):
    landmark = trial.body.marker_set.present(trial.markers.names).landmark
    segment_of = trial.body.segment_of
    pairs = [
        (left, right)
        for name, left in landmark.items()
        if name.startswith("L") and (right := landmark.get(f"R{name[1:]}"))
        if not segment_of.get(left, "hand").endswith(labels.CROSSING_SEGMENTS)
    ]
    to_the_left = labels._to_the_left(trial.markers, landmark)
    along = (labels._between(trial.markers, pairs) * to_the_left).sum(axis=1)
    assert medians_of_known(along).min() > 0.005


def test_forward_is_known(trial):
    landmark = trial.body.marker_set.present(trial.markers.names).landmark
    front, back = ([landmark.get(side + name, "") for side in "LR"] for name in ("ASIS", "PSIS"))
    back = back if all(back) else 2 * [landmark.get("SACR", "")]
    forward = labels._between(trial.markers, [*zip(front, back, strict=True)]).mean(axis=0)
    assert np.nanmin(np.hypot(forward[0], forward[1])) > 0.12


def test_no_marker_jumps_against_its_motion_nor_stands_still(trial):
    paths = used(trial)
    expected = [labels._extrapolated(trial.markers.time, path) for path in paths]
    jump = np.nanmax(np.linalg.norm(paths - expected, axis=1))
    assert jump < (0.015 if trial.markers.rate_hz < 100 else 0.006)
    assert not labels.frozen_frames(trial.markers, trial.body.markers).any()


def test_distances_are_those_of_the_body(trial):
    body = trial.body
    pairs = [
        (a, b)
        for a in range(len(body.markers))
        for b in range(a)
        if body.marker_segment[a] == body.marker_segment[b]
    ]
    position = body.marker_position
    on_body = [np.linalg.norm(position[a] - position[b]) for a, b in pairs]
    names = [(body.markers[a], body.markers[b]) for a, b in pairs]
    assert np.nanmax(np.abs(labels.median_distances(trial.markers, names) - on_body)) < 0.021


def test_legs_are_as_long_as_each_other_and_fit_the_stature(trial):
    left_m, right_m = (
        sum(np.linalg.norm(trial.body.offsets[f"{side}_{s}"]) for s in ("shank", "foot"))
        for side in ("left", "right")
    )
    assert abs(left_m - right_m) < 0.014
    by_legs_m = (left_m + right_m) / 2 / LEGS_PER_STATURE
    assert -0.03 < trial.body.height_m / by_legs_m - 1 < 0.012


def test_markers_are_near_the_model_and_on_one_person(trial):
    error = trial.motion.marker_error
    usual = np.nanmedian(error, axis=0)
    assert np.nanmax(usual) < 0.029
    assert np.nanmax(error - 2 * usual) < 0.026
    paths = used(trial)
    paths = paths[..., np.isfinite(paths).any(axis=(0, 1))]
    assert np.nanmax(np.abs(paths - np.nanmedian(paths, axis=0))) < 1.2
    assert not large_marker_errors(trial.body, trial.motion)
