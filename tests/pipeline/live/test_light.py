"""One light says good, look or stop, with what is wrong and what to do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensation.inertia.sensors import SensorFault
from hbm.notes import catalogue
from pipeline.live.light import OF_FRAMES, OF_SENSORS, Finding, Kind, light
from pipeline.trial.quality import DOES_NOT_COUNT, Quality
from pipeline.trial.residuals import AXES, HEALTHY_RMS
from tests.pipeline.live.planted import EXPECTED, REQUIRED, VirtualLaboratory


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory):
    return VirtualLaboratory(tmp_path_factory.mktemp("light"))


@pytest.mark.parametrize("fault", EXPECTED)
def test_the_light_names_each_frequent_fault_and_what_to_do(laboratory, fault):
    played = laboratory.played(fault)
    board, (colour, sentence) = played.board, EXPECTED[fault]
    assert (board.colour, sentence in board.sentence) == (colour, True), board.sentence
    assert played.monitor.status().startswith(f"{colour.upper()}: {board.sentence}")
    if fault == "none":
        assert board.progress >= 1
        assert not played.monitor.notes
        for variant, rms in board.rms.items():
            ten = np.concatenate([each.residual[variant] for each in played.monitor.cycles])
            np.testing.assert_allclose(rms, np.sqrt(np.mean(ten**2, axis=0)), rtol=1e-12)
    if fault == "forward force doubled":  # also about mid-hip; its cycles are used
        assert board.progress >= 1
        assert np.flatnonzero(board.rms["measured"] > HEALTHY_RMS).tolist() == [0, 4, 5]
    ended = ": end with Ctrl-C" * (board.progress >= 1)
    assert board.done == f"{round(REQUIRED * board.progress)} / {REQUIRED} gait cycles{ended}"


def test_a_complete_session_whose_streams_have_all_ended_is_no_fault(laboratory, monkeypatch):
    monitor = laboratory.played("none").monitor
    with monkeypatch.context() as patch:
        patch.setattr(monitor, "_arrived_s", dict.fromkeys(monitor._arrived_s or "MP", -np.inf))
        monitor.look_for_silence()
        assert monitor.board().sentence.startswith("All streams")
        patch.setitem(monitor._arrived_s, next(iter(monitor._arrived_s)), np.inf)
        monitor.look_for_silence()
        assert monitor.board().colour == "stop"
    monitor._silent = []
    assert monitor.board().colour == "good"


def test_the_light_is_good_again_once_the_fault_is_mended(laboratory):
    monitor = laboratory.played("marker lost").monitor
    assert monitor.board().colour == "look"
    seen = np.ones((1, len(monitor._markers._names), 3))
    monitor._markers.add(np.array([100.0]), seen)
    assert monitor.board().colour == "good"


@pytest.fixture(scope="module")
def monitor(laboratory):
    return laboratory.played("none").monitor


@given(rms=st.lists(st.floats(0, 100), min_size=6, max_size=6))
def test_the_light_is_never_good_above_a_bar_that_exceeds_healthy_walking(monitor, rms):
    """It names these bars, of compensated residuals where there are any."""
    recent = monitor.condition.recent
    residual = {"measured": np.full((2, 6), 99.0), "compensated": np.array([rms, rms])}
    recent.extend([replace(recent[-1], residual=residual)] * 10)
    monitor._high = monitor._above_healthy()
    board = monitor.board()
    shown = board.rms["compensated"]
    assert (board.colour == "good") == (not (shown > HEALTHY_RMS).any())
    for axis, size, limit in zip(AXES, shown, HEALTHY_RMS, strict=True):
        assert (axis in board.sentence) == (size > limit)
    assert len(board.sentence.split()) <= 20


DONE = "3 of 25 gait cycles used"


def gone(marker):
    return Finding(Kind.MARKER_GONE, (marker,), {"gone_s": 1.0})


@pytest.mark.parametrize(
    ("hidden", "sentence"),
    [
        (["LASIS"], "LASIS is hidden: turn a camera or re-attach the marker"),
        (["LASIS", "LKNE"], "LASIS, LKNE are hidden: turn a camera or re-attach the markers"),
        (list("ABCD"), "4 markers are hidden: turn a camera or re-attach the markers"),
    ],
)
def test_hidden_markers_have_one_sentence(hidden, sentence):
    assert light(map(gone, hidden), {}, DONE) == ("look", sentence)


def test_a_hidden_marker_stops_where_frames_are_not_used_for_it():
    """One sentence for the cause and for all that follows from it."""
    colour, sentence = light(
        [gone("LASIS")], {Quality.LIMB_UNSEEN: 0.9, Quality.POSE_UNKNOWN: 0.9}, DONE
    )
    assert (colour, sentence[:5], sentence[-6:]) == ("stop", "LASIS", "marker")


def test_filters_that_settle_and_a_few_frames_stop_nothing():
    assert light([], {Quality.SETTLING: 1.0}, DONE)[0] == "look"
    assert light([], {Quality.NOT_CARRIED: 0.05}, DONE) == ("good", DONE)
    assert light([], {Quality.NOT_CARRIED: 0.3}, DONE)[0] == "look"


def test_the_start_of_a_session_is_no_fault():
    """Filters settle, and the platform's neutral markers are not known before two seconds."""
    hidden = {Quality.PLATFORM_UNKNOWN: 1.0, Quality.FORCES_UNKNOWN: 1.0}
    colour, sentence = light([], hidden, DONE, steady=False)
    assert (colour, sentence[:8]) == ("look", "Starting")
    assert light([], hidden, DONE)[0] == "stop"


def test_a_light_says_how_many_faults_it_does_not_name():
    found = [gone("LASIS"), Finding(Kind.PLATE_NOT_ZERO, ("1",), {"rest_n": 13.0})]
    sentence = "Plate 1 reads 13 N without load: step off and zero it (+1 more)"
    assert light(found, {}, DONE) == ("stop", sentence)


def test_every_reason_for_which_frames_are_not_used_and_every_kind_has_a_sentence():
    assert set(OF_FRAMES) == set(DOES_NOT_COUNT) - {Quality.BRIDGED}  # of which live is no frame
    assert set(OF_SENSORS) == set(SensorFault)
    assert {kind.note_code for kind in Kind} <= set(catalogue())


@given(
    shares=st.dictionaries(st.sampled_from([*OF_FRAMES]), st.floats(0, 1)),
    markers=st.lists(st.sampled_from(["LASIS", "RASIS", "SACR"]), unique=True),
)
def test_the_light_is_never_good_while_something_is_wrong(shares, markers):
    colour, sentence = light(map(gone, markers), shares, DONE)
    faults = bool(markers) or any(share > 0.1 for share in shares.values())
    assert (colour != "good") == faults
    assert len(sentence.split()) <= 20
