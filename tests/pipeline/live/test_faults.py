"""Samples that are late, lost, doubled or reordered are counted, shown and survived."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config.live import Live
from pipeline.config.schema import Platform, Settings, Subject
from pipeline.io.units import acceleration_in_mps2
from pipeline.live.chain import LiveChain
from pipeline.live.ground import AnalogStreams
from pipeline.live.stream import Arrivals, Samples, StreamDescription
from pipeline.trial.quality import Quality
from pipeline.trial.study_files import read_study_file
from tests.pipeline import lab
from tests.pipeline.live.playing import arrivals, body_of, chain_of, play, streams_of

REALTIME = Settings(filter="realtime")
SECONDS = 4.0


@pytest.fixture(scope="module")
def recording(study):
    whole = read_study_file(study, "sub01_pitch.c3d")
    return lab.cropped(whole, 0, round(100 * SECONDS))


@pytest.fixture(scope="module")
def body(recording, laboratory):
    person = Subject(sex="male", mass_kg=74.6)
    return body_of(recording, person, laboratory=laboratory)


@pytest.fixture(scope="module")
def new_chain(recording, laboratory, body):
    return lambda **options: chain_of(body, laboratory, REALTIME, recording, **options)


@pytest.fixture(scope="module")
def expected(recording, new_chain):
    return play(new_chain(), arrivals(recording))


def values_of(frames):
    names = frames[0].residual
    each = [[f.q, *(f.tau[n] for n in names), *(f.residual[n] for n in names)] for f in frames]
    return np.array([np.concatenate(values) for values in each])


def assert_accounted(chain, frames):
    assert len(frames) == chain.received == chain.solved + chain.marked
    assert chain.solved == sum(frame.quality.counts for frame in frames)


def in_time(frames):
    return np.array([not frame.quality & Quality.LATE for frame in frames])


@given(
    st.lists(st.sampled_from([0.001, 0.004, 0.01, 0.033, 0.1]), min_size=3, max_size=3),
    st.lists(st.floats(0, 0.09), min_size=3, max_size=3),
)
@settings(max_examples=4)
def test_chunks_and_their_order_change_no_number(recording, new_chain, expected, chunks, late_s):
    late = dict(zip(("Markers", "Plates", "Analog"), late_s, strict=True))
    chain = new_chain()
    frames = play(chain, arrivals(recording, chunks, late))
    assert_accounted(chain, frames)
    np.testing.assert_array_equal(in_time(frames), in_time(expected))
    np.testing.assert_array_equal(values_of(frames), values_of(expected))


def test_a_whole_file_at_once_gives_the_same_frames(recording, new_chain, expected):
    chain = new_chain()
    streams = [Samples(d.name, time, values) for d, time, values in streams_of(recording)]
    frames = play(chain, reversed(streams))
    assert_accounted(chain, frames)
    usual = in_time(frames) & in_time(expected)
    known = len(frames) - 200  # of analog samples the last 2 s are kept
    np.testing.assert_array_equal(
        values_of(frames)[known + 10 :][usual[known + 10 :], :46],
        values_of(expected)[known + 10 :][usual[known + 10 :], :46],
    )


def test_doubled_and_late_samples_are_counted_and_change_nothing(recording, new_chain, expected):
    chain, twice = new_chain(), []
    for samples in arrivals(recording):
        twice += [samples, samples]
    old = arrivals(recording)[:3]
    taken = Arrivals([stream for stream, _, _ in streams_of(recording)])
    sent = [*twice[:100], *old, *twice[100:]]
    frames = play(chain, (taken.take(samples, samples.time[-1]) for samples in sent))
    assert_accounted(chain, frames)
    np.testing.assert_array_equal(values_of(frames), values_of(expected))
    repeated = sum(len(samples.time) for samples in (*twice[::2], *old))
    assert sum(clock.unused for clock in taken.of.values()) == repeated
    assert not any(clock.missing for clock in taken.of.values())


def gone(samples, stream, start_s, stop_s):
    for each in samples:
        if each.stream != stream or each.time[0] < start_s or each.time[-1] >= stop_s:
            yield each


@pytest.mark.parametrize("stream", ["Plates", "Analog"])
def test_a_stream_that_goes_away_and_returns_costs_the_frames_without_it(
    recording, new_chain, expected, stream
):
    chain = new_chain()
    frames = play(chain, gone(arrivals(recording), stream, 2.0, 2.6))
    assert_accounted(chain, frames)
    time = np.array([frame.time for frame in frames])
    late = ~in_time(frames)
    assert late[(time > 2.0) & (time < 2.3)].all()
    assert not late[(time < 1.95) | ((time > 2.7) & (time < 3.9))].any()
    unknown = np.array([bool(frame.quality & Quality.FORCES_UNKNOWN) for frame in frames])
    assert unknown[(time > 2.02) & (time < 2.57)].all()
    before, after = time < 1.97, (time > 3.5) & (time < 3.9)
    found, usual = values_of(frames), values_of(expected)
    np.testing.assert_array_equal(found[before], usual[before])
    np.testing.assert_array_equal(found[:, :46], usual[:, :46])
    np.testing.assert_allclose(found[after], usual[after], rtol=0, atol=1.0)  # N; settled again
    assert all(frame.quality.counts for frame, late in zip(frames, after, strict=True) if late)


def test_markers_that_stop_and_return_begin_anew(recording, new_chain, expected):
    chain = new_chain()
    frames = play(chain, gone(arrivals(recording), "Markers", 2.0, 2.6))
    assert_accounted(chain, frames)
    assert chain.received == len(expected) - 60
    (first,) = (k for k, frame in enumerate(frames) if frame.time == 2.6)
    assert not any(frame.quality.counts for frame in frames[first : first + 25])
    assert frames[first + 30].quality.counts
    usual = expected[first + 60 + 60]
    np.testing.assert_allclose(frames[first + 60].q, usual.q, rtol=0, atol=1e-3)


def test_lost_frames_cost_no_other(recording, new_chain):
    chain, random = new_chain(), np.random.default_rng(0)
    kept = [s for s in arrivals(recording) if s.stream != "Markers" or random.random() > 0.1]
    frames = play(chain, kept)
    assert_accounted(chain, frames)
    later = [frame for frame in frames if 1.5 < frame.time < SECONDS - 0.1]
    assert np.mean([frame.quality.counts for frame in later]) > 0.9


def test_samples_that_are_no_numbers_stop_nothing(recording, new_chain):
    chain, spoilt = new_chain(), []
    arrived = Arrivals([stream for stream, _, _ in streams_of(recording)])
    random = np.random.default_rng(1)
    for samples in arrivals(recording):
        time, values = samples.time.copy(), samples.values.copy()
        if random.random() < 0.05:
            values[:] = random.choice([np.nan, np.inf, 1e30, -1e30])
        if random.random() < 0.02:
            time[-1] = random.choice([np.nan, np.inf, -1.0])
        spoilt.append(arrived.take(Samples(samples.stream, time, values), float(samples.time[-1])))
    assert_accounted(chain, play(chain, [samples for samples in spoilt if len(samples.time)]))


def test_memory_does_not_grow(recording, new_chain):
    chain, used, short = new_chain(), [], lab.cropped(recording, 0, 130)
    tracemalloc.start()
    for turn in range(4):
        for samples in arrivals(short, start_s=1.4 * turn):
            chain.push(samples)
        used.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert max(used[2:]) - used[1] < 100_000


@pytest.mark.parametrize(
    ("live", "treadmill", "message"),
    [
        (Live(markers="Cameras"), {}, "streams Cameras, "),
        (Live(analog=("Plates",)), {}, "Acc1.X"),
        (Live(plates={"1": tuple("abcdef")}), {}, "a, b, c, d, e, f "),
        (Live(), {"platform": Platform(markers=("P1", "P2", "P3"))}, "P1, P2, P3 "),
        (Live(), {"cutoff_hz": 10.0}, "calibration does"),
    ],
)
def test_what_is_stated_and_not_received_is_refused(
    recording, laboratory, body, live, treadmill, message
):
    described = [stream for stream, _, _ in streams_of(recording)]
    stated = laboratory.treadmill.model_copy(update=treadmill)
    other = type(laboratory)(stated, laboratory.calibration)
    with pytest.raises(ValueError, match=message):
        LiveChain(body, other, REALTIME, live, described, recording.plates)


def test_channels_of_one_label_are_not_told_apart():
    board = StreamDescription("Board", "analog", ("Acc.X", "Acc.X"), ("g", "g"), 100.0)
    with pytest.raises(ValueError, match="channels are Acc"):
        AnalogStreams([board]).find(["Acc.X"], [acceleration_in_mps2])
