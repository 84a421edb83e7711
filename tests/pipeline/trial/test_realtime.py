"""With ``filter = "realtime"`` no number of a trial depends on what comes after it."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.coordinates import LIMBS
from pipeline.config.schema import Settings, Subject
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality, free_of
from pipeline.trial.study_files import read_study_file
from tests.hbm.motions import without
from tests.pipeline import lab

PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
REACH_FRAMES = 3


@pytest.fixture(scope="module")
def pitch(study):
    return read_study_file(study, "sub01_pitch.c3d")


@pytest.fixture(scope="module")
def whole(pitch, laboratory):
    return process_recording(pitch, PERSON, REALTIME, laboratory=laboratory)


def process(recording, laboratory, static):
    return process_recording(recording, PERSON, REALTIME, laboratory=laboratory, static=static)


@pytest.mark.parametrize("last", [350, 1001])
def test_a_trial_that_ends_earlier_is_the_same_until_then(pitch, laboratory, whole, last):
    part = process(lab.cropped(pitch, 0, last), laboratory, pitch)
    for name in ("q", "v", "a", "observed"):
        found, same = (getattr(result.motion, name) for result in (part, whole))
        np.testing.assert_allclose(found, same[: last + 1], rtol=0, atol=1e-7)
    known = last + 1 - REACH_FRAMES
    for variant in ("measured", "compensated"):
        found, same = (getattr(result, variant).residual[:known] for result in (part, whole))
        np.testing.assert_allclose(found, same[:known], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(part.quality[:known], whole.quality[:known])


def test_a_limb_that_returns_changes_nothing_before(pitch, laboratory):
    whole = process(pitch, laboratory, pitch)
    names = [n for n, s in whole.body.segment_of.items() if s in LIMBS["left leg"]]
    markers = without(pitch.markers, names, slice(600, None))
    gone = process(replace(pitch, markers=markers), laboratory, pitch)
    np.testing.assert_array_equal(gone.motion.q[:600], whole.motion.q[:600])
    assert (
        free_of(gone.quality, Quality.SETTLING)[:600].sum()
        == free_of(whole.quality, Quality.SETTLING)[:600].sum()
    )
    assert not free_of(gone.quality, Quality.SETTLING)[600:].any()


def test_a_calibration_fitted_without_delay_compensates_in_real_time(walker, whole):
    """Its model is linear: what is left of the person's own wrench is the noise of instruments."""
    still = process_recording(walker, PERSON, REALTIME)
    true = sum(still.ground["measured"].values())
    left, added = (
        np.sqrt(np.nanmean((sum(whole.ground[name].values()) - true)[130:] ** 2, axis=0))
        for name in ("compensated", "measured")
    )
    assert added[0] > 300
    assert left[:3].max() < 1
    assert left[3:].max() < 1


def test_before_the_platforms_neutral_pose_is_known_nothing_counts(whole):
    assert np.isnan(whole.compensated.residual[:100]).all()
    assert not whole.counts[:125].any()
    assert whole.counts[130]
