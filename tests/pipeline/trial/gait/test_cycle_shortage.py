"""Why there is no gait cycle, in one sentence."""

import numpy as np
import pytest

from pipeline.io.recording import Event
from pipeline.trial.window import cycle_shortage

TIME = np.arange(300) / 100
NEEDS = "a gait cycle needs two foot strikes of one side while markers are recorded, from 0.00 to "


def strikes(*times, side="left"):
    return [Event(time, "foot_strike", side) for time in times]


@pytest.mark.parametrize(
    ("events", "left_out", "unsolved", "reason"),
    [
        ([], (), 0, "there are no foot strikes: nobody walks"),
        (strikes(0.5, 1.6), (), 300, "no frame could be solved; check the markers' labels and the"),
        (
            [*strikes(0.5, 4.0, 5.0), *strikes(1.1, side="right")],
            (),
            0,
            NEEDS + "2.99 s; there are 1 left and 1 right, and 2 from 4.00 to 5.00 s",
        ),
        (
            strikes(0.5, 1.6, 2.7),
            ("a gap", "events", "a gap"),
            20,
            "all gait cycles were left out, 2 for a gap, 1 for events; 20 of 300 frames could not",
        ),
        (strikes(0.5, 1.6), (), 0, "none of the gait cycles is one that the condition asks for"),
    ],
)
def test_the_reason_names_what_is_missing_with_its_numbers(events, left_out, unsolved, reason):
    solved = np.arange(300) >= unsolved
    assert cycle_shortage(events, left_out, TIME, solved, "nobody walks").startswith(reason)
