"""A delay of plates that is put in is found, and one that is stated is taken off."""

import numpy as np
import pytest

from pipeline.config.schema import Settings
from pipeline.trial.process import process_recording
from tests.campaign.explain.faults import Seeded
from tests.campaign.explain.virtual_trial import (
    VirtualLaboratory,
    body_faults,
    stated_recording,
    stated_subject,
    walk_on,
)
from tests.recordings.recorded import (
    child,
    generated,
    overground,
    processed,
    standing,
    steps,
    treadmill,
)


def test_plates_of_a_real_treadmill_lag_its_markers_by_ten_to_twenty_milliseconds(shared_data):
    """As measured there with another model, of segment mid-points and de Leva's masses."""
    assert 0.010 < processed(treadmill, shared_data).delay_s < 0.020


@pytest.mark.parametrize("read", [treadmill, steps, overground])
def test_a_delay_that_is_put_into_a_recording_is_found_within_five_percent(shared_data, read):
    before = processed(read, shared_data)
    for delay_s in (-0.005, 0.015):
        after = processed(read, shared_data, delay_s)
        assert after.delay_s - before.delay_s == pytest.approx(delay_s, rel=0.05)
        assert after.delay_uncertainty_s == pytest.approx(before.delay_uncertainty_s, rel=0.1)


def test_a_delay_that_is_stated_is_taken_from_what_remains(shared_data):
    """Also where the statement is wrong: plates that are stated 15 ms too early."""
    before = processed(generated, shared_data)
    after = processed(generated, shared_data, plate_delay_s=-0.015)
    assert after.delay_s - before.delay_s == pytest.approx(0.015, rel=0.05)


@pytest.mark.parametrize("read", [treadmill, generated])
def test_both_filters_show_the_same_delay(shared_data, read):
    """Within a millisecond, of intervals of 5 ms and more."""
    live = processed(read, shared_data, filter="realtime")
    later_on = processed(read, shared_data)
    assert live.delay_s == pytest.approx(later_on.delay_s, abs=1e-3)


def test_quiet_standing_shows_no_delay(shared_data):
    result = processed(standing, shared_data, 0.015)
    assert np.isnan([result.delay_s, result.delay_uncertainty_s]).all()
    assert "plate_delay_unknown" in [note.code for note in result.notes]


@pytest.mark.parametrize(
    ("read", "delay_s"), [(child("HC030"), 0.0), (child("HC030"), 0.015), (child("HC031"), 0.015)]
)
def test_half_a_second_on_plates_shows_the_delay_within_fifteen_milliseconds_or_none(
    shared_data, read, delay_s
):
    result = processed(read, shared_data, delay_s)
    if not np.isnan(result.delay_s):
        assert abs(result.delay_s - delay_s) < result.delay_uncertainty_s <= 0.015


def test_a_generated_walk_without_a_delay_has_none_in_its_interval(shared_data):
    """Its body is rigid, and its masses are another model's."""
    result = processed(generated, shared_data)
    assert abs(result.delay_s) < result.delay_uncertainty_s


def test_delays_of_simulated_people_are_found_without_bias():
    """Other bodies than the model's, with soft tissue: a rigid one would be 3 ms late."""
    errors = []
    for seed, delay_s in enumerate([0.0, 0.007, -0.005, 0.015, 0.003, -0.015], start=50):
        laboratory, seeded = VirtualLaboratory(seed), Seeded(late_s=delay_s)
        machine = laboratory.with_faults(seeded)
        walked = walk_on(machine, body_faults(seeded), (seed, 1))
        recording = stated_recording(walked, machine, seeded)
        result = process_recording(recording, stated_subject(walked, seeded), Settings())
        errors.append(result.delay_s - delay_s)
        assert abs(errors[-1]) < result.delay_uncertainty_s < 0.006
    assert abs(np.mean(errors)) < 0.001
