"""Faults of accelerometers between calibration and trial are found, and only faults."""

import numpy as np
import pytest

from compensation.inertia.fit import fit_inertia
from compensation.inertia.sensors import check_trial
from hbm.notes import Note

places = pytest.mark.parametrize("places", ["two", "four"])


@pytest.fixture(scope="module")
def laboratories(laboratory, sensor_places):
    """Laboratory, its model, and a brisk trial: places -> (laboratory, model, accelerations)."""
    ready = {}
    for name in ("one", "two", "four"):
        lab = laboratory(sensor_places[name])
        trial = lab.random_trial(1, noise=11, cutoff_hz=20)
        brisk = lab.random_trial(1, noise=12, cutoff_hz=20, duration=20)
        model = fit_inertia(trial.accelerations, trial.wrench)
        ready[name] = lab, model, brisk.accelerations
    return ready


@pytest.mark.parametrize("places", ["one", "two", "four"])
def test_sensors_in_order_give_no_warning(laboratories, places):
    lab, model, brisk = laboratories[places]
    slow = lab.slow_pitch_trial(noise=13, cutoff_hz=20, duration=20).accelerations
    assert check_trial(model, brisk) == ()
    assert check_trial(model, slow) == ()
    assert check_trial(model, np.tile(brisk[0], (100, 1))) == ()  # a platform at rest


@places
def test_swapped_sensors_are_named(laboratories, places):
    _, model, brisk = laboratories[places]
    swapped = brisk.copy()
    swapped[:, :3], swapped[:, 3:6] = brisk[:, 3:6], brisk[:, :3]
    note = Note.of("accelerometers_swapped", first="1", second="2")
    assert check_trial(model, swapped)[0] == note


@pytest.mark.parametrize("places", ["one", "four"])
def test_a_sensor_upside_down_is_named(laboratories, places):
    _, model, brisk = laboratories[places]
    turned = brisk.copy()
    turned[:, :3] *= [1, -1, -1]
    (note,) = (n for n in check_trial(model, turned) if n.code.startswith("accelerometer"))
    assert note.code == "accelerometer_turned"
    assert note.values["angles_deg"]["1"] > 150


@places
def test_a_dead_sensor_and_a_dead_channel_are_named(laboratories, places):
    _, model, brisk = laboratories[places]
    dead, stuck = brisk.copy(), brisk.copy()
    dead[:, 3:6] = 0.02
    stuck[:, 4] = 0.1
    (note,) = check_trial(model, dead)
    assert note.values["sensors"] == {"2": pytest.approx(0.035, abs=1e-3)}
    (note,) = check_trial(model, stuck)
    assert (note.code, list(note.values["sensors"])) == ("accelerometer_dead", ["2"])


def test_clipping_at_two_g_is_named_with_its_share(laboratories):
    _, model, brisk = laboratories["two"]
    shaken = brisk.copy()
    shaken[:20, 2] += 15
    clipped = np.clip(shaken, -19.62, 19.62)
    note = check_trial(model, clipped)[0]
    assert note.values["shares"] == {"1": pytest.approx(20 / 1900, abs=1e-3)}
    codes = {note.code for note in check_trial(model, clipped, range_g=6)}
    assert "accelerometer_clipped" not in codes


def test_motion_beyond_the_calibration_is_named(laboratories):
    lab, _, brisk = laboratories["two"]
    gentle = lab.slow_pitch_trial(noise=14, cutoff_hz=20)
    narrow = fit_inertia(gentle.accelerations, gentle.wrench)
    notes = check_trial(narrow, brisk)
    assert [note.code for note in notes].count("calibration_range_exceeded") == 1
    assert all(note.level == "warning" for note in notes)
