"""Live zeros that are followed are those of a trial in real time, and off by default."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.read_options import ReadOptions
from pipeline.live.chain import LiveChain
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import reported
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, body_of, chain_of, play, streams_of

STILL, REALTIME = Laboratory(Treadmill()), Settings(filter="realtime")
PERSON = Subject(sex="male", mass_kg=74.6)
MOST_N = 0.3
"""In the frames around a phase's end, whose samples a trial sees with either zero."""


@pytest.fixture(scope="module")
def warming(walker):
    """Both plates read a zero, that of the left one drifts."""
    left, right = walker.plates
    at_first, per_s = np.array([1.0, 2.0, 20.0, 1.0, 0.5, 0.2]), [0.2, 0.0, 1.0, 0.0, 0.1, 0.0]
    drift = at_first + np.outer(left.time, per_s)
    left = replace(left, wrench_in_plate=left.wrench_in_plate + drift)
    right = replace(right, wrench_in_plate=right.wrench_in_plate + at_first)
    return replace(walker, plates=(left, right))


def residuals(chain, recording):
    return np.array([frame.residual["measured"] for frame in play(chain, arrivals(recording))])


def test_zeros_are_followed_live_as_in_a_trial_in_real_time(walker, warming):
    stated = replace(warming, options=ReadOptions(mend_plates=("1: drift", "2: drift")))
    whole = process_recording(stated, PERSON, REALTIME)
    described = [stream for stream, _, _ in streams_of(warming)]
    live = Live(follow_zeros=True)
    chain = LiveChain(whole.body, STILL, REALTIME, live, described, warming.plates)
    apart = np.abs(residuals(chain, warming) - reported(whole.measured.residual)).max(axis=1)
    # once the first zeros, of tens of newtons, have passed the filter
    known = whole.motion.time > 7.0
    assert np.nanmax(apart[known]) < MOST_N
    steady, plain = (process_recording(each, PERSON, REALTIME) for each in (walker, warming))
    truth = steady.measured.residual[known, 2]
    left, before = (np.nanmean(r.measured.residual[known, 2] - truth) for r in (whole, plain))
    # some seconds late, of 1 N/s
    assert abs(left) < 4.0 < 40.0 < abs(before)


def test_without_the_setting_zeros_stay(warming):
    warming = lab.cropped(warming, 0, 500)
    whole = process_recording(warming, PERSON, REALTIME)
    found = residuals(chain_of(whole.body, STILL, REALTIME, warming), warming)
    assert np.nanmax(np.abs(found - reported(whole.measured.residual))[:-5]) < 1e-4


def test_zeros_of_a_platform_that_moves_are_refused(study, laboratory, walker):
    recording = lab.cropped(walker, 0, 100)
    body = body_of(walker, PERSON)
    described = [stream for stream, _, _ in streams_of(recording)]
    moving = Laboratory(
        Treadmill(
            platform=laboratory.treadmill.platform.model_copy(
                update={"markers": ("C7", "RASIS", "LASIS")}
            )
        )
    )
    with pytest.raises(ValueError, match="follow_zeros"):
        LiveChain(body, moving, REALTIME, Live(follow_zeros=True), described, walker.plates)
