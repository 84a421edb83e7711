"""Gait events found automatically are when the feet of a simulated walker carry load."""

import numpy as np
import pytest

from pipeline.config.schema import Platform, Treadmill
from pipeline.trial.gait.detection import detect_events
from pipeline.trial.gait.events import LABELS, SIDES
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.machine.instrumented_treadmill import PLATFORM_MARKERS_M, make_treadmill
from pipeline.virtual_lab.person.walk import foot_events
from pipeline.virtual_lab.protocol.walking_protocol import Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import run_trial, study_subject
from tests.benchmarks.events import errors_of, event_sources, tabulate
from tests.benchmarks.report import EVENT_LIMITS_MS

SETTING = Setting(seed=5, protocol=Protocol(baseline_s=8.0, pitch_s=30.0, waits_s=(12.0,)))
NOT_COMPENSATED = Laboratory(Treadmill(platform=Platform(markers=tuple(PLATFORM_MARKERS_M))))


@pytest.fixture(scope="module", params=["baseline", "sway", "pitch"])
def trial(request):
    """A trial of the second subject, what its events can be found from, and its true events."""
    treadmill = make_treadmill(SETTING.faults, SETTING.seed)
    simulated = run_trial(SETTING, treadmill, study_subject(SETTING, 1), 1, request.param)
    true = foot_events(simulated.walk, float(simulated.motion.time[-1]))
    return request.param, event_sources(simulated.recording, NOT_COMPENSATED), true


def test_automatic_events_are_within_the_goal_even_of_plates_that_are_not_compensated(trial):
    condition, sources, true = trial
    events, note, _ = detect_events(**sources, method="auto")
    assert note.code == "events_calibrated"
    most_mean_ms, most_sd_ms = EVENT_LIMITS_MS[condition]
    for row in tabulate([(condition, {"auto": events}, true)]):
        assert row["found"] > 10
        assert abs(row["mean_ms"]) < most_mean_ms
        assert row["sd_ms"] < most_sd_ms
        assert (row["missed"], row["invented"]) == (0, 0)


def test_standing_and_the_start_of_the_belts_invent_no_event(trial):
    _, sources, true = trial
    for wanted in ("plates", "auto"):
        for event in detect_events(**sources, method=wanted)[0]:
            same = [e.time for e in true if (e.label, e.side) == (event.label, event.side)]
            assert np.abs(np.array(same) - event.time).min() < 0.15


def test_a_single_plate_under_both_feet_still_gives_all_events(trial):
    """No plate carries one foot alone; the motion of the feet is not calibrated."""
    _, sources, true = trial
    events, note, _ = detect_events(**sources | {"of_plates": ()}, method="auto")
    assert note.code == "events_uncalibrated"
    for label in LABELS:
        for side in SIDES:
            errors = errors_of(events, true, label, side)
            assert (errors.missed, errors.invented) == (0, 0)
            assert np.abs(errors.ms).max() < 120
