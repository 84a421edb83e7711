"""Cropping real recordings at heel strikes changes no gait cycle that is left."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Settings
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality, free_of
from tests.hbm.motions import without
from tests.pipeline import lab
from tests.pipeline.settling import LIMIT, cycle_change
from tests.recordings.recorded import processed, recorded, steps, treadmill


@pytest.mark.parametrize("method", ["zero_phase", "realtime"])
def test_cropping_treadmill_walking_at_heel_strikes_changes_no_cycle(shared_data, method):
    """What is left at the ends differs by up to 100 N, and does not count."""
    recording, known = recorded(treadmill, shared_data)
    whole, settings = processed(treadmill, shared_data, filter=method), Settings(filter=method)
    cycles = 0
    for first, part in lab.cropped_at_strikes(recording, recording.events, count=2):
        result = process_recording(part, settings=settings, static=recording, **known)
        change = cycle_change(result, whole, first)
        cycles += len(change)
        assert (change < LIMIT).all()
        kept = slice(first, first + len(part.markers.time))
        difference = np.abs(result.measured.residual - whole.measured.residual[kept])
        assert np.nanmax(difference) > 20
        assert difference[result.counts].max() < 1
    assert cycles >= 12


def test_cropping_a_descent_of_steps_changes_no_cycle_that_is_left(shared_data):
    """Two gait cycles over plates: none is left out for being near an end."""
    trial, known = recorded(steps, shared_data)
    whole = processed(steps, shared_data)
    assert sum(map(len, whole.cycles.values())) == 2
    frames = len(trial.markers.time)
    for first, last in ((0, frames - 20), (20, frames - 1)):
        part = lab.cropped(trial, first, last)
        result = process_recording(part, settings=Settings(), **known)
        assert (cycle_change(result, whole, first) < LIMIT).all()


LEG = ("RHEE", "RMT2", "RMT5", "RLM", "RMM", "RLSHA", "RLEK", "RMEK", "RLTHI")
PELVIS = ("LASIS", "RASIS", "LPSIS", "RPSIS")


@pytest.mark.parametrize(
    ("lost", "first", "frames"), [(LEG, 500, 1), (LEG[:5], 537, 40), (PELVIS, 537, 40)]
)
def test_what_the_loss_of_a_leg_a_foot_or_the_pelvis_does_to_residuals_counts_nowhere(
    shared_data, lost, first, frames
):
    """Where their markers vanish and return, the rest of the pose jumps: up to 100 N."""
    recording, known = recorded(treadmill, shared_data)
    complete = processed(treadmill, shared_data)
    markers = without(recording.markers, lost, slice(first, first + frames))
    torn = replace(recording, markers=markers)
    result = process_recording(torn, settings=Settings(), static=recording, **known)
    error = np.abs(result.measured.residual - complete.measured.residual)
    assert np.nanmax(error[first - 30 : first + frames + 30]) > 5
    assert (error[result.counts] < LIMIT).all()
    assert np.count_nonzero(~free_of(result.quality, Quality.SETTLING)) < frames + 80
