"""After a sender set its clock its stream's time goes on, and its frames are processed."""

from dataclasses import replace
from time import sleep

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from pipeline.config.schema import Settings, Subject, Treadmill
from pipeline.io.streams import find_clock
from pipeline.live.ground import SampleBuffer
from pipeline.live.monitor import Monitor
from pipeline.live.session import Session
from pipeline.live.stream import Arrivals, Samples, StreamDescription
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.quality import Quality
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, body_of, chain_of, streams_of

REALTIME = Settings(filter="realtime")
STREAMS = [
    StreamDescription("Markers", "markers", ("LHEE",), ("m",), 100.0),
    StreamDescription("Plates", "analog", ("Fz",), ("N",), 1000.0),
]


@pytest.fixture(scope="module")
def recording(walker):
    return lab.cropped(walker, 0, 400)


@pytest.fixture(scope="module")
def body(recording):
    return body_of(recording, Subject(sex="female"))


@pytest.fixture(scope="module")
def usual(recording, body):
    return followed(body, recording, arrivals(recording))[0]


class Given:
    """A source that gives samples, one chunk after another."""

    def __init__(self, recording, samples):
        self.streams = tuple(stream for stream, _, _ in streams_of(recording))
        self.plates = ()
        self._samples = iter(samples)
        self.ended = False

    def receive(self, timeout_s):
        try:
            return [next(self._samples)]
        except StopIteration:
            self.ended = True
            return []

    def close(self):
        pass


def followed(body, recording, samples):
    """Frames of a session that receives samples, and the notes that arise."""
    chain = chain_of(body, Laboratory(Treadmill()), REALTIME, recording)
    source = Given(recording, samples)
    session, monitor = Session(source, chain), Monitor(chain, recording.plates)
    session.start()
    while not source.ended and session.runs:
        sleep(0.005)
    session.stop()
    assert session.fault is None
    for each in session.samples:
        monitor.samples(each)
    return [frame for frame, _ in session.frames], monitor.notes


def clock_set(recording, by_s, at_s, streams):
    """The samples of a recording, the clock of whose streams is set at a time."""
    for samples in arrivals(recording):
        later = (samples.time >= at_s - 1e-9) & (samples.stream in streams)
        yield replace(samples, time=samples.time + by_s * later)


@pytest.mark.parametrize(
    ("by_s", "streams"),
    [
        (-3600.0, ("Markers", "Plates")),
        (30.0, ("Markers",)),
        (-0.8, ("Plates",)),
    ],
)
def test_frames_after_a_clock_was_set_are_those_without_it(recording, body, usual, by_s, streams):
    frames, notes = followed(body, recording, clock_set(recording, by_s, 2.0, streams))
    assert len(frames) == len(usual) == len(recording.markers.time)
    for frame, other in zip(frames, usual, strict=True):
        assert frame.time == pytest.approx(other.time, abs=1e-6)
        late = Quality.LATE in frame.quality
        if not late and abs(frame.time - 2.0) > 0.5:
            np.testing.assert_allclose(frame.q, other.q, atol=1e-6)
            np.testing.assert_allclose(
                frame.residual["measured"], other.residual["measured"], atol=1e-3
            )
    assert all(frame.quality.counts for frame in frames[-100:-5])
    clocks = [note.values for _, note in notes if note.code == "live_clock_set"]
    assert {clock["stream"] for clock in clocks} == {(stream,) for stream in streams}
    assert all(clock["set_s"] == pytest.approx(by_s, rel=5e-3) for clock in clocks)


def test_a_single_wrong_time_stamp_sets_no_clock():
    taken = Arrivals(STREAMS)
    time = np.arange(20) / 100
    for strange in (-1000.0, 1e12, np.nan, np.inf):
        spoilt = time.copy()
        spoilt[10] = strange
        for k in range(20):
            given = Samples("Markers", spoilt[k : k + 1], np.zeros((1, 3)))
            assert taken.take(given, k / 100).clock_set_s == 0
        time = time + 0.2
    after = taken.take(Samples("Markers", time[:5], np.zeros((5, 3))), 0.8)
    np.testing.assert_allclose(after.time[-5:], time[:5])


def test_a_stream_that_was_silent_keeps_its_clock():
    taken = Arrivals(STREAMS)
    time = np.arange(50) / 100
    for start_s in (0.0, 60.0):
        given = taken.take(Samples("Markers", time + start_s, np.zeros((50, 3))), start_s + 0.5)
        np.testing.assert_array_equal(given.time, time + start_s)
        assert given.clock_set_s == 0


def test_streams_that_are_set_together_stay_together_after_a_pause():
    """Both send nothing for three seconds; one stops a little earlier than the other."""
    taken = Arrivals(STREAMS)
    taken.take(Samples("Markers", 100 + np.arange(100) / 100, np.zeros((100, 3))), 1.0)
    taken.take(Samples("Plates", 100 + np.arange(980) / 1000, np.zeros((980, 1))), 1.0)
    markers = taken.take(Samples("Markers", np.arange(100) / 100, np.zeros((100, 3))), 4.0)
    plates = taken.take(Samples("Plates", np.arange(1000) / 1000, np.zeros((1000, 1))), 4.0)
    assert plates.time[0] == pytest.approx(markers.time[0], abs=1e-9)


def test_a_sample_that_comes_twice_is_none_that_was_lost():
    taken = Arrivals(STREAMS)
    for time in (np.arange(50) / 100, np.array([0.20, 0.50, 0.51])):
        given = taken.take(Samples("Markers", time, np.zeros((len(time), 3))), 0.5)
    np.testing.assert_array_equal(given.time, [0.50, 0.51])
    assert (taken.of["Markers"].missing, taken.of["Markers"].unused) == (0, 1)


@drawn(
    lost=st.sets(st.integers(1, 298)),
    late=st.dictionaries(st.integers(1, 200), st.integers(1, 40), max_size=60),
    twice=st.dictionaries(st.integers(0, 299), st.integers(1, 40), max_size=60),
    untimed=st.sets(st.integers(1, 298), max_size=20),
    each=st.integers(1, 40),
    seed=st.integers(0),
)
def test_samples_that_never_came_are_told_from_those_that_came_late_twice_or_without_a_time(
    lost, late, twice, untimed, each, seed
):
    jitter = np.random.default_rng(seed).uniform(-0.2, 0.2, 300)
    stamps = 1e4 + (np.arange(300) + jitter) / 100
    untimed = untimed - lost
    late = {k: by for k, by in late.items() if k not in lost | untimed}
    sent = [(k + late.get(k, 0) + 0.1 * (k in late), k) for k in range(300) if k not in lost]
    sent += [(k + by + 0.2, k) for k, by in twice.items() if k not in lost | untimed]
    order = np.array([k for _, k in sorted(sent)])
    time = np.where(np.isin(order, [*untimed]), np.nan, stamps[order])
    taken, used = Arrivals(STREAMS), []
    for k in range(0, len(time), each):
        chunk = time[k : k + each]
        used += [*taken.take(Samples("Markers", chunk, np.zeros((len(chunk), 3))), k / 100).time]
    assert (np.diff(used) > 0).all()
    assert taken.of["Markers"].unused == len(time) - len(used)
    assert taken.of["Markers"].missing == len(lost)


def received(time, values, each=10):
    """What is used of samples that come so many at a time, and the stream's clock."""
    taken, used = Arrivals(STREAMS), []
    for k in range(0, len(time), each):
        chunk = time[k : k + each]
        arrived_s = np.nanmax(time[: k + each]) - time[0]
        samples = Samples("Markers", chunk, values[k : k + each])
        used += [*taken.take(samples, arrived_s).time]
    assert (np.diff(used) > 0).all()
    return np.array(used), taken.of["Markers"]


CLEAR = st.tuples(st.floats(80, 120), st.floats(0, 0.2))
"""Any rate near the stated 100 Hz, and stamps that leave no doubt about their frames."""
BLURRED = st.tuples(st.floats(99.99, 100.01), st.floats(0.2, 0.5))
"""A stream as stated, whose stamps overlap with those of the next frames."""


@settings(max_examples=15)
@drawn(
    clock=CLEAR | BLURRED,
    lost=st.sampled_from([0.0, 0.002, 0.01, 0.1]),
    burst=st.integers(0, 80),
    late=st.booleans(),
    twice=st.sampled_from([0.0, 0.1]),
    each=st.integers(1, 40),
    seed=st.integers(0),
)
def test_what_never_came_is_counted_whatever_rate_jitter_loss_and_chunks(
    clock, lost, burst, late, twice, each, seed
):
    rate_hz, jitter = clock
    rng = np.random.default_rng(seed)
    stamps = 1e4 + (np.arange(3000) + rng.uniform(-jitter, jitter, 3000)) / rate_hz
    came = rng.random(3000) >= lost
    came[1500 : 1500 + burst] = False
    came[[0, -1]] = True
    order, repeats = np.flatnonzero(came), np.flatnonzero(came & (rng.random(3000) < twice))
    behind = late * np.where(rng.random(len(order)) < 0.05, rng.integers(2, 40, len(order)), 0)
    sent = np.append(order, repeats)
    sent = sent[np.argsort(np.append(order + behind, repeats + 40.5), kind="stable")]
    used, found = received(stamps[sent], rng.normal(size=(3000, 3))[sent], each)
    newest = np.maximum.accumulate(np.append(-np.inf, stamps[sent]))
    assert found.unused == np.sum(stamps[sent] <= newest[:-1])
    assert len(used) + found.unused == len(sent)
    assert found.missing == pytest.approx(np.sum(~came), abs=0 if jitter <= 0.2 else 2)


@pytest.mark.parametrize("by_frames", [0.4, 0.5, 1.0])
@pytest.mark.parametrize("in_order", [True, False])
def test_jitter_is_no_loss(by_frames, in_order):
    rng = np.random.default_rng(3)
    time = 1e4 + (np.arange(30_000) + rng.uniform(-by_frames, by_frames, 30_000)) / 100
    time = np.sort(time) if in_order else time
    _, found = received(time, rng.normal(size=(30_000, 3)))
    assert found.missing == pytest.approx(0, abs=1)


@pytest.mark.parametrize("count", [2, 5, 10, 20])
@pytest.mark.parametrize("each", [1, 5, 40])
def test_chunks_with_one_stamp_are_used_whole_where_the_offline_clock_has_them(count, each):
    stamps = 7 + np.repeat(np.arange(0, 1000, count), count) / 100
    values = np.random.default_rng(0).normal(size=(1000, 3))
    values[500:700] = 0  # such as a plate that nobody stands on
    used, found = received(stamps, values, each)
    assert (len(used), found.missing, found.unused) == (1000, 0, 0)
    np.testing.assert_allclose(used[count:], find_clock(stamps, 100.0).time[count:], atol=3e-3)


@pytest.mark.parametrize("back", [60, 200, 800])
@pytest.mark.parametrize("count", [1, 10])
def test_a_block_that_comes_again_is_used_once(back, count):
    stamps = 7 + np.repeat(np.arange(0, 3000, count), count) / 100
    sent = np.r_[:1000, 1000 - back : 3000]
    used, found = received(stamps[sent], np.random.default_rng(0).normal(size=(3000, 3))[sent])
    assert (len(used), found.missing, found.unused) == (3000, 0, back)


def test_samples_of_a_clock_that_stands_still_are_not_used():
    stamps = np.r_[:100, np.full(200, 100), 300:400] / 100
    used, found = received(stamps, np.random.default_rng(0).normal(size=(400, 3)), 1)
    assert len(used) + found.unused == 400
    assert found.unused >= 149
    assert used[-1] == stamps[-1]


@settings(max_examples=15)
@drawn(
    twice=st.sampled_from([0.002, 0.1]),
    apart_s=st.sampled_from([0.0, 2e-5]),
    late=st.booleans(),
    each=st.integers(1, 40),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_live_uses_of_repeated_samples_is_read_at_the_same_times(
    twice, apart_s, late, each, seed
):
    """A recording of a session has no other clock than the session had."""
    rng = np.random.default_rng(seed)
    order = np.repeat(np.arange(1500), 1 + (rng.random(1500) < twice))
    apart = apart_s * np.append(False, np.diff(order) == 0)
    behind = late * 5.5 * (rng.random(len(order)) < 0.02)
    at = np.argsort(np.arange(len(order)) + behind, kind="stable")
    values, taken, used = rng.normal(size=(1500, 3)), Arrivals(STREAMS), []
    for k in range(0, len(at), each):
        chunk = at[k : k + each]
        samples = Samples("Markers", 7 + order[chunk] / 100 + apart[chunk], values[order[chunk]])
        used.append(taken.take(samples, order[chunk].max() / 100))
    time, held = (np.concatenate([getattr(s, part) for s in used]) for part in ("time", "values"))
    clock = find_clock(time, 100.0, held)
    assert clock.rate_hz == pytest.approx(100, rel=1e-5)
    np.testing.assert_allclose(clock.time[clock.index], time[clock.samples], atol=1e-3)
    assert not [fact for fact in clock.facts if fact.kind in ("left_out", "in_doubt")]


@drawn(st.lists(st.integers(0, 9), max_size=30))
def test_the_newest_samples_are_kept_whatever_the_chunks(chunks):
    buffer, given = SampleBuffer(columns=2, length=7), np.arange(sum(chunks))
    for some in np.split(given, np.cumsum(chunks)):
        buffer.append(some / 100, np.stack([some, -some], axis=1))
    np.testing.assert_array_equal(buffer.time, given[-7:] / 100)
    np.testing.assert_array_equal(buffer.values, np.stack([given, -given], axis=1)[-7:])
