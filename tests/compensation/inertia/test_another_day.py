"""A calibration against an empty recording of another day, with one thing changed at a time."""

import numpy as np
import pytest

from compensation.inertia.another_day import check_another_day
from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from compensation.inertia.quality import (
    MAX_LEFT,
    left_over,
    refuse_unusable,
)
from hbm.spatial import WRENCH_COMPONENTS, rotation_about

RATE_HZ = 100.0
SETUP = Setup(("rear", "front"), rate_hz=RATE_HZ, cutoff_hz=20.0)
FRONT = slice(3, 6)


def record(lab, seed, **options):
    trial = lab.random_trial(seed, noise=seed, cutoff_hz=20, duration=40, **options)
    return trial.accelerations.copy(), trial.wrench.copy()


@pytest.fixture(scope="module")
def model(laboratory):
    return fit_inertia(*record(laboratory(), 1), SETUP)


def check(model, accelerations, wrench):
    return check_another_day({"plate 1": model}, accelerations, {"plate 1": wrench}, "day2.c3d")


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_an_unchanged_laboratory_is_still_valid(laboratory, model, seed):
    found = check(model, *record(laboratory(), seed))
    assert found.verdict == "valid"
    assert [note.code for note in found.notes] == ["calibration_still_valid"]
    zero = found.zeros[0]
    assert (np.abs(zero.change) < 0.6).all()


@pytest.mark.parametrize("gain", [0.97, 1.01, 1.03])
@pytest.mark.parametrize("seed", [2, 3])
def test_the_gain_of_a_sensor_is_found_within_its_interval(laboratory, model, gain, seed):
    accelerations, wrench = record(laboratory(), seed)
    accelerations[:, FRONT] *= gain
    found = check(model, accelerations, wrench)
    assert found.verdict == "gain"
    values = found.notes[0].values
    assert values["sensor"] == "front"
    assert abs(values["change"] - (gain - 1)) < values["interval"] < 0.01


@pytest.mark.parametrize("degrees", [1.5, 5.0, 90.0])
@pytest.mark.parametrize("axis", range(3))
def test_a_sensor_that_was_turned_is_found_with_its_angle(laboratory, model, degrees, axis):
    accelerations, wrench = record(laboratory(), 2)
    turn = rotation_about(np.eye(3)[axis], np.radians(degrees))
    accelerations[:, FRONT] = accelerations[:, FRONT] @ turn.T
    found = check(model, accelerations, wrench)
    assert found.verdict == "turned"
    values = found.notes[0].values
    assert values["sensor"] == "front"
    assert abs(values["angle_deg"] - degrees) < values["interval"] < 1


@pytest.mark.parametrize(
    ("shift", "named"),
    [((0.1, 0, 0), "front"), ((-0.2, 0, 0), "front"), ((0, 0, 0.1), "rear or front")],
)
def test_a_sensor_at_another_place_was_moved(laboratory, model, shift, named):
    """Of a change of height the plates do not show which sensor's it is."""
    rear, front = laboratory().positions
    moved = laboratory(positions=(rear, tuple(np.add(front, shift))))
    found = check(model, *record(moved, 2))
    assert found.verdict == "moved"
    assert found.notes[0].values["sensor"] == named


def test_a_sensor_that_is_later_than_it_was_is_found(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    late, _ = record(laboratory(), 2, late_s=0.002)
    accelerations[:, FRONT] = late[:, FRONT]
    found = check(model, accelerations, wrench)
    assert found.verdict == "late"
    (note,) = found.notes
    assert note.values["sensor"] == "front"
    assert abs(note.values["change_s"] - 0.002) < note.values["interval_s"]


def test_a_delay_that_was_never_estimated_is_no_change_since_the_calibration(laboratory):
    accelerations, wrench = record(laboratory(), 1)
    accelerations[:, FRONT] = record(laboratory(), 1, late_s=0.003)[0][:, FRONT]
    model = fit_inertia(accelerations, wrench, SETUP)
    plates = {"plate 1": model}, accelerations, {"plate 1": wrench}, "empty.c3d"
    (note,) = check_another_day(*plates, without_delay=("rear", "front")).notes
    assert note.code == "calibration_delay_uncorrected"
    assert note.values["sensor"] == "front"
    assert "fit it again" in note.text


@pytest.mark.parametrize("gain", [0.97, 1.03])
def test_the_gain_of_a_plate_is_not_taken_for_that_of_a_sensor(laboratory, model, gain):
    accelerations, wrench = record(laboratory(), 2)
    found = check(model, accelerations, gain * wrench)
    assert found.verdict == "plates"
    values = found.notes[0].values
    assert abs(values["change"] - (gain - 1)) < values["interval"]


@pytest.mark.parametrize("gain", [0.92, 1.02])
@pytest.mark.parametrize("component", range(6))
def test_the_gain_of_one_component_is_found_and_named(laboratory, model, component, gain):
    accelerations, wrench = record(laboratory(), 2)
    wrench[:, component] *= gain
    found = check(model, accelerations, wrench)
    assert found.verdict == "plates"
    (note,) = found.notes
    name = WRENCH_COMPONENTS[component]
    assert note.code == "calibration_plate_component_gain"
    assert list(note.values["change"]) == [name]
    assert abs(note.values["change"][name] - (gain - 1)) < note.values["interval"][name] < 0.01


def test_a_component_whose_motion_is_in_its_noise_shows_no_change_of_its_gain(laboratory):
    days = []
    for seed, gain in ((1, 1.0), (2, 1.08)):
        accelerations, wrench = record(laboratory(), seed)
        noise = np.random.default_rng(seed).normal(0, 20, len(wrench))
        wrench[:, 2] = 0.02 * gain * wrench[:, 2] + noise
        days.append((accelerations, wrench))
    found = check(fit_inertia(*days[0], SETUP), *days[1])
    assert found.verdict == "valid"


def test_a_plate_whose_zero_changed_has_drifted_by_that_much(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    change = np.array([6.0, 0, -8.0, 0, 2.0, 0])
    found = check(model, accelerations, wrench + change)
    before = check(model, accelerations, wrench)
    assert found.verdict == "drifted"
    np.testing.assert_allclose(found.zeros[0].change - before.zeros[0].change, change, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sensor", range(2))
def test_the_offset_of_a_sensor_is_not_taken_for_the_zero_of_a_plate(
    laboratory, model, sensor, axis
):
    accelerations, wrench = record(laboratory(), 2)
    accelerations[:, 3 * sensor + axis] += 0.3
    found = check(model, accelerations, wrench)
    assert found.verdict == "offset"
    (note,) = found.notes
    assert note.values["sensor"] == ("rear", "front")[sensor]
    assert abs(note.values["change_mps2"]["xyz"[axis]] - 0.3) < 0.1


def test_swapped_plates_are_told_from_a_calibration_that_no_longer_holds(laboratory, assemblies):
    days = []
    for seed in (1, 2):
        accelerations, left = record(laboratory(), seed)
        _, right = record(laboratory(assembly=assemblies["right"]), seed)
        days.append((accelerations, left, right))
    (a, left, right), (a2, left2, right2) = days
    models = {"plate 1": fit_inertia(a, left, SETUP), "plate 2": fit_inertia(a, right, SETUP)}
    as_was = check_another_day(models, a2, {"plate 1": left2, "plate 2": right2}, "day2.c3d")
    assert as_was.verdict == "valid"
    swapped = check_another_day(models, a2, {"plate 1": right2, "plate 2": left2}, "day2.c3d")
    assert [note.code for note in swapped.notes] == ["calibration_plates_swapped"]
    assert swapped.notes[0].values["plates"] == ("plate 1", "plate 2")


def test_half_a_newton_of_drift_is_no_reason_to_do_anything(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    assert check(model, accelerations, wrench + 0.3).verdict == "valid"


def test_what_no_single_sensor_explains_makes_a_calibration_outdated(laboratory, model, assemblies):
    found = check(model, *record(laboratory(assembly=assemblies["right"]), 2))
    assert found.verdict == "outdated"


def test_a_still_platform_cannot_show_whether_a_calibration_is_valid(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    mean = accelerations.mean(axis=0)
    with pytest.raises(ValueError, match=r"moved too little .* expected 0.2"):
        check(model, mean + 0.15 * (accelerations - mean), 0.15 * wrench)


def test_a_component_that_hardly_moves_is_judged_by_what_is_left_not_by_its_r_squared(laboratory):
    """Sway alone: the vertical force is noise, of which nothing is explained and little is left."""
    a, w = record(laboratory(), 1)
    w[:, 2] = np.random.default_rng(0).normal(0, 1, len(w))
    row = left_over(fit_inertia(a, w, SETUP))[2]
    assert row.r_squared < 0.05
    assert row.verdict == "hardly moved"
    refuse_unusable({"plate 1": fit_inertia(a, w, SETUP)})


def test_vibration_above_the_filter_of_trials_does_not_count_as_left(laboratory):
    a, w = record(laboratory(), 1)
    vibration = 25 * np.sin(2 * np.pi * 17 * np.arange(len(w)) / RATE_HZ)
    row = left_over(fit_inertia(a, w + vibration[:, None] * [0, 0, 1, 0, 0, 0], SETUP))[2]
    assert row.after > 15
    assert row.left < 2


@pytest.mark.parametrize(("change", "verdict"), [(0.9, "valid"), (1.5, "drifted")])
def test_a_zero_that_changes_as_zeros_do_from_recording_to_recording_has_not_drifted(
    laboratory, model, change, verdict
):
    """The calibration is of one recording, so that 0.35 N·m are expected: 0.9 is no surprise."""
    accelerations, wrench = record(laboratory(), 2)
    wrench[:, 5] += change
    assert check(model, accelerations, wrench).verdict == verdict


@pytest.mark.parametrize(("amplitude", "verdict"), [(7.0, "valid"), (16.0, "outdated")])
def test_rollers_that_leave_up_to_twice_as_much_do_not_make_a_calibration_outdated(
    laboratory, amplitude, verdict
):
    """They turn, and their angle to each other is another one: no new calibration would help."""
    days = []
    for seed, moment in ((1, 2.0), (2, amplitude)):
        accelerations, wrench = record(laboratory(), seed)
        turning = moment * np.sin(2 * np.pi * 4.75 * np.arange(len(wrench)) / RATE_HZ)
        days.append((accelerations, wrench + turning[:, None] * [0, 0, 0, 0, 1, 0]))
    found = check(fit_inertia(*days[0], SETUP), *days[1])
    assert found.left["plate 1"][4] > MAX_LEFT[4]
    assert found.verdict == verdict


@pytest.mark.parametrize("amplitude", [20.0, 30.0, 40.0])
def test_a_rattle_that_no_calibration_explains_makes_one_outdated(laboratory, model, amplitude):
    accelerations, wrench = record(laboratory(), 2)
    wrench[:, 0] += amplitude * np.sin(2 * np.pi * 2.03 * np.arange(len(wrench)) / RATE_HZ)
    found = check(model, accelerations, wrench)
    assert found.left["plate 1"][0] > MAX_LEFT[0]
    assert found.verdict == "outdated"
