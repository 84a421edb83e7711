"""Delays of plates and commands behind the platform's markers are found by its own motion."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.schema import Platform
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.ground.platform import command_delay, uncompensated_motion
from tests.pipeline import lab
from tests.pipeline.trial.ground.grounds import TREADMILL, notes_on

MARKERS = tuple(lab.PLATFORM_MARKERS_M)
COMMANDS = Platform(sway_channel="Sway", pitch_channel="Pitch")


def moved(seed, motion=None, **delays):
    return lab.on_platform(
        lab.without_people(20.0), motion or lab.shaken(20.0, seed), seed=seed, **delays
    )


@pytest.mark.parametrize("marked", [True, False])
def test_a_platform_that_moves_while_nothing_is_compensated_is_named(walker, marked):
    """By its markers or, without, by the channels of its command; one that is still is not."""
    for motion, moves in ((lab.shaken(walker.markers.time[-1] + 0.01, 3), True), (None, False)):
        trial = lab.on_platform(walker, motion or lab.still(walker.markers.time[-1] + 0.01))
        if not marked:
            keep = [k for k, name in enumerate(trial.markers.names) if name not in MARKERS]
            names = tuple(trial.markers.names[k] for k in keep)
            position = trial.markers.position[:, keep]
            trial = replace(trial, markers=replace(trial.markers, names=names, position=position))
        notes = uncompensated_motion(trial, walker.markers.names)
        assert [note.code for note in notes] == ["platform_moves"] * moves
        if moves:
            expected = np.ptp(motion.at(trial.markers.time)[0][0])
            assert notes[0].values["moved_m"] == pytest.approx(expected, rel=0.3)


@pytest.mark.parametrize(("motion", "within_s"), [(None, 0.001), (lab.pitching(20.0), 0.0005)])
def test_the_platforms_own_motion_times_its_commands(motion, within_s):
    """Of a slow pitch whole samples correlate alike over several of them; only the slope tells."""
    recording = moved(1, motion, command_delay_s=-0.02)
    command = command_delay(recording, MARKERS, COMMANDS)
    assert abs(command.values["delay_s"] - 0.02) < within_s
    assert abs(command.values["delay_s"] - 0.02) < command.values["interval_s"]
    assert command.values["stated_s"] == -command.values["delay_s"]


def test_markers_that_are_hidden_for_a_while_still_time_the_commands():
    """The longest part in which all are seen is enough."""
    recording = moved(1, command_delay_s=-0.02)
    position = recording.markers.position.copy()
    position[600:720, 0] = np.nan
    seen = replace(recording, markers=replace(recording.markers, position=position))
    found = command_delay(seen, MARKERS[:3], COMMANDS).values["delay_s"]
    assert abs(found - 0.02) < 0.001
    position[:, 0] = np.nan
    hidden = replace(recording, markers=replace(recording.markers, position=position))
    with pytest.raises(ValueError, match=r"platform markers .*first 100"):
        command_delay(hidden, MARKERS[:3], COMMANDS)


def test_a_trial_on_a_moving_platform_says_how_late_its_plates_are_and_what_of_it_is_stated(
    calibration,
):
    laboratory = Laboratory(TREADMILL, calibration)
    late = {"plate_delay_s": 0.004, "accelerometer_delay_s": 0.004}
    for motion, stated_s, codes in (
        (lab.shaken(20.0, 5), 0.004, ["platform_plates_delay"]),
        (lab.shaken(20.0, 5), None, ["platform_plates_delay_differs"]),
        (lab.still(20.0), 0.004, []),
    ):
        trial = moved(5, motion, **late)
        notes = notes_on(trial, laboratory, None, stated_s)
        found = [note for note in notes if note.code.startswith("platform_plates_delay")]
        assert [note.code for note in found] == codes
        for note in found:
            assert abs(note.values["delay_s"] - 0.004) < note.values["interval_s"]
            assert note.values["stated_s"] == (stated_s or 0.0)
