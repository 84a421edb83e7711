"""Unbalanced rollers in a belt calibration: what the belt model leaves that turns with it."""

from collections.abc import Sequence
from itertools import cycle
from typing import Final

import numpy as np

from compensation import BeltModel, fit_roller, low_pass
from hbm.notes import Note
from hbm.signals.resampling import resample
from pipeline.config.schema import Belt
from pipeline.io.recording import Recording
from pipeline.trial.ground.belts import MODEL_RATE_HZ, belt_side, belt_speed, belt_wrenches

MIN_EXPLAINED: Final = 0.1
"""Share of what the belt model leaves; a wave fitted to noise explains a few percent."""
WALKING_MPS: Final = 1.25
"""Speed of ordinary walking, at which the moment is stated."""


def roller_notes(recording: Recording, models: Sequence[BeltModel], belt: Belt) -> tuple[Note, ...]:
    """Find the unbalanced roller of every belt in a recording of the empty, moving belts.

    Parameters
    ----------
    recording
        The belt calibration.
    models
        Fitted to it, one per plate.
    belt
        As stated.

    Returns
    -------
    tuple of Note
        ``belt_roller`` for every plate with one, or ``belt_roller_unknown`` where the belt ran too
        little. Its moment is not subtracted: at which angle a roller starts, only seconds of an
        empty belt show, and in a trial somebody stands on it.
    """
    plates, analog = recording.plates, recording.analog
    assert analog is not None  # the models are of its belt speeds
    start, stop = max(plates[0].time[0], analog.time[0]), min(plates[0].time[-1], analog.time[-1])
    time = np.arange(start, stop, 1 / MODEL_RATE_HZ)
    predicted = belt_wrenches(recording, models, belt, [time] * len(plates))
    notes = []
    for plate, channel, wrench in zip(plates, cycle(belt.speed_channels), predicted, strict=False):
        side = belt_side(plate)
        moment = resample(plate.time, plate.wrench_in_plate[:, 3:] @ side, time)
        left = moment - wrench[:, 3:] @ side
        speed = resample(analog.time, belt_speed(recording, channel), time)
        known = np.isfinite(left) & np.isfinite(speed)
        left, speed = left[known] - left[known].mean(), speed[known]
        slow = low_pass(left, MODEL_RATE_HZ, belt.cutoff_hz, "realtime")
        try:
            roller = fit_roller(slow, speed, MODEL_RATE_HZ, belt.cutoff_hz)
        except ValueError as error:
            notes.append(Note.of("belt_roller_unknown", plate=plate.number, reason=str(error)))
            continue
        turning = roller.predict(speed, MODEL_RATE_HZ)
        explained = 1 - np.var(slow - turning) / np.var(slow)
        if explained > MIN_EXPLAINED:
            note = Note.of(
                "belt_roller",
                plate=plate.number,
                circumference_m=roller.circumference_m,
                moment_nm=roller.amplitude * WALKING_MPS**2,
                speed_mps=WALKING_MPS,
                share=explained,
            )
            notes.append(note)
    return tuple(notes)
