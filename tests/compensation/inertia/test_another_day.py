"""A calibration is held against an empty recording of another day, and a wrong one is told."""

import numpy as np
import pytest

from compensation.inertia.fit import fit_inertia
from compensation.inertia.model import Setup
from compensation.inertia.quality import (
    MAX_LEFT,
    check_another_day,
    left_over,
    refuse_unusable,
)
from hbm.spatial import rotation_about

RATE_HZ = 100.0
SETUP = Setup(("rear", "front"), rate_hz=RATE_HZ, cutoff_hz=20.0)
FRONT = slice(3, 6)


def record(lab, seed, **options):
    trial = lab.random_trial(seed, noise=seed, cutoff_hz=20, duration=40, **options)
    return trial.accelerations.copy(), trial.wrench.copy()


@pytest.fixture(scope="module")
def model(laboratory):
    return fit_inertia(*record(laboratory(), 1), SETUP)


@pytest.mark.parametrize("seed", [2, 3])
def test_an_unchanged_laboratory_is_still_valid(laboratory, model, seed):
    found = check_another_day(model, *record(laboratory(), seed))
    assert not found.faults
    assert (np.abs(found.zero_change) < 0.6).all()
    np.testing.assert_allclose(found.left, found.left_by_new_fit, atol=0.2)


def turned(a, w):
    a[:, FRONT] = a[:, FRONT] @ rotation_about(np.eye(3)[2], np.radians(6)).T


def component(a, w):
    w[:, 4] *= 1.3


def offset(a, w):
    a[:, 3] += 0.3


@pytest.mark.parametrize("change", [turned, component, offset])
def test_what_changed_since_the_calibration_is_a_reason_to_calibrate_again(
    laboratory, model, change
):
    accelerations, wrench = record(laboratory(), 2)
    change(accelerations, wrench)
    assert check_another_day(model, accelerations, wrench).faults


def test_so_is_a_sensor_that_is_later(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    accelerations[:, FRONT] = record(laboratory(), 2, late_s=0.003)[0][:, FRONT]
    assert check_another_day(model, accelerations, wrench).faults


def test_so_is_another_belt_assembly(laboratory, model, assemblies):
    recording = record(laboratory(assembly=assemblies["right"]), 2)
    found = check_another_day(model, *recording)
    assert found.faults
    own = fit_inertia(*recording, SETUP)
    np.testing.assert_allclose(found.left_by_new_fit, np.asarray(own.rms_slow), rtol=1e-6)


def test_a_plate_whose_zero_changed_has_changed_by_that_much(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    change = np.array([6.0, 0, -8.0, 0, 2.0, 0])
    before, after = (check_another_day(model, accelerations, wrench + x) for x in (0, change))
    np.testing.assert_allclose(after.zero_change - before.zero_change, change, atol=1e-9)
    assert [fault[:10] for fault in after.faults] == [f"zero of {c}" for c in ("Fx", "Fz", "My")]


def test_a_still_platform_cannot_show_whether_a_calibration_is_valid(laboratory, model):
    accelerations, wrench = record(laboratory(), 2)
    mean = accelerations.mean(axis=0)
    with pytest.raises(ValueError, match=r"expected 0\.2"):
        check_another_day(model, mean + 0.15 * (accelerations - mean), 0.15 * wrench)


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


@pytest.mark.parametrize(("change", "valid"), [(0.9, True), (1.5, False)])
def test_a_zero_that_changes_as_zeros_do_from_recording_to_recording_has_not_drifted(
    laboratory, model, change, valid
):
    """The calibration is of one recording, so that 0.35 N·m are expected: 0.9 is no surprise."""
    accelerations, wrench = record(laboratory(), 2)
    wrench[:, 5] += change
    assert (not check_another_day(model, accelerations, wrench).faults) == valid


@pytest.mark.parametrize(("amplitude", "valid"), [(7.0, True), (16.0, False)])
def test_rollers_that_leave_up_to_twice_as_much_are_no_reason_to_calibrate_again(
    laboratory, amplitude, valid
):
    """They turn, and their angle to each other is another one: no new calibration would help."""
    days = []
    for seed, moment in ((1, 2.0), (2, amplitude)):
        accelerations, wrench = record(laboratory(), seed)
        turning = moment * np.sin(2 * np.pi * 4.75 * np.arange(len(wrench)) / RATE_HZ)
        days.append((accelerations, wrench + turning[:, None] * [0, 0, 0, 0, 1, 0]))
    found = check_another_day(fit_inertia(*days[0], SETUP), *days[1])
    assert found.left[4] > MAX_LEFT[4]
    assert (not found.faults) == valid
