"""A session gives, shows and records every frame, whatever its neighbours do."""

import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.config.live import Live
from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.read import read_recording
from pipeline.live import session as module
from pipeline.live.light import Finding, Kind
from pipeline.live.monitor import Monitor
from pipeline.live.output import (
    RESULTS_FOLDER,
    STREAMS,
    Recorder,
    describe_stream,
    result_columns,
    result_row,
)
from pipeline.live.preparation import PoseFinder
from pipeline.live.replay import RecordedSource
from pipeline.live.session import Session
from pipeline.live.stream import Arrivals, Samples
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.process import process_recording
from pipeline.trial.residuals import residual_table
from tests.pipeline import lab
from tests.pipeline.live.perturbed import Faults, PerturbedSource
from tests.pipeline.live.playing import body_of, chain_of

REALTIME = Settings(filter="realtime")
STILL = Laboratory(Treadmill())


@pytest.fixture(scope="module")
def result(walker):
    return process_recording(walker, Subject(sex="female"), REALTIME)


@pytest.fixture(scope="module")
def short(walker):
    return lab.cropped(walker, 0, 500)


@pytest.fixture(scope="module")
def strides(walker):
    """Some gait cycles, and their residuals."""
    some = lab.cropped(walker, 0, 700)
    return some, process_recording(some, Subject(sex="female"), REALTIME)


def chain(walker, result):
    return chain_of(result.body, STILL, REALTIME, walker)


def ended(session, source, timeout_s=60.0):
    """Run a session to the end of its source."""
    session.start()
    deadline = time.monotonic() + timeout_s
    while session.runs and not source.ended and time.monotonic() < deadline:
        time.sleep(0.01)
    session.stop()


@pytest.fixture(scope="module")
def followed(walker, result, tmp_path_factory):
    """A session of the whole walk, recorded, and what its monitor saw."""
    folder = tmp_path_factory.mktemp("session") / "live"
    source, computed = RecordedSource(walker), chain(walker, result)
    described = [describe_stream(each, computed.live, walker.plates) for each in source.streams]
    with closing(Recorder(folder, described, result_columns())) as recorder:
        session = Session(source, computed, recorder)
        ended(session, source)
    assert (session.fault, recorder.fault, recorder.lost) == (None, None, 0)
    monitor = Monitor(computed, walker.plates)
    frames = []
    for samples in session.samples:
        monitor.samples(samples)
    for frame, latency_s in session.frames:
        monitor.frame(frame, latency_s)
        frames.append(frame)
    return computed, monitor, frames, folder


def test_every_frame_is_given_once_and_in_order(walker, followed):
    computed, _, frames, _ = followed
    assert computed.received == computed.solved + computed.marked == len(frames)
    np.testing.assert_array_equal([frame.time for frame in frames], walker.markers.time)


def test_what_was_recorded_is_the_walk(walker, followed):
    read = read_recording(followed[3] / STREAMS)
    np.testing.assert_array_equal(read.markers.position, walker.markers.position)
    for ours, true in zip(read.plates, walker.plates, strict=True):
        np.testing.assert_array_equal(ours.wrench_in_plate, true.wrench_in_plate)
        np.testing.assert_array_equal(ours.corners, true.corners)
        np.testing.assert_array_equal(ours.rotation, true.rotation)


def test_a_recorded_session_processed_afterwards_gives_the_residuals_of_the_trial(result, followed):
    again = process_recording(
        read_recording(followed[3] / STREAMS), Subject(sex="female"), REALTIME
    )
    ours, true = (residual_table(each, "level")["rms"] for each in (again, result))
    np.testing.assert_allclose(ours, true, rtol=1e-6)


@pytest.mark.parametrize("apart_s", [0.0, 2e-5])
def test_a_session_of_repeated_samples_processed_afterwards_gives_the_residuals_of_the_trial(
    strides, tmp_path, apart_s
):
    walk, result = strides

    class Repeating(RecordedSource):
        """One sample in ten comes twice, the copy with a time stamp of its own or the same."""

        def receive(self, timeout_s):
            return [self._repeated(samples) for samples in super().receive(timeout_s)]

        def _repeated(self, samples):
            order = np.repeat(
                np.arange(len(samples.time)), 1 + (rng.random(len(samples.time)) < 0.1)
            )
            copies = np.append(False, np.diff(order) == 0)
            time = samples.time[order] + apart_s * copies
            return replace(samples, time=time, values=samples.values[order])

    rng = np.random.default_rng(0)
    source, computed = Repeating(walk), chain(walk, result)
    described = [describe_stream(each, computed.live, walk.plates) for each in source.streams]
    with closing(Recorder(tmp_path / "live", described, result_columns())) as recorder:
        ended(Session(source, computed, recorder), source)
    read = read_recording(tmp_path / "live" / STREAMS)
    again = process_recording(read, Subject(sex="female"), REALTIME)
    ours, true = (residual_table(each, "level")["rms"] for each in (again, result))
    np.testing.assert_allclose(ours, true, rtol=1e-3)


def test_results_on_disk_are_those_of_the_frames(followed):
    _, _, frames, folder = followed
    table = pd.read_parquet(folder / RESULTS_FOLDER)
    assert tuple(table.columns) == result_columns()
    expected = np.array([result_row(frame) for frame in frames])
    np.testing.assert_array_equal(table.to_numpy()[:, 1:], expected)
    for name, of_frame in (
        ("q.PelvisY", lambda frame: frame.q[1]),
        ("tau.PelvisZ", lambda frame: frame.tau["measured"][2]),
        ("residual.measured.Mz", lambda frame: frame.residual["measured"][5]),
    ):
        np.testing.assert_array_equal(table[name], [of_frame(frame) for frame in frames])
    assert table["residual.compensated.Fx"].isna().all()


def test_the_monitor_has_the_residuals_of_the_trial(result, followed):
    """Gait cycles by the plates' contacts, of the trial by the motion of the feet."""
    monitor = followed[1]
    true = residual_table(result, "level")["rms"]
    np.testing.assert_allclose(monitor.condition.rms["measured"], true, rtol=0.15)
    assert monitor.condition.cycles > 12
    assert not monitor.notes


def test_a_source_that_fails_ends_the_session_and_says_why(short, result):
    class Failing(RecordedSource):
        def receive(self, timeout_s):
            if self.ended:
                raise ConnectionError("the cameras do not answer any more")
            return super().receive(timeout_s)

    source = Failing(short)
    session = Session(source, computed := chain(short, result))
    session.start()
    session._thread.join(60)
    assert str(session.fault) == "the cameras do not answer any more"
    assert computed.received == len(session.frames)


def test_where_nobody_takes_frames_the_oldest_are_dropped(short, result, monkeypatch):
    monkeypatch.setattr(module, "WAITING", 100)
    source = RecordedSource(short)
    session = Session(source, chain(short, result))
    ended(session, source)
    assert len(session.frames) == len(session.samples) == 100
    assert session.frames[-1][0].time == short.markers.time[-1]


def test_late_lost_doubled_and_disordered_samples_are_all_accounted_for(short, result):
    faults = Faults(drop=0.01, duplicate=0.01, reorder=0.01, delay_s={"Plates": 0.05})
    source = PerturbedSource(RecordedSource(short), faults)
    session = Session(source, computed := chain(short, result))
    ended(session, source)
    assert session.fault is None
    assert computed.received == computed.solved + computed.marked == len(session.frames)
    assert computed.received < len(short.markers.time)
    missing, unused = np.sum([(c.missing, c.unused) for c in session.arrivals.of.values()], axis=0)
    assert missing == pytest.approx(source.dropped, abs=3)  # some are at the ends
    late_or_twice = source.reordered + source.duplicated
    assert 0.8 * late_or_twice < unused < 1.2 * late_or_twice


def test_a_pose_is_found_where_the_subject_stands_and_gives_the_same_body(walker, result):
    source = RecordedSource(walker)
    finder = PoseFinder(Live(), source.streams, walker.plates)
    pose = None
    while pose is None:
        for samples in source.receive(0.0):
            pose = pose or finder.add(samples)
    assert samples.time[-1] < 1.5
    body = body_of(walker, Subject(sex="female"), static=pose)
    assert body.mass == pytest.approx(result.body.mass, rel=0.005)
    for name, segment in body.segments.items():
        np.testing.assert_allclose(segment.center, result.body.segments[name].center, atol=1e-3)


def test_no_pose_is_found_while_the_subject_walks_and_why_is_said(walker):
    source = RecordedSource(walker)
    finder = PoseFinder(Live(), source.streams, walker.plates)
    assert "too few frames" in finder.why_not
    while not source.ended:
        for samples in source.receive(0.0):
            if samples.time[0] > 4.0:
                assert finder.add(samples) is None
    assert "moved by" in finder.why_not


def test_no_pose_is_found_without_load(walker):
    source = RecordedSource(walker)
    finder = PoseFinder(Live(), source.streams, walker.plates)
    for _ in range(150):
        for samples in source.receive(0.0):
            if samples.stream == "Plates":
                samples = replace(samples, values=samples.values * 0)
            assert finder.add(samples) is None
    assert "carry 0 N" in finder.why_not


def test_streams_that_fall_silent_and_return_are_noted(walker, followed, monkeypatch):
    computed, _, frames, _ = followed
    now = [100.0]
    monkeypatch.setattr("pipeline.live.monitor.monotonic", lambda: now[0])
    monitor = Monitor(computed, walker.plates)
    plates = Samples("Plates", np.array([1.0]), np.zeros((1, 12)))
    monitor.samples(plates)
    monitor.frame(frames[0], 0.001)
    now[0] += 0.5
    monitor.look_for_silence()
    assert not monitor.notes
    now[0] += 1.0
    monitor.look_for_silence()
    monitor.look_for_silence()
    monitor.samples(plates)
    silent = [(Kind.STREAM_SILENT, ("Markers",)), (Kind.STREAM_SILENT, ("Plates",))]
    assert [*monitor.raised] == silent  # the markers have not sent anything yet
    assert monitor.board().sentence.startswith("Stream Markers ")
    now[0] += 2.0
    monitor.look_for_silence()
    assert len(monitor.notes) == 3  # the plates were back


def test_a_stream_whose_time_stamps_repeat_is_said_within_a_second(walker, followed, monkeypatch):
    """As from a program whose clock stands still: samples arrive, but none counts."""
    computed, now = followed[0], [100.0]
    monkeypatch.setattr("pipeline.live.monitor.monotonic", lambda: now[0])
    monitor, taken = Monitor(computed, walker.plates), Arrivals(RecordedSource(walker).streams)
    for k in range(150):
        now[0] += 0.01
        for stream, stamp_s in (("Markers", min(k, 20) / 100), ("Plates", k / 100)):
            columns = 3 * len(walker.markers.names) if stream == "Markers" else 12
            sample = Samples(stream, np.array([stamp_s]), np.zeros((1, columns)))
            monitor.samples(taken.take(sample, now[0]))
        monitor.look_for_silence()
        if k < 119:
            assert not monitor.notes
    assert [*monitor.raised] == [(Kind.STAMPS_REPEAT, ("Markers",))]
    assert monitor.board().colour == "stop"
    assert "stream Markers" in monitor.board().sentence


def test_gait_cycles_measured_while_the_light_says_stop_are_not_used(walker, followed, monkeypatch):
    computed, _, frames, _ = followed
    monitor, whole = Monitor(computed, walker.plates), Monitor(computed, walker.plates)
    offset = Finding(Kind.PLATE_NOT_ZERO, ("1",), {"rest_n": 15.0})
    monitor._watches[0].found = [offset]
    for frame in frames:
        whole.frame(frame, 0.0)
        if frame.time > frames[-1].time / 2:
            monitor._watches[0].found = []
        monitor.frame(frame, 0.0)
    assert 0 < monitor.condition.cycles < whole.condition.cycles
    assert monitor.condition.cycles + monitor.during_stop == whole.condition.cycles
    assert [*monitor.raised.values()] == [(offset.note, 1)]


def test_the_moment_limit_does_not_depend_on_where_the_laboratory_has_its_origin(walker, followed):
    computed, _, frames, _ = followed
    limits = []
    for raised_m in (0.0, 2.0):
        monitor = Monitor(computed, walker.plates)
        for frame in frames:
            monitor.frame(replace(frame, q=frame.q + raised_m * (np.arange(46) == 2)), 0.0)
        limits.append(monitor.height_m * monitor.condition.peaks["measured"][2])
    assert limits[0] > 1
    assert limits[1] == pytest.approx(limits[0], rel=1e-9)
