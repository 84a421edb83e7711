"""Plates that are not zero when nobody is on them are named, and so are samples that are lost."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hbm.signals.resampling import resample
from pipeline.trial.checks import plates_apart
from pipeline.trial.findings.finding import Finding
from pipeline.trial.findings.raw import raw_faults
from pipeline.trial.findings.words import note_of
from pipeline.trial.findings.zeros import readings_without_load, rest_level, wrong_zeros
from tests.pipeline.trial.standing import WEIGHT_N, standing

MASS_KG = 80.0
SWING = 0.38
"""Share of a stride in which a foot swings and its belt is free."""


def steps(time, phase, rest_n=0.0):
    """The load of one belt of a treadmill: nobody on it while its foot swings."""
    stance = np.clip(((time / 1.1 + phase) % 1) / (1 - SWING), 0, 1)
    return rest_n + WEIGHT_N * np.sin(np.pi * stance) ** 0.5 * (stance < 1)


def walking(duration_s=10.0, *, rest_n=(0.0, 0.0), noise_n=3.0):
    return standing(
        duration_s,
        loads_n=lambda t: [steps(t, 0.5 * k, rest_n[k]) for k in range(2)],
        speed_mps=1.0,
        noise_n=noise_n,
    )


def check(recording):
    """What is found of plates at rest, of their samples, and of their times."""
    time, plates = recording.markers.time, recording.plates
    wrenches = [resample(plate.time, plate.wrench, time) for plate in plates]
    zeros = wrong_zeros(plates, readings_without_load(plates, wrenches, time, WEIGHT_N))
    findings = [] if zeros is None else [zeros[0]]
    lost = [fault for fault in raw_faults(plates) if fault.kind == "lost"]
    findings += [Finding(fault.kind, (fault.plate,), channels=(fault,)) for fault in lost]
    notes = (note_of(finding, plates, time) for finding in findings)
    return (*notes, *plates_apart(recording))


def codes(recording):
    return [note.code for note in check(recording)]


def test_plates_that_are_zeroed_raise_no_warning():
    assert check(walking()) == ()
    assert check(standing()) == ()


@pytest.mark.parametrize(("later_s", "apart"), [(0.5, False), (-0.5, False), (5.0, True)])
def test_plates_that_were_recorded_at_another_time_are_named_with_both_times(later_s, apart):
    recording = standing(10.0)
    plates = tuple(replace(plate, time=plate.time + later_s) for plate in recording.plates)
    notes = [n for n in check(replace(recording, plates=plates)) if n.code == "plates_apart"]
    assert bool(notes) == apart
    for note in notes:
        assert note.values["first_s"] == pytest.approx(later_s)
        assert note.values["start_s"] == 0


@pytest.mark.parametrize("component", [0, 4])
@pytest.mark.parametrize("offset", [-60.0, 3.0])
def test_any_component_that_is_not_zero_when_nobody_is_on_the_plate_is_named(component, offset):
    recording = walking()
    plate = recording.plates[1]
    added = np.zeros(6)
    added[component] = offset
    shifted = replace(plate, wrench_in_plate=plate.wrench_in_plate + added)
    notes = check(replace(recording, plates=(recording.plates[0], shifted)))
    assert bool(notes) == (abs(offset) > 10)
    for note in notes:
        found = note.values["components"]
        assert found.startswith("plate 2 ")
        assert abs(float(found.split()[-1].replace("−", "-"))) == pytest.approx(abs(offset), abs=1)


def test_samples_that_are_zero_while_a_plate_is_loaded_are_named():
    recording = walking()
    plate = recording.plates[0]
    loaded = int(np.argmax(plate.wrench[:, 2]))
    wrench = plate.wrench_in_plate.copy()
    wrench[loaded : loaded + 2] = 0
    (note,) = check(replace(recording, plates=(replace(plate, wrench_in_plate=wrench),)))
    assert (note.code, note.values["samples"]) == ("plate_samples_zero", 2)
    assert note.values["first_s"] == pytest.approx(plate.time[loaded])


def test_a_component_that_passes_zero_has_lost_no_sample():
    recording = walking()
    plate = recording.plates[0]
    loaded = int(np.argmax(plate.wrench[:, 2]))
    wrench = plate.wrench_in_plate.copy()
    wrench[:, 3] = np.where(np.arange(len(wrench)) < loaded, 1.0, -1.0)
    wrench[loaded, 3] = 0.0
    assert check(replace(recording, plates=(replace(plate, wrench_in_plate=wrench),))) == ()


@settings(max_examples=30)
@given(rest_n=st.floats(-60, 60))
def test_a_belt_is_not_zeroed_from_10_n_on_and_never_below(rest_n):
    assume(abs(abs(rest_n) - 10) > 1)
    notes = check(walking(rest_n=(rest_n, 0.0)))
    assert bool(notes) == (abs(rest_n) > 10)
    for note in notes:
        assert (note.code, note.level) == ("plates_not_zeroed", "warning")
        found = note.values["rest_n"]
        assert found["plate 1"] == pytest.approx(rest_n, abs=1.5)
        assert found["plate 2"] == pytest.approx(0.0, abs=1.5)


def test_small_offsets_of_several_plates_add_up():
    plates = walking().plates
    offset = np.array([0, 0, 8.0, 0, 0, 0])
    numbered = tuple(
        replace(plate, number=k, wrench_in_plate=plate.wrench_in_plate + offset)
        for k, plate in enumerate((*plates, plates[0]), 1)
    )
    assert codes(replace(walking(), plates=numbered[:2])) == []
    assert codes(replace(walking(), plates=numbered)) == ["plates_not_zeroed"]


def test_a_plate_that_is_always_loaded_has_no_level_of_rest():
    time = np.arange(1000) / 100
    assert rest_level(0.4 * WEIGHT_N + 0 * time, time, WEIGHT_N) is None
    brief = np.where(time < 0.25, 0.0, 0.4 * WEIGHT_N)
    assert rest_level(brief, time, WEIGHT_N) is None
