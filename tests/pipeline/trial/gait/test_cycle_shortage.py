"""Why a trial has no gait cycle."""

import numpy as np
import pytest

from hbm.notes import Note
from pipeline.io.recording import Event
from pipeline.trial.window import cycle_shortage

TIME = np.arange(300) / 100
SOLVED = np.ones(300, bool)
SPAN = {"side": "left", "start_s": 0.5, "stop_s": 1.6}


def strikes(*times, side="left"):
    return [Event(time, "foot_strike", side) for time in times]


def test_a_trial_of_which_no_frame_is_solved():
    reason = cycle_shortage(strikes(0.5, 1.6), (), TIME, ~SOLVED)
    assert reason.startswith("no frame could be solved; check the markers' labels")


def test_a_trial_without_foot_strikes():
    offs = [Event(0.5, "foot_off", "left")]
    assert cycle_shortage(offs, (), TIME, SOLVED) == "there are no foot strikes"


def test_events_beyond_the_markers_are_named_with_their_times():
    reason = cycle_shortage(strikes(50.06, 51.2), (), TIME, SOLVED)
    assert reason == (
        "all foot strikes are beyond the markers, which end at 2.99 s: 50.06 to 51.20 s"
    )


def test_too_few_foot_strikes_are_counted_by_side():
    one_each = [*strikes(0.5), *strikes(1.1, side="right")]
    reason = cycle_shortage(one_each, (), TIME, SOLVED)
    expected = (
        "a gait cycle needs two foot strikes of one side, there are 1 left and 1 right in 2.99 s"
    )
    assert reason == expected
    more = cycle_shortage([*one_each, *strikes(4.0, 5.0)], (), TIME, SOLVED)
    assert more == (
        f"{expected}; 2 more are beyond the markers, which end at 2.99 s: 4.00 to 5.00 s"
    )


def test_cycles_that_were_left_out_are_counted_by_reason():
    other = SPAN | {"start_s": 1.6, "stop_s": 2.7}
    notes = [
        Note.of("mass_stated", mass_kg=70.0),
        Note.of("cycle_unsolved", **SPAN),
        Note.of("cycle_events", **other, event="left foot off", count=0),
        Note.of("cycle_events", **other, event="right foot strike", count=2),
        Note.of("cycle_unsolved", **SPAN | {"side": "right"}),
    ]
    converged = SOLVED.copy()
    converged[60:80] = False
    reason = cycle_shortage(strikes(0.5, 1.6, 2.7), notes, TIME, converged)
    assert reason == (
        "all gait cycles were left out, 2 for frames without a solution or without forces, "
        "1 for events that do not alternate; 20 of 300 frames could not be solved"
    )
    late = Note.of("cycle_duration", **SPAN, ratio=1.8)
    reason = cycle_shortage(strikes(0.5, 1.6), [late], TIME, SOLVED)
    assert reason == "all gait cycles were left out, 1 for a duration far from the median"


@pytest.mark.parametrize("side", ["left", "right"])
def test_cycles_that_the_condition_does_not_ask_for(side):
    reason = cycle_shortage(strikes(0.5, 1.6, side=side), (), TIME, SOLVED)
    assert reason == "none of the gait cycles is one that the condition asks for"
