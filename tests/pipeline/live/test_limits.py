"""Sessions with a fault that is just large, or just long enough to be said, or just not."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.io.recording import Plate
from pipeline.live import monitor
from pipeline.live.chain import LiveFrame
from pipeline.live.cycles import ConditionSoFar, GaitTracker, LiveCycle
from pipeline.live.light import Kind, light
from pipeline.live.monitor import FitWatch, MarkerGaps, Monitor, plate_watch
from pipeline.live.preparation import _elsewhere
from pipeline.live.qualisys import Packets, Signals
from pipeline.live.stream import StreamDescription, _require_rate
from pipeline.trial.quality import Quality

NO_FLAG = Quality(0)


def frame(time, error_m=0.003, quality=NO_FLAG, contact=(False, False)):
    return LiveFrame(
        time=time,
        q=np.zeros(46),
        tau={},
        residual={"measured": np.zeros(6)},
        by_foot={"measured": np.zeros((2, 6))},
        contact=np.array(contact),
        marker_error=np.array([error_m, error_m]),
        quality=quality,
        computing_s=0.0,
        markers=np.ones((2, 3)),
    )


def found_of(frames):
    """When each kind of fault is found."""
    watch, kinds = FitWatch(["LASIS", "RASIS"], [0, 1]), {}
    for one in frames:
        watch.add(one)
        for finding in watch.found:
            kinds.setdefault(finding.kind, one.time)
    return kinds


@pytest.mark.parametrize(("error_m", "kinds"), [(0.013, set()), (0.03, {Kind.MARKERS_MISFIT})])
def test_markers_that_soft_tissue_moves_fit_and_those_of_another_body_do_not(error_m, kinds):
    assert {*found_of(frame(k / 100, error_m) for k in range(500))} == kinds


def test_markers_that_do_not_fit_for_less_than_half_of_a_stride_are_not_said():
    errors = [0.026 if k % 200 < 90 else 0.0 for k in range(600)]
    assert found_of(frame(k / 100, error) for k, error in enumerate(errors)) == {}


def test_markers_that_do_not_fit_are_said_within_three_seconds():
    assert found_of(frame(k / 100, 0.03) for k in range(300))


@pytest.mark.parametrize(("share", "kinds"), [(0.4, set()), (0.6, {Kind.FOOT_UNCERTAIN})])
def test_a_foot_beside_the_pressure_is_said_where_most_frames_show_it(share, kinds):
    flags = [Quality.FOOT_UNCERTAIN * (k % 10 < 10 * share) for k in range(500)]
    assert {*found_of(frame(k / 100, quality=Quality(f)) for k, f in enumerate(flags))} == kinds


@pytest.mark.parametrize(("rate_hz", "said"), [(8.0, False), (15.0, True)])
def test_two_seconds_are_judged_of_fifteen_frames_a_second_and_not_of_eight(rate_hz, said):
    frames = (frame(k / rate_hz, 0.03) for k in range(int(2.2 * rate_hz)))
    assert bool(found_of(frames)) == said


@pytest.mark.parametrize(("hidden_s", "said"), [(0.3, False), (0.6, True)])
def test_a_marker_that_a_swinging_hand_hides_is_not_said(hidden_s, said):
    gaps, position = MarkerGaps(["LASIS"]), np.ones((100, 1, 3))
    position[20 : 20 + round(100 * hidden_s)] = np.nan
    names = []
    for k, place in enumerate(position):
        gaps.add(np.array([k / 100]), place[None])
        names += [finding.subject for finding in gaps.found]
    assert bool(names) == said


@pytest.mark.parametrize(
    ("share", "colour"), [(0.07, "good"), (0.15, "look"), (0.4, "look"), (0.6, "stop")]
)
def test_the_light_is_good_look_or_stop_by_the_frames_that_are_not_used(share, colour):
    assert light([], {Quality.POSE_UNKNOWN: share}, "done")[0] == colour


@pytest.mark.parametrize(("silent_s", "said"), [(0.7, False), (1.5, True)])
def test_a_stream_is_silent_after_more_than_the_delays_of_networks(monkeypatch, silent_s, said):
    monkeypatch.setattr(monitor, "monotonic", lambda: 100.0)
    streams = {"Plates": 100.0 - silent_s}
    session = SimpleNamespace(_arrived_s=streams, _untimed_s=dict.fromkeys(streams, 0.0))
    session.look = lambda: None
    Monitor.look_for_silence(session)
    assert bool(session._silent) == said


def test_a_plate_that_is_not_zero_is_said_within_fifteen_seconds_and_not_of_five_alone():
    watch, times = plate_watch(1, 75.0), np.arange(0, 15, 0.01)
    said = []
    for time in times:
        watch.add(np.array([time]), np.array([[0, 0, 14.0, 0, 0, 0]]))
        said += [time] if watch.found else []
    assert 6 < said[0] < 15


@pytest.mark.parametrize(
    ("distance_m", "angle_deg", "said"),
    [(0.002, 0.0, 0), (0.005, 0.0, 1), (0.0, 0.3, 0), (0.0, 0.8, 1)],
)
def test_a_plate_that_was_moved_by_more_than_it_is_measured_to_is_said(distance_m, angle_deg, said):
    corners = np.array([[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0], [0.3, -0.2, 0.0]])
    nothing = np.empty(0), np.empty((0, 6))
    then = Plate(1, *nothing, np.eye(3), np.zeros(3), corners)
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn, moved_m = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array([distance_m, 0, 0])
    now = Plate(1, *nothing, turn, moved_m, corners @ turn.T + moved_m)
    assert len(_elsewhere({"1": now}, {"1": then}, "static.c3d")) == said


def strides(durations_s):
    """Durations of the strides that a session takes, of a foot that strikes after each."""
    tracker, taken = GaitTracker(0.042), []
    strikes = np.cumsum([0.5, *durations_s])
    for time in np.arange(0, strikes[-1] + 0.5, 0.01):
        since = time - strikes[np.searchsorted(strikes, time, "right") - 1]
        loaded = time >= strikes[0] and since < 0.4
        taken += [one for one in tracker.add(frame(time, contact=(loaded, False)))]
    return [round(one.stop_s - one.start_s, 1) for one in taken if one.unit == "cycle"]


def test_three_long_strides_do_not_make_the_usual_ones_unusual():
    assert strides([1.0] * 12 + [1.8] * 3 + [1.0] * 5).count(1.0) == 17


def test_strides_count_again_six_strides_after_the_belt_has_slowed_down():
    assert strides([1.0] * 20 + [1.8] * 8).count(1.8) >= 3


def shown(*sizes):
    """The bar after gait cycles with such residuals."""
    condition = ConditionSoFar(0.9)
    for k, size in enumerate(sizes):
        time = k + np.arange(100) / 100
        residual = {"measured": np.full((100, 6), size)}
        flags = np.zeros(100, int)
        peaks = {"measured": 0.0}
        condition.add(LiveCycle("left", k, k + 1.0, True, time, residual, peaks, {}, quality=flags))
    return condition.recent_rms["measured"][0]


def test_a_bar_shows_what_was_mended_after_twelve_gait_cycles():
    assert shown(*[50.0] * 20, *[5.0] * 12) == pytest.approx(5.0)


def test_one_bad_step_does_not_treble_a_bar():
    assert shown(*[10.0] * 20, 75.0) < 30.0


@pytest.mark.parametrize("rate_hz", [1.5, 40_000.0])
def test_the_rates_of_slow_and_fast_instruments_are_read(rate_hz):
    _require_rate("a thermometer or a microphone", rate_hz)


@pytest.mark.parametrize("rate_hz", [0.6, 90_000.0])
def test_rates_that_no_instrument_has_are_refused(rate_hz):
    with pytest.raises(ValueError, match="expected 1 to 50000"):
        _require_rate("a stream", rate_hz)


def landings(*away_mm):
    """Forces, moments and points of a plate of Qualisys that disagree by so much, sent in turn."""
    signals = Signals(StreamDescription("Plate", "analog", ("Fz",), ("N",), 1000.0), None)
    for away in away_mm:
        force, point = np.array([0.0, 0.0, -700.0]), np.array([50.0, 20.0, 0.0])
        moment = np.cross((point + np.array([away, 0.0, 0.0])) / 1e3, force)
        signals.check_moments(np.concatenate([force, moment, point])[None])


def test_samples_of_a_foot_that_lands_refuse_no_plate_of_qualisys():
    landings(*[25.0] * 8, *[1.0] * 40)


def test_moments_about_another_point_are_refused_within_thirty_samples_of_qualisys():
    with pytest.raises(ValueError, match="25 mm about the centre"):
        landings(*[25.0] * 30)


@pytest.mark.parametrize(("apart_s", "same"), [(0.03, True), (0.08, False)])
def test_samples_and_frames_of_qualisys_begin_together_within_a_few_frames(apart_s, same):
    said, plate = [], SimpleNamespace(description=SimpleNamespace(name="Plate"))
    packets = SimpleNamespace(markers=SimpleNamespace(rate_hz=100.0), _say=said.append)
    begins_s = Packets._origin_s(packets, plate, 5.0, 99.0, 5.0 + apart_s)
    assert (begins_s == 0.0) == same == (not said)


@pytest.mark.parametrize(("back_s", "begins"), [(0.3, False), (0.8, True)])
def test_a_measurement_of_qualisys_begins_where_stamps_go_back_by_more_than_late_frames(
    back_s, begins
):
    packets = SimpleNamespace(_sent=0, _last_s=9.0, _base_s=0.0, _convert=lambda values: values)
    packets.markers, again = SimpleNamespace(rate_hz=100.0), []
    packets.restart = lambda: again.append(True)
    part = SimpleNamespace(counts=lambda n: (0,), part=lambda n: b"")
    part.numbers = lambda rows, columns: np.empty((0, 3))
    Packets._markers_of(packets, part, 9.0 - back_s)
    assert bool(again) == begins
