"""The uncertainty of compensated plates arrives in the lab, at the pelvis and in results."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.signals.filtering import low_pass
from hbm.spatial import rotation_about, transform_wrench
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.ground.wrenches import Spread, sum_deviation
from pipeline.trial.residuals import residual_table
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL, ground_of

ORIGIN = np.zeros(3)


@pytest.mark.parametrize("frames", [1, 4])
def test_the_deviation_of_a_sum_is_the_diagonal_of_its_covariance_about_the_point(frames):
    """Of two plates that stand still, and that move; in one frame the acceleration is unknown."""
    rng = np.random.default_rng(frames)
    axes = np.stack([rotation_about(np.array([0, 1, 0]), a) for a in rng.normal(size=frames)])
    spreads = [
        Spread(rng.uniform(1, 2, (4, 6)), rng.uniform(0, 1, 6), axes, rng.normal(size=(frames, 3)))
        for _ in range(2)
    ]
    spreads[1].sd[2] = np.nan
    factor = rng.normal(size=(12, 12))
    correlation, points = factor @ factor.T, rng.normal(size=(4, 3))
    found = sum_deviation(spreads, correlation, points)
    assert np.isnan(found).all(axis=1).tolist() == [False, False, True, False]
    for frame in (0, 1, 3):
        k = frame % frames
        maps = [
            transform_wrench(np.eye(6), s.rotation[k], s.center[k] - points[frame]).T
            for s in spreads
        ]
        moving = np.hstack([m * s.sd[frame] for m, s in zip(maps, spreads, strict=True)])
        zeros = np.hstack([m * s.zero for m, s in zip(maps, spreads, strict=True)])
        covariance = moving @ correlation @ moving.T + zeros @ zeros.T
        np.testing.assert_allclose(found[frame] ** 2, np.diag(covariance), rtol=1e-9)


def with_known_zeros(calibration):
    """The zeros of these plates do not change, and this calibration knows it."""
    plates = {
        name: replace(model, model_error=replace(model.model_error, zero=np.zeros(6)))
        for name, model in calibration.plates.items()
    }
    return replace(calibration, plates=plates)


@pytest.fixture(scope="module")
def laboratory(calibration):
    return Laboratory(TREADMILL, with_known_zeros(calibration))


def rms_by_stated(trial, wrench, stated):
    slow = low_pass(wrench, trial.markers.time, 6.0, "zero_phase")
    return np.sqrt(np.mean(slow[100:-100] ** 2, axis=0) / np.mean(stated**2, axis=0))


@pytest.mark.parametrize("motion", [lab.pitching(20.0), lab.shaken(20.0, seed=3)])
def test_what_compensation_leaves_of_an_empty_treadmill_is_as_uncertain_as_stated(
    laboratory, motion
):
    """The plates' own noise, so that the only error is the compensation's."""
    trial = lab.on_platform(lab.without_people(20.0), motion, seed=5)
    ground = ground_of(trial, laboratory, trial.markers.time, 0.0)
    each = zip(ground.variants["compensated"], ground.spreads, strict=True)
    for k, (wrench, spread) in enumerate(each):
        own = slice(6 * k, 6 * k + 6)
        stated = sum_deviation([spread], ground.correlation[own, own], ORIGIN)
        ratio = rms_by_stated(trial, wrench, stated)
        assert (ratio > 0.6).all()
        assert (ratio < 1.4).all()


def noisy(seed, duration_s=40.0):
    """The empty treadmill, its accelerometers so noisy that hardly anything else is left."""
    motion = lab.shaken(duration_s, seed)
    recording = lab.on_platform(lab.without_people(duration_s), motion, seed=seed)
    values = recording.analog.values.copy()
    values[:, :6] += np.random.default_rng(seed).normal(0, 0.01, (len(values), 6))
    return replace(recording, analog=replace(recording.analog, values=values))


@pytest.mark.slow
def test_the_sum_of_all_plates_is_as_uncertain_as_stated():
    """The same accelerometers compensate both plates: their errors are not independent.

    Noise below 6 Hz of 40 s has about 480 independent values: 4 % by chance, 12 % are three times
    that.
    """
    calibration = with_known_zeros(fit_calibration(noisy(0), TREADMILL))
    independent = replace(calibration, correlation=None)
    squares = {True: [], False: []}
    for seed in (1, 2, 3):
        trial = noisy(seed)
        for joint in squares:
            known = Laboratory(TREADMILL, calibration if joint else independent)
            ground = ground_of(trial, known)
            total, stated = (
                np.sum(ground.variants["compensated"], axis=0),
                ground.uncertainty(ORIGIN),
            )
            squares[joint].append(rms_by_stated(trial, total, stated) ** 2)
            assert ("go together" in " ".join(note.text for note in ground.notes)) is not joint
    np.testing.assert_allclose(np.sqrt(np.mean(squares[True], axis=0)), 1, atol=0.12)
    assert np.sqrt(np.mean(squares[False], axis=0))[:3].min() > 1.2


def test_zeros_of_plates_are_independent_and_the_same_in_every_frame():
    calibration = fit_calibration(noisy(0, 20.0), TREADMILL)
    trial = noisy(1, 20.0)
    squares = [
        ground_of(trial, Laboratory(TREADMILL, known)).uncertainty(ORIGIN) ** 2
        for known in (calibration, with_known_zeros(calibration))
    ]
    zero = [model.model_error.zero[:3] for model in calibration.plates.values()]
    added = (squares[0] - squares[1])[:, :3]
    expected = np.broadcast_to(np.sum(np.square(zero), axis=0), added.shape)
    np.testing.assert_allclose(added, expected, rtol=1e-6)


def test_trials_keep_the_uncertainty_of_every_frame_and_its_rms(processed):
    spread = processed.uncertainty
    assert spread.shape == (len(processed.motion.time), 6)
    rows = residual_table(processed, "pitch").set_index("compensated")["compensation_sd"]
    assert rows[False].isna().all()
    counted = processed.counts
    expected = np.sqrt(np.mean(spread[counted] ** 2, axis=0))
    np.testing.assert_allclose(rows[True], expected, rtol=0.3)
