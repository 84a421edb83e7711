"""A replay over Lab Streaming Layer, through the chain, to the outlet: the numbers of the file."""

import os

import numpy as np
import pytest

from pipeline.config.live import Live
from pipeline.config.schema import Settings, Subject
from pipeline.config.study import read_study
from pipeline.live.frames.chain import LiveChain
from pipeline.live.replay import RecordedSource
from pipeline.trial.process import process_recording
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import reported
from pipeline.trial.study_files import read_study_file, read_study_laboratory

PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
MAX_ANGLE_RAD = 1e-9
MAX_FORCE_N = 1e-4


@pytest.fixture(scope="module")
def laboratory(moving_study):
    return read_study_laboratory(read_study(moving_study))


@pytest.fixture(scope="module")
def pitch(moving_study):
    return read_study_file(read_study(moving_study), "sub01_pitch.c3d")


@pytest.fixture(scope="module")
def whole(pitch, laboratory):
    return process_recording(pitch, PERSON, REALTIME, laboratory=laboratory)


def chain_of(source, whole, laboratory, recording):
    markers, *analog = (stream.name for stream in source.streams)
    live = Live(markers=markers, analog=tuple(analog), wait_s=2.0)
    return LiveChain(whole.body, laboratory, REALTIME, live, source.streams, recording.plates)


def assert_same(frames, whole):
    assert not any(frame.quality & Quality.LATE for frame in frames[: len(whole.motion.time) - 5])
    count = len(whole.motion.time) - 5  # the last frames miss samples after the recording's end
    q = np.array([frame.q for frame in frames[:count]])
    residual = np.array([frame.residual["compensated"] for frame in frames[:count]])
    expected = reported(whole.compensated.residual)[:count]
    np.testing.assert_array_equal(np.isnan(residual), np.isnan(expected))
    assert np.nanmax(np.abs(q - whole.motion.q[:count])) < MAX_ANGLE_RAD
    assert np.nanmax(np.abs(residual - expected)) < MAX_FORCE_N


def test_a_recorded_source_gives_the_numbers_of_the_file(pitch, whole, laboratory):
    source = RecordedSource(pitch)
    chain = chain_of(source, whole, laboratory, pitch)
    frames = []
    while not source.ended:
        for samples in source.receive(0.0):
            frames += chain.push(samples)
    assert_same([*frames, *chain.finish()], whole)


@pytest.mark.slow
def test_a_replay_over_the_loopback_gives_the_numbers_of_the_file(pitch, whole, laboratory):
    lsl = pytest.importorskip("pylsl", reason="the extra live is not installed")
    from pipeline.live.outlet import result_outlet, result_row
    from pipeline.live.replay import Replay
    from pipeline.live.sources.lsl import LslSource

    prefix = f"{os.getpid()} over "
    replay = Replay(pitch, 2.0, prefix=prefix)
    source = LslSource(replay.names[0], replay.names[1:])
    chain = chain_of(source, whole, laboratory, pitch)
    outlet = result_outlet(
        100.0,
        filter_delay_s=chain.filter_delay_s,
        resampling_delay_s=chain.wait_s,
        name=f"{prefix}hbm",
    )
    (info,) = lsl.resolve_byprop("name", f"{prefix}hbm", timeout=5.0)
    results = lsl.StreamInlet(info)
    desc = results.info(5.0).desc()
    assert float(desc.child_value("filter_delay_s")) == chain.filter_delay_s > 0.03
    assert float(desc.child_value("resampling_delay_s")) == chain.wait_s >= 0.02
    results.open_stream(5.0)
    assert replay.start(5.0)
    frames = []
    while not replay.ended:
        for samples in source.receive(0.05):
            for frame in chain.push(samples):
                frames.append(frame)
                outlet.push_one(frame.time, result_row(frame))
    sent = len(frames)
    received, times = results.pull_chunk(2.0, max_samples=sent, as_numpy=True)
    frames += chain.finish()
    for each in (source, replay, outlet):
        each.close()
    assert_same(frames, whole)
    np.testing.assert_array_equal(received[:, :46], [frame.q for frame in frames[:sent]])
    np.testing.assert_array_equal(times, [frame.time for frame in frames[:sent]])
