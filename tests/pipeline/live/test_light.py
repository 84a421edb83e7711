"""One light: good, look or stop, with what is wrong and what to do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hbm.notes import Note, catalogue
from pipeline.live.light import OF_FRAMES, OF_NOTES, LiveState, light
from pipeline.trial.quality import DOES_NOT_COUNT, Quality
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
        for variant, peaks in board.peaks.items():
            newest = played.monitor.cycles[-1].residual[variant]
            np.testing.assert_array_equal(peaks, np.abs(newest).max(axis=0))
        weight_n = 9.81 * laboratory.body.mass
        assert board.limit_n == pytest.approx(0.05 * weight_n)
        assert board.limit_nm == pytest.approx(0.01 * 0.95 * weight_n, rel=0.1)
    assert board.done == f"{round(REQUIRED * board.progress)} / {REQUIRED} gait cycles"


def test_the_light_is_good_again_once_the_fault_is_mended(laboratory):
    monitor = laboratory.played("marker lost").monitor
    assert monitor.board().colour == "look"
    seen = np.ones((1, len(monitor._markers._names), 3))
    monitor._markers.add(np.array([100.0]), seen)
    assert monitor.board().colour == "good"


def note(marker):
    return Note.of("live_marker_gone", marker=marker, gone_s=1.0)


@pytest.mark.parametrize(
    ("markers", "sides", "sentence"),
    [
        (["LASIS"], {}, "LASIS is hidden: turn the camera or re-attach the marker"),
        (
            ["LASIS", "LKNE"],
            {"LASIS": "left", "LKNE": "left"},
            "LASIS, LKNE are hidden: turn the left camera or re-attach the markers",
        ),
        (
            ["A", "B", "C", "D"],
            {"A": "left", "B": "right"},
            "4 markers are hidden",
        ),
    ],
)
def test_hidden_markers_are_named_with_their_side(markers, sides, sentence):
    shown = light(LiveState(0, 25, notes=[*map(note, markers)], sides=sides))
    assert shown.sentence.startswith(sentence)


def test_a_hidden_marker_stops_where_frames_are_not_used_for_it():
    state = LiveState(0, 25, notes=[note("LASIS")], not_used={Quality.LIMB_UNSEEN: 0.9})
    assert (light(state).colour, light(state).sentence[:5]) == ("stop", "LASIS")


def test_filters_that_settle_and_a_few_frames_stop_nothing():
    assert light(LiveState(0, 25, not_used={Quality.SETTLING: 1.0})).colour == "look"
    assert light(LiveState(0, 25, not_used={Quality.NOT_CARRIED: 0.05})).colour == "good"
    assert light(LiveState(0, 25, not_used={Quality.NOT_CARRIED: 0.3})).colour == "look"


def test_the_start_of_a_session_is_no_fault():
    """Filters settle, and the platform's neutral markers are not known before two seconds."""
    hidden = {Quality.PLATFORM_UNKNOWN: 1.0, Quality.FORCES_UNKNOWN: 1.0}
    starting = light(LiveState(0, 25, steady=False, not_used=hidden))
    assert (starting.colour, starting.sentence[:8]) == ("look", "Starting")
    assert light(LiveState(0, 25, not_used=hidden)).colour == "stop"


def test_a_light_says_how_many_faults_it_does_not_name():
    found = [
        Note.of("live_plate_not_zero", plate=1, rest_n=13.0),
        Note.of("live_marker_gone", marker="LASIS", gone_s=0.5),
    ]
    shown = light(LiveState(3, 25, notes=found))
    assert shown.sentence == "Plate 1 reads 13 N without load: step off and zero it (+1 more)"


def test_every_reason_for_which_frames_are_not_used_has_a_sentence():
    assert set(OF_FRAMES) == set(DOES_NOT_COUNT) - {Quality.BRIDGED}  # of which live is no frame
    assert set(OF_NOTES) <= set(catalogue())


@given(
    shares=st.dictionaries(st.sampled_from([*OF_FRAMES]), st.floats(0, 1)),
    markers=st.lists(st.sampled_from(["LASIS", "RASIS", "SACR"]), unique=True),
    used=st.integers(0, 50),
)
def test_the_light_is_never_good_while_something_is_wrong(shares, markers, used):
    shown = light(LiveState(used, 25, notes=[*map(note, markers)], not_used=shares))
    faults = bool(markers) or any(share > 0.1 for share in shares.values())
    assert (shown.colour != "good") == faults
    assert len(shown.sentence.split()) <= 20
